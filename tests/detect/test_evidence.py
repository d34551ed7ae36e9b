"""A line along the span responds where it is, whatever the light; a line across does not."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.support.drawn import draw, hanging, polyline, scene_of, two_passes

from plnerf.detect import evidence
from plnerf.detect.config import OddsConfig
from plnerf.detect.config_lines import EvidenceConfig
from plnerf.detect.evidence import (
    Vanishing,
    line_evidence,
    line_response,
    line_ridges,
    vanishing,
    wire_directions,
)
from plnerf.detect.line_ridges import turned
from plnerf.detect.reduction import tiles
from plnerf.scene.cameras import project
from plnerf.scene.images import ImageStore

SIZE = 96
CONFIG = EvidenceConfig()
X = np.array([1.0, 0.0, 0.0])


def along(angle_deg: float) -> Vanishing:
    """The same direction at every pixel: of a line that runs across the view."""
    angle = np.deg2rad(angle_deg)
    return Vanishing((float(np.cos(angle)), float(np.sin(angle)), 0.0), (100.0, 100.0), (48.0, 48.0))


def line_picture(angle_deg: float, thick: int = 2, ground: int = 120, contrast: int = 60) -> np.ndarray:
    """A line through the middle."""
    picture = np.full((SIZE, SIZE), ground, np.uint8)
    angle = np.deg2rad(angle_deg)
    middle, far = np.array([SIZE / 2] * 2), 100 * np.array([np.cos(angle), np.sin(angle)])
    a, b = (tuple(int(v) for v in np.round(16 * end)) for end in (middle - far, middle + far))
    cv2.line(picture, a, b, ground + contrast, thick, cv2.LINE_AA, 4)
    return np.repeat(picture[..., None], 3, -1)


def distance_from_line(angle_deg: float) -> np.ndarray:
    y, x = np.mgrid[:SIZE, :SIZE] - SIZE / 2
    angle = np.deg2rad(angle_deg)
    return np.abs(y * np.cos(angle) - x * np.sin(angle))


@pytest.mark.parametrize("angle_deg", [0.0, 25.0, 90.0, 140.0])
@pytest.mark.parametrize("contrast", [60, -60], ids=["bright", "dark"])
@pytest.mark.parametrize("thick", [1, 2, 5])
def test_a_line_along_responds_on_itself_and_nowhere_else(
    angle_deg: float, contrast: int, thick: int
) -> None:
    response = line_response(line_picture(angle_deg, thick, contrast=contrast), along(angle_deg), CONFIG)
    far = distance_from_line(angle_deg)
    inner = np.zeros((SIZE, SIZE), bool)
    inner[12:-12, 12:-12] = True
    on = np.array([
        response[inner & (np.abs(far) < 1.5) & band].max(initial=0)
        for band in _bands(angle_deg)
        if (inner & (far < 1.5) & band).sum() > 20
    ])
    assert len(on) >= 5 and (on > 0.4).all()  # all along it
    assert response[inner & (far > 3)].max() < 0.05


def _bands(angle_deg: float) -> list[np.ndarray]:
    """Strips across the line, ten pixels wide."""
    y, x = np.mgrid[:SIZE, :SIZE] - SIZE / 2
    angle = np.deg2rad(angle_deg)
    where = x * np.cos(angle) + y * np.sin(angle)
    return [np.abs(where - middle) < 5 for middle in range(-35, 40, 10)]


@pytest.mark.parametrize("angle_deg", [0.0, 25.0, 90.0])
@pytest.mark.parametrize("across_deg", [90.0, 60.0, 45.0])
def test_a_line_across_does_not_respond(angle_deg: float, across_deg: float) -> None:
    picture = line_picture(angle_deg + across_deg)
    inner = np.s_[12:-12, 12:-12]
    assert line_response(picture, along(angle_deg), CONFIG)[inner].max() < 0.05
    assert line_response(picture, along(angle_deg + across_deg), CONFIG)[inner].max() > 0.4


@given(st.integers(0, 1000), st.integers(1, 55))
@settings(max_examples=10, deadline=None)
def test_more_light_on_all_changes_nothing_and_polarity_does_not_count(seed: int, more: int) -> None:
    image = np.random.default_rng(seed).integers(50, 200, (40, 50, 3), dtype=np.uint8)
    response = line_response(image, along(20.0), CONFIG)
    assert response.max() > 0.1
    for other, angle_deg in ((image + np.uint8(more), 20.0), (255 - image, 20.0), (image, 200.0)):
        changed = np.abs(line_response(other, along(angle_deg), CONFIG) - response) > 1e-3
        # Of two neighbours that are equal but for rounding, either may be the strongest.
        assert changed.sum() <= 2


def test_responses_are_shares_and_an_even_picture_has_none() -> None:
    image = np.random.default_rng(3).integers(0, 256, (60, 50, 3), dtype=np.uint8)
    response = line_response(image, along(0.0), CONFIG)
    assert response.dtype == np.float32 and response.min() >= 0 and response.max() <= 1
    even = np.full((60, 50, 3), 77, np.uint8)
    assert line_response(even, along(0.0), CONFIG).max() < 1e-5  # round-off
    slope = np.repeat(np.broadcast_to(np.arange(50, dtype=np.uint8) * 4, (60, 50))[..., None], 3, -1)
    inner = line_response(np.ascontiguousarray(slope), along(90.0), CONFIG)[:, 20:30]
    assert inner.max() < 0.01  # an even slope is no line


@given(st.floats(-1, 1), st.floats(-1, 1))
@settings(max_examples=20, deadline=None)
def test_a_wire_that_sags_lies_in_the_fan_of_its_direction(steeper: float, aside: float) -> None:
    """From aside and from a view along it, but for what that view enlarges beyond the fan's limit."""
    cameras, direction = two_passes(2), np.array([0.8, 0.6, 0.0])
    azimuth = np.arctan2(0.6, 0.8) + aside * np.radians(CONFIG.askew_deg)
    slope = steeper * np.radians(CONFIG.sag_deg)
    wire = np.array([np.cos(slope) * np.cos(azimuth), np.cos(slope) * np.sin(azimuth), np.sin(slope)])
    for i in range(len(cameras)):
        shape = tuple(int(side) for side in cameras.size_px[i].flip(0))
        lines = vanishing(cameras, i, direction, CONFIG)
        towards = lines.towards(shape)
        low, high = lines.fan(towards, 1, CONFIG)
        tangent = vanishing(cameras, i, wire, CONFIG).towards(shape)
        turn = np.arctan2(
            towards[..., 0] * tangent[..., 1] - towards[..., 1] * tangent[..., 0],
            (towards * tangent).sum(-1),
        )
        most = np.radians(CONFIG.most_deg)
        assert ((turn >= low - 1e-4) | (turn < -most)).all()
        assert ((turn <= high + 1e-4) | (turn > most)).all()


def test_lines_respond_to_the_side_on_which_the_fan_is() -> None:
    first, other = along(30.0), along(52.0)
    lines = replace(first, beside=(other.along,))
    inner, ridge = np.s_[12:-12, 12:-12], OddsConfig().min_response
    assert line_response(line_picture(52.0), lines, CONFIG)[inner].max() > 2 * ridge
    assert line_response(line_picture(52.0), first, CONFIG)[inner].max() < ridge
    assert line_response(line_picture(8.0), lines, CONFIG)[inner].max() < ridge


def test_slopes_are_a_fan_from_aside_and_none_from_above() -> None:
    """Cameras level and looking down, both with x along the line."""
    tilts = wire_directions(X, replace(CONFIG, askew_deg=0.0))
    from_aside = tilts @ np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])  # z up is -y of the image
    from_above = tilts @ np.diag([1, -1, -1])
    for directions, sag_deg in ((from_aside, CONFIG.sag_deg), (from_above, 0.0)):
        first, *rest = [tuple(float(v) for v in one) for one in directions]
        lines = Vanishing(first, (100.0, 100.0), (48.0, 48.0), tuple(rest))
        low, high = lines.fan(lines.towards((SIZE, SIZE)), 1, CONFIG)
        middle = [np.degrees(side[47:49, 47:49].mean()) for side in (low, high)]
        np.testing.assert_allclose(middle, np.array([-1, 1]) * (sag_deg + CONFIG.lens_deg), atol=0.2)


@pytest.mark.parametrize("direction", [(1.0, 0.0, 0.2), (0.6, -0.7, 0.2)])
def test_vanishing_directions_are_where_points_move_along_a_line(direction: tuple[float, ...]) -> None:
    """A point seen in a pixel at any depth, moved a little along a direction, moves that way."""
    cameras = two_passes(2)
    for i in range(len(cameras)):
        w, h = (int(side) for side in cameras.size_px[i])
        towards = vanishing(cameras, i, np.array(direction), CONFIG).towards((h, w))
        assert towards.shape == (h, w, 2)
        np.testing.assert_allclose(np.linalg.norm(towards, axis=-1), 1, atol=1e-5)
        for u, v in ((20, 30), (200, 100), (120, 170)):
            for depth in (0.3, 1.0):
                plane = torch.tensor([u + 0.5, v + 0.5]) - cameras.principal_px[i]
                ray = torch.cat([plane / cameras.focal_px[i], torch.ones(1)]) * depth
                point = cameras.centre[i] + cameras.R_scene_camera[i] @ ray
                step = 0.002 * torch.tensor(direction)
                pixels, _ = project(cameras, torch.stack([point - step, point + step]))
                moved = (pixels[i, 1] - pixels[i, 0]).numpy()
                np.testing.assert_allclose(moved / np.linalg.norm(moved), towards[v, u], atol=2e-3)


def test_evidence_is_that_of_the_chosen_images_and_blind_where_masked(tmp_path: Path) -> None:
    cameras = two_passes(2, wobble=0.0)
    pictures = draw(cameras, [polyline(hanging(0.0, 0.05))])
    scene = scene_of(tmp_path, cameras, pictures)
    each = [line_evidence(scene.images, cameras, (i,), X, CONFIG)[0] for i in range(4)]
    sizes = scene.images.sizes_px.prod(1)
    assert [len(part.response) for part in each] == sizes.tolist()
    assert all(part.response.max() > 0.4 for part in each)
    together = line_evidence(scene.images, cameras, (0, 1), X, CONFIG)
    for one, alone in zip(together, each[:2], strict=True):
        np.testing.assert_allclose(one.response, alone.response, atol=1e-6)
        np.testing.assert_array_equal(one.tangent, alone.tangent)
    valid = np.ones(int(sizes.sum()), np.uint8)
    valid[: int(sizes[0]) // 2] = 0
    valid.tofile(tmp_path / "valid.u8")
    (masked,) = line_evidence(ImageStore(tmp_path, scene.images.sizes_px), cameras, (0,), X, CONFIG)
    half = int(sizes[0]) // 2
    assert each[0].response[:half].max() > 0 and masked.response[:half].max() == 0
    np.testing.assert_array_equal(masked.response[half:], each[0].response[half:])


@pytest.mark.parametrize("angle_deg", [0.0, 25.0, 90.0, 140.0, 179.0])
@pytest.mark.parametrize("aside_deg", [-12.0, 0.0, 9.0])
def test_a_ridge_runs_as_its_line_does_wherever_lines_are_looked_for(
    angle_deg: float, aside_deg: float
) -> None:
    """To within half of what the directions that are tried lie apart, and a little."""
    angle = np.deg2rad(angle_deg)
    fan = [np.deg2rad(angle_deg + side) for side in (-14, 14)]
    lines = replace(along(angle_deg), beside=tuple((np.cos(one), np.sin(one), 0.0) for one in fan))
    ridges = line_ridges(line_picture(angle_deg + aside_deg), lines, CONFIG)
    middle = (distance_from_line(angle_deg + aside_deg) < 1.5) & (ridges.response > 0.5)
    middle[:20] = middle[-20:] = middle[:, :20] = middle[:, -20:] = False
    off = [turned(tangent, angle + np.deg2rad(aside_deg)) for tangent in ridges.tangent[middle]]
    assert len(off) > 30 and np.rad2deg(max(off)) < 3.0


def test_a_thin_line_in_a_large_photo_responds_in_its_blocks() -> None:
    """Pixel by pixel it is looked at, and nothing is averaged away: a line of one pixel in blocks of four."""
    picture = np.random.default_rng(5).normal(120, 3, (400, 600)).clip(0, 255).astype(np.uint8)
    cv2.line(picture, (0, 50), (599, 350), 150, 1, cv2.LINE_AA)
    angle = np.degrees(np.arctan2(300, 599))
    image = np.repeat(picture[..., None], 3, -1)
    response = line_response(image, along(angle), replace(CONFIG, most_px=150))
    assert response.shape == (100, 150)
    y, x = np.mgrid[:100, :150]
    far = np.abs((4 * y + 2 - 50) * np.cos(np.radians(angle)) - (4 * x + 2) * np.sin(np.radians(angle)))
    columns = (response * (far < 4)).max(0)[8:-8]
    assert (columns > 0.5).mean() > 0.95
    assert response[far > 12].max() < 0.35


def test_tiles_change_nothing() -> None:
    image = np.random.default_rng(2).integers(0, 256, (200, 333, 3), dtype=np.uint8)
    lines = Vanishing((0.9, 0.2, 0.1), (300.0, 310.0), (160.0, 90.0))
    small = line_response(image, lines, replace(CONFIG, most_px=112))
    assert small.shape == (67, 111)
    parts = [(tile.inner[0].stop, tile.inner[1].stop) for tile in tiles((200, 333), 111, 0)]
    assert parts == [(111, 111), (111, 222), (111, 333), (200, 111), (200, 222), (200, 333)]
    np.testing.assert_allclose(small, _in_one_tile(image, lines, replace(CONFIG, most_px=112)), atol=1e-3)


def _in_one_tile(image: np.ndarray, lines: Vanishing, config: EvidenceConfig) -> np.ndarray:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(evidence, "tiles", lambda shape, side, margin: tiles(shape, 999, 0))
        return line_response(image, lines, config)
