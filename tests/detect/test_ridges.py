"""Wire maps: lines are found where they are, edges are not; brightness and turning change nothing."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from tests.conftest import ROOT

from plnerf.detect.config_lines import RidgeConfig
from plnerf.detect.ridges import find_ridges, ridge_map

SIZE = 120
INNER = np.s_[25:-25, 25:-25]


def band(width_px: float, angle_deg: float, phase_px: float, contrast: float, noise: float = 0) -> np.ndarray:
    """A straight band through the middle, its normal at the angle; a width of infinity makes a step edge."""
    fine = (np.mgrid[0 : 8 * SIZE, 0 : 8 * SIZE] + 0.5) / 8 - SIZE / 2
    across = across_px(angle_deg, phase_px, fine)
    inside = across > 0 if np.isinf(width_px) else np.abs(across) < width_px / 2
    grey = 120 + contrast * inside.reshape(SIZE, 8, SIZE, 8).mean((1, 3))
    grey += np.random.default_rng(0).normal(0, noise, grey.shape)
    return picture(grey)


def across_px(angle_deg: float, phase_px: float, yx: np.ndarray | None = None) -> np.ndarray:
    """Signed distance of each pixel's centre from the band's middle."""
    y, x = np.mgrid[0:SIZE, 0:SIZE] + 0.5 - SIZE / 2 if yx is None else yx
    angle = np.deg2rad(angle_deg)
    return x * np.cos(angle) + y * np.sin(angle) + phase_px


def picture(grey: np.ndarray) -> np.ndarray:
    return np.repeat(np.clip(np.round(grey), 0, 255)[..., None], 3, -1).astype(np.uint8)


def between(a_rad: np.ndarray, b_rad: float) -> np.ndarray:
    """Angle between two lines without a sense, up to 90 degrees."""
    return np.abs((a_rad - b_rad + np.pi / 2) % np.pi - np.pi / 2)


@pytest.mark.parametrize("contrast", [70, -70], ids=["bright", "dark"])
@pytest.mark.parametrize("angle_deg", [0.0, 17.0, 45.0, 90.0, 133.0])
@pytest.mark.parametrize("width_px", [1.0, 2.0, 3.5, 6.0])
def test_a_line_is_found_at_its_place_and_nowhere_else(
    width_px: float, angle_deg: float, contrast: float
) -> None:
    ridges = find_ridges(band(width_px, angle_deg, 0.3, contrast, noise=3))
    distance = np.abs(across_px(angle_deg, 0.3))[INNER]
    strength = ridges.strength[INNER]
    on = distance < 0.6
    assert strength[on].min() > 0.5
    assert strength[distance > width_px / 2 + 2].max() < 0.4
    assert (ridges.bright[INNER][on] == (contrast > 0)).all()
    assert between(ridges.tangent_rad[INNER][on], np.deg2rad(angle_deg + 90)).max() < np.deg2rad(4)


@pytest.mark.parametrize("angle_deg", [0.0, 17.0, 45.0, 133.0])
@pytest.mark.parametrize("noise", [0.0, 4.0])
def test_a_step_edge_is_no_wire(angle_deg: float, noise: float) -> None:
    strength = ridge_map(band(np.inf, angle_deg, 0.3, 90, noise))[INNER]
    assert strength.max() < 0.5


def test_flat_pictures_have_no_ridges_and_noise_has_few() -> None:
    assert ridge_map(np.full((40, 50, 3), 77, np.uint8)).max() < 1e-6
    noise = np.random.default_rng(0).integers(0, 256, (200, 200, 1), dtype=np.uint8).repeat(3, -1)
    assert (ridge_map(noise) > 0.5).mean() < 0.001


def test_short_pieces_are_weaker_than_long_ones() -> None:
    """A dash of 20 px against a line through the whole picture."""
    line = band(2.0, 90.0, 0.0, 60, noise=6)
    dash = band(2.0, 90.0, 0.0, 0, noise=6)
    dash[:, 50:70] = line[:, 50:70]
    assert ridge_map(dash)[59, 60] < 0.5 < ridge_map(line)[59, 60]


def test_brightness_and_contrast_change_nothing() -> None:
    image = some_photo(1) // 4
    strength = ridge_map(image)
    np.testing.assert_allclose(ridge_map(image + 57), strength, atol=2e-4)
    np.testing.assert_allclose(ridge_map(image * 3), strength, atol=2e-4)
    inverted = find_ridges(255 - image)
    np.testing.assert_allclose(inverted.strength, strength, atol=2e-4)


def test_the_map_turns_with_the_picture() -> None:
    image = some_photo(2)
    ridges = find_ridges(image)
    turned = find_ridges(np.rot90(image).copy())
    np.testing.assert_allclose(turned.strength, np.rot90(ridges.strength), atol=1e-4)
    clear = turned.strength > 0.3  # elsewhere, two directions may be equally good
    angle = np.rot90(ridges.tangent_rad) - np.pi / 2
    away = np.abs((turned.tangent_rad - angle + np.pi / 2) % np.pi - np.pi / 2)
    assert (away[clear] < 1e-3).mean() > 0.99
    assert clear.sum() > 100
    mirrored = ridge_map(image[:, ::-1].copy())
    np.testing.assert_allclose(mirrored[:, ::-1], ridges.strength, atol=0.25)  # 45 degrees is not 135


def some_photo(seed: int) -> np.ndarray:
    """Noise of many sizes with a few lines, uint8 (90, 130, 3)."""
    rng = np.random.default_rng(seed)
    grey = np.kron(rng.uniform(60, 160, (9, 13)), np.ones((10, 10))) + rng.normal(0, 12, (90, 130))
    for _ in range(4):
        slope, offset = rng.uniform(-1, 1), rng.uniform(20, 70)
        x = np.arange(130)
        y = np.round(offset + slope * (x - 65)).astype(int)
        inside = (y >= 0) & (y < 90)
        grey[y[inside], x[inside]] += rng.choice([-60, 60])
    return picture(grey)


@pytest.mark.parametrize("shape", [(1, 1), (2, 40), (16, 24), (40, 3)])
def test_any_size_will_do(shape: tuple[int, int]) -> None:
    image = np.random.default_rng(0).integers(0, 256, (*shape, 3), dtype=np.uint8)
    strength = ridge_map(image)
    assert strength.shape == shape
    assert ((strength >= 0) & (strength <= 1)).all()


def test_a_limit_on_single_pixels_and_wider_lines_are_settings() -> None:
    """A wire of 9 px needs a wider scale; no wire stands out where no response may."""
    wide = band(9.0, 17.0, 0.3, 70, noise=3)
    on = np.abs(across_px(17.0, 0.3))[INNER] < 0.6
    found = [
        ridge_map(wide, RidgeConfig(scales_px=scales))[INNER][on].min()
        for scales in ((0.9, 1.8), (0.9, 1.8, 3.6))
    ]
    assert found[0] < 0.5 < found[1]
    assert ridge_map(band(2.0, 17.0, 0.3, 70), RidgeConfig(max_response=0.1)).max() < 0.5


def bench() -> ModuleType:
    pytest.importorskip("skimage", reason="the benchmark's filters are those of scikit-image")
    spec = importlib.util.spec_from_file_location("wire_maps", ROOT / "benchmarks" / "wire_maps.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["wire_maps"] = module
    spec.loader.exec_module(module)
    return module


def test_the_benchmark_counts_as_it_says() -> None:
    """A map that is the mask itself is right, one shifted beyond the tolerance wrong; a mix by hand."""
    wire_maps = bench()
    wire = np.zeros((60, 60), bool)
    wire[29:32] = True
    photo = wire_maps.Photo("a", np.zeros((60, 60, 3), np.uint8), wire, np.zeros_like(wire))
    line = np.zeros((60, 60))
    line[30] = 1.0
    good = wire_maps.score([wire_maps.judge(line, photo, 3.0, True)], 0.5)
    assert (good.precision, good.recall, good.f1) == (1.0, 1.0, pytest.approx(1.0))
    far = wire_maps.score([wire_maps.judge(np.roll(line, 6, 0), photo, 3.0, True)], 0.5)
    assert (far.precision, far.recall) == (0.0, 0.0)
    half = line + np.roll(line, 10, 0)
    half[:, 30:] = 0
    mixed = wire_maps.score([wire_maps.judge(half, photo, 1.0, True)], 0.5)
    assert mixed.precision == 0.5
    assert mixed.recall == pytest.approx(0.5, abs=0.05)


@pytest.mark.slow
@pytest.mark.data
def test_wires_of_real_photos_are_found(shared_data: Path) -> None:
    """On some held-out photos, far better than by the curvature alone."""
    if not (shared_data / "norway" / "wire").is_dir():
        pytest.skip("the hand-drawn wire masks are not there")
    wire_maps = bench()
    photos = wire_maps.halves(wire_maps.read_photos(shared_data / "norway"))[1][::3]
    scores = {}
    for name in ("Hessian, 1 and 2 px (hessian)", "lines (ridge)"):
        judged = [wire_maps.judge(wire_maps.MAPS[name](photo.image), photo, 3.0, False) for photo in photos]
        scores[name] = wire_maps.score(judged).average_precision
    assert scores["lines (ridge)"] > 0.85
    assert scores["Hessian, 1 and 2 px (hessian)"] < 0.7
