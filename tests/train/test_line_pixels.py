"""Centre-line pixels: between the pixels where the line is, as wide as it is, and none without a line."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest
from tests.conftest import ROOT
from tests.detect.test_ridges import SIZE, band, between

from plnerf.detect.line_pixels import PixelSettings, wire_pixels
from plnerf.detect.ridges import find_ridges
from plnerf.errors import ConfigError
from plnerf.pipeline import bundled_span
from plnerf.scene.scene import load_scene


@pytest.mark.parametrize("contrast", [70, -70], ids=["bright", "dark"])
@pytest.mark.parametrize("angle_deg", [0.0, 17.0, 45.0, 90.0, 133.0])
@pytest.mark.parametrize("width_px", [1.0, 2.0, 3.5, 5.0])
@pytest.mark.parametrize("phase_px", [0.0, 0.3])
def test_points_lie_on_the_line(width_px: float, angle_deg: float, contrast: float, phase_px: float) -> None:
    found = wire_pixels(band(width_px, angle_deg, phase_px, contrast, noise=2))
    x, y = (found.at_px - SIZE / 2).T
    inner = np.maximum(np.abs(x), np.abs(y)) < SIZE / 2 - 12
    angle = np.deg2rad(angle_deg)
    away = np.abs(x * np.cos(angle) + y * np.sin(angle) + phase_px)[inner]
    assert np.median(away) < (0.1 if width_px < 4 else 0.2)
    assert away.max() < 0.5
    assert inner.sum() > 0.6 * SIZE
    assert (found.bright == (contrast > 0)).all()
    assert between(found.tangent_rad[inner], angle + np.pi / 2).max() < np.deg2rad(4)
    assert len(np.unique(found.piece)) == 1
    if width_px >= 2:
        assert np.median(found.width_px[inner]) == pytest.approx(width_px, abs=0.5)
    else:
        assert np.median(found.width_px[inner]) < 2.1


def test_nothing_is_found_where_there_is_nothing() -> None:
    for image in (np.full((40, 50, 3), 77, np.uint8), band(np.inf, 17.0, 0.3, 90, noise=3)):
        found = wire_pixels(image)
        assert len(found.at_px) == len(found.width_px) == len(found.piece) == 0


def test_brightness_and_contrast_change_nothing() -> None:
    image = band(2.0, 17.0, 0.3, 20, noise=2)  # well inside of 0 to 255
    one, other = wire_pixels(image), wire_pixels(image + 40)
    np.testing.assert_allclose(other.at_px, one.at_px, atol=1e-3)
    np.testing.assert_allclose(other.width_px, one.width_px, atol=1e-3)


def test_two_lines_are_two_pieces_and_the_map_may_be_given() -> None:
    image = band(2.0, 90.0, 20.0, 60, noise=2)
    image[SIZE // 2 :] = band(2.0, 90.0, -20.0, -60, noise=2)[SIZE // 2 :]
    found = wire_pixels(image)
    assert sorted(np.unique(found.piece)) == [1, 2]
    for piece in (1, 2):
        rows = found.at_px[found.piece == piece, 1]
        assert np.ptp(rows) < 1
    np.testing.assert_array_equal(wire_pixels(image, ridges=find_ridges(image)).at_px, found.at_px)


def test_short_or_weak_chains_are_left_out() -> None:
    image = band(2.0, 90.0, 0.0, 60, noise=2)
    assert len(wire_pixels(image).at_px) > 0
    assert len(wire_pixels(image, PixelSettings(shortest_px=2.0 * SIZE)).at_px) == 0
    assert len(wire_pixels(image, PixelSettings(strong=1.0)).at_px) == 0


def test_settings_that_mean_nothing_are_refused() -> None:
    with pytest.raises(ConfigError, match="but got"):
        PixelSettings(weak=0.7, strong=0.6)
    with pytest.raises(ConfigError, match="but got"):
        PixelSettings(along_px=0.0)


def test_wires_of_the_bundled_span_are_where_they_are(tmp_path: Path) -> None:
    """To half a pixel: sunlit wires are bright above and dark below, and either side may be found."""
    spec = importlib.util.spec_from_file_location("wire_pixels", ROOT / "benchmarks" / "wire_pixels.py")
    assert spec is not None
    assert spec.loader is not None
    bench = importlib.util.module_from_spec(spec)
    sys.modules["wire_pixels"] = bench
    spec.loader.exec_module(bench)
    scene = load_scene(bundled_span(), store=tmp_path)
    measured = bench.measure(scene, [0, 15, 30, 45])
    assert measured.precision > 0.7
    assert measured.recall > 0.5
    assert measured.median_px < 0.6
