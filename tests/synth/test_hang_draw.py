"""Wires drawn into photos: where they lie, how wide, what hides them, and how blurred and noisy they are."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image, JpegImagePlugin
from scipy.ndimage import gaussian_filter
from tests.support.flown_ground import HEIGHT, WIDTH, views

from plnerf.line.hang import hang
from plnerf.synth.hang_choose import HungWire
from plnerf.synth.hang_config import DrawConfig
from plnerf.synth.hang_depth import Depth
from plnerf.synth.hang_draw import axis_in, blurred, draw_tile, tiles
from plnerf.synth.hang_light import Light
from plnerf.synth.hang_photo import (
    exposures,
    noise_level,
    sharpness_px,
    to_linear,
    to_stored,
    write_like,
)
from plnerf.synth.hang_sights import sights

VIEW = views()[2]
CONFIG = DrawConfig(samples=9)
LIGHT = Light(np.array([0.0, 0.6, 0.8]), 0.4, np.full(3, 0.9))
WHOLE = (0, 0, WIDTH, HEIGHT)


def wire(diameter: float = 0.12, dx: float = 6.0) -> HungWire:
    found = hang((-dx, -3.0, 3.3), (dx, -1.0, 3.0), 0.4, diameter_m=diameter, name="w")
    return HungWire(found, 1, "aluminium")


def flat(z: float) -> Depth:
    """A surface at depth z in all of a photo."""
    K = np.array([[20.0, 0, 12], [0, 20, 8], [0, 0, 1]])
    return Depth(np.full((16, 24), z, np.float32), np.ones((16, 24), np.bool_), K)


def drawn(one: HungWire, depth: float = 10.0, config: DrawConfig = CONFIG) -> np.ndarray:
    axis = axis_in(VIEW, one, config)
    assert axis is not None
    return draw_tile(VIEW, flat(depth), [axis], LIGHT, WHOLE, config).alpha


def silhouette(one: HungWire, columns: np.ndarray) -> np.ndarray:
    """Rows of the wire's two edges at the middles of columns: of the planes through the camera that touch it.

    Seen from a distance d, a cylinder's edge is r^2 / d nearer than the axis, and nearly r beside it.
    """
    s = np.linspace(0, one.wire.base.length_m, 20001)
    points = one.wire.points(s)
    tangent = np.gradient(points, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    r = one.wire.diameter_m / 2
    away = points - VIEW.centre
    across = away - (away * tangent).sum(1, keepdims=True) * tangent
    d = np.linalg.norm(across, axis=1, keepdims=True)
    towards = -across / d
    side = np.cross(tangent, towards)
    edges = []
    for sign in (-1.0, 1.0):
        at = points + r * (r / d * towards + sign * np.sqrt(1 - (r / d) ** 2) * side)
        pixel, _, ahead = VIEW.project(at)
        order = np.argsort(pixel[ahead, 0])
        edges.append(np.interp(columns, pixel[ahead][order, 0], pixel[ahead][order, 1]))
    return np.sort(np.stack(edges), 0)


@pytest.mark.parametrize("diameter", [0.02, 0.12, 0.4])
def test_a_wire_covers_what_lies_between_its_edges(diameter: float) -> None:
    """In every column: as much, and around the same middle, through the lens's distortion."""
    one = wire(diameter)
    alpha = drawn(one)
    columns = np.arange(20, 220)
    top, bottom = silhouette(one, columns + 0.5)
    column = alpha[:, columns]
    inside = (top > 2) & (bottom < HEIGHT - 2)
    assert inside.sum() > 100
    np.testing.assert_allclose(column.sum(0)[inside].mean(), (bottom - top)[inside].mean(), rtol=0.01)
    rows = np.arange(HEIGHT)[:, None] + 0.5
    middle = (column * rows).sum(0) / column.sum(0)
    off = (middle - (top + bottom) / 2)[inside]
    # An edge is known to one sample in each column.
    assert abs(off.mean()) < 0.01 and off.std() < 1.2 / CONFIG.samples


def test_what_is_nearer_hides_it() -> None:
    assert drawn(wire(), depth=10.0).sum() > 100
    assert drawn(wire(), depth=5.0).sum() == 0


def test_it_ends_where_it_ends() -> None:
    alpha = drawn(wire(dx=2.0))
    ends, _, _ = VIEW.project(wire(dx=2.0).wire.points(np.array([0.0, wire(dx=2.0).wire.base.length_m])))
    left, right = np.sort(ends[:, 0])
    columns = np.flatnonzero(alpha.sum(0) > 0.05)
    assert abs(columns.min() - left) < 2 and abs(columns.max() + 1 - right) < 2


def test_tiles_make_the_same_picture() -> None:
    one = wire()
    axis = axis_in(VIEW, one, CONFIG)
    assert axis is not None
    whole = draw_tile(VIEW, flat(10.0), [axis], LIGHT, WHOLE, CONFIG)
    alpha = np.zeros_like(whole.alpha)
    light = np.zeros_like(whole.light)
    for box in tiles(VIEW, [axis], replace(CONFIG, tile_px=48)):
        left, top, right, bottom = box
        part = draw_tile(VIEW, flat(10.0), [axis], LIGHT, box, CONFIG)
        alpha[top:bottom, left:right], light[top:bottom, left:right] = part.alpha, part.light
    np.testing.assert_array_equal(alpha, whole.alpha)
    np.testing.assert_array_equal(light, whole.light)


def test_a_nearer_wire_lies_over_a_farther_one() -> None:
    near = HungWire(hang((-0.5, -4.0, 6.0), (0.5, 4.0, 6.0), 0.1, diameter_m=0.2), 1, "copper")
    axes = [axis for one in (near, wire(0.3)) if (axis := axis_in(VIEW, one, CONFIG)) is not None]
    both = draw_tile(VIEW, flat(10.0), axes, LIGHT, WHOLE, CONFIG)
    alone = draw_tile(VIEW, flat(10.0), axes[:1], LIGHT, WHOLE, CONFIG)
    full = alone.alpha == 1
    assert full.sum() > 20
    np.testing.assert_allclose(both.light[full], alone.light[full])
    assert both.alpha.max() <= 1


def test_the_side_to_the_sun_is_brighter() -> None:
    """The sun stands towards +y, which is up in the photo."""
    one = wire(0.4)
    axis = axis_in(VIEW, one, CONFIG)
    assert axis is not None
    layer = draw_tile(VIEW, flat(10.0), [axis], LIGHT, WHOLE, CONFIG)
    rows = np.flatnonzero(layer.alpha[:, 120] == 1)
    grey = layer.light[rows, 120].mean(1)
    assert grey[0] > 1.3 * grey[-1]


def test_widths_are_those_that_are_drawn() -> None:
    one = wire()
    s = np.linspace(0, one.wire.base.length_m, 50)
    seen = sights(one.wire.points(s), [VIEW], [flat(10.0)], 0.02)
    pixel = VIEW.project(one.wire.points(s))[0]
    at = np.flatnonzero(seen.seen[0] & (pixel[:, 0] > 20) & (pixel[:, 0] < 220))
    top, bottom = silhouette(one, pixel[at, 0])
    slope = np.gradient(pixel[:, 1])[at] / np.gradient(pixel[:, 0])[at]
    width = (bottom - top) / np.sqrt(1 + slope**2)  # across the wire, not down the column
    np.testing.assert_allclose(0.12 * seen.px_per_unit[0, at], width, rtol=0.01)


def test_blur_keeps_the_light() -> None:
    axis = axis_in(VIEW, wire(dx=2.0), CONFIG)
    assert axis is not None
    layer = draw_tile(VIEW, flat(10.0), [axis], LIGHT, WHOLE, CONFIG)
    soft = blurred(layer, 1.3)
    np.testing.assert_allclose(soft.alpha.sum(), layer.alpha.sum(), rtol=1e-6)
    np.testing.assert_allclose(soft.light.sum(), layer.light.sum(), rtol=1e-6)
    assert soft.alpha.max() < layer.alpha.max()


@pytest.mark.parametrize("sigma", [0.6, 1.0, 1.8])
def test_the_blur_of_edges_is_measured(sigma: float) -> None:
    y, x = np.mgrid[0:200, 0:300]
    pattern = 40.0 + 170.0 * ((np.floor((x + 0.37 * y) / 31) + np.floor((y - 0.21 * x) / 37)) % 2)
    grey = gaussian_filter(pattern, sigma)
    found = sharpness_px(np.repeat(np.rint(grey)[..., None], 3, 2).astype(np.uint8))
    assert found == pytest.approx(sigma, rel=0.1)


@pytest.mark.parametrize("sigma", [1.5, 4.0])
def test_noise_is_measured_beside_structure(sigma: float) -> None:
    random = np.random.default_rng(1)
    y, x = np.mgrid[0:256, 0:384]
    grey = 60 + 120 * x / 384 + 30 * ((x // 40 + y // 40) % 2)
    rgb = grey[..., None] + sigma * random.standard_normal((*grey.shape, 1))
    level = noise_level(np.repeat(np.clip(np.rint(rgb), 0, 255), 3, 2).astype(np.uint8))
    assert level.at(np.array([120.0]))[0] == pytest.approx(sigma, rel=0.25)


def test_srgb_and_back() -> None:
    stored = np.arange(256.0)
    np.testing.assert_allclose(to_stored(to_linear(stored)), stored, atol=1e-9)


@pytest.mark.parametrize("quality, subsampling", [(60, 2), (93, 0)])
def test_a_photo_is_written_as_its_camera_wrote_it(tmp_path: Path, quality: int, subsampling: int) -> None:
    rgb = cv2.GaussianBlur(np.random.default_rng(0).integers(0, 255, (64, 96, 3)).astype(np.uint8), (9, 9), 3)
    exif = Image.Exif()
    exif[0x010F] = "maker"
    first, second = tmp_path / "a.jpg", tmp_path / "b.jpg"
    Image.fromarray(rgb).save(first, quality=quality, subsampling=subsampling, exif=exif, comment=b"c")
    write_like(first, np.asarray(Image.open(first)), second)
    one, other = Image.open(first), Image.open(second)
    assert isinstance(one, JpegImagePlugin.JpegImageFile)
    assert isinstance(other, JpegImagePlugin.JpegImageFile)
    assert one.quantization == other.quantization
    assert JpegImagePlugin.get_sampling(one) == JpegImagePlugin.get_sampling(other)
    assert other.getexif()[0x010F] == "maker" and other.info["comment"] == b"c"
    # Whoever compresses once more with the same tables changes hardly anything.
    assert np.abs(np.asarray(one).astype(int) - np.asarray(other)).mean() < 1


def test_exposures_are_those_of_exif(tmp_path: Path) -> None:
    paths = []
    for i, time in enumerate((0.01, 0.02, 0.04)):
        exif = Image.Exif()
        exif.get_ifd(0x8769).update({0x829A: time, 0x8827: 200, 0x829D: 2.8})
        paths.append(tmp_path / f"{i}.jpg")
        Image.new("RGB", (8, 8)).save(paths[-1], exif=exif)
    np.testing.assert_allclose(exposures(paths), [0.5, 1.0, 2.0])
    Image.new("RGB", (8, 8)).save(tmp_path / "none.jpg")
    np.testing.assert_array_equal(exposures([*paths, tmp_path / "none.jpg"]), np.ones(4))
