"""Pictures read back as what was rendered: depth to the millimetre; files are whole or absent."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from plnerf.errors import PlnerfError
from plnerf.render.panels import evaluation_panel
from plnerf.render.picture_files import complete_file, write_npy, write_png
from plnerf.render.pictures import (
    NO_SURFACE,
    DepthRange,
    accumulation_picture,
    depth_16bit,
    depth_16bit_meaning,
    depth_picture,
    depth_range,
    error_picture,
    normals_picture,
    rgb_picture,
    steps_per_world_unit,
    uncertainty_picture,
    with_legend,
    world_depth,
    world_deviation,
)
from plnerf.render.views import RenderedView
from plnerf.scene.transforms import Frames

SHOWN = DepthRange(2.0, 50.0, "m")


def frames(scale: float = 0.04, unit: str = "m") -> Frames:
    return Frames(np.eye(3), scale, np.zeros(3), "m" if unit == "m" else "unscaled", None, "file")


def view(
    z_m: np.ndarray, scale: float = 0.04, accumulation: float = 1.0, normals: bool = True
) -> RenderedView:
    """A view of surfaces at z_m metres along the axis; its other depths differ from that one."""
    z = (z_m * scale).astype(np.float32)
    normal = np.zeros((*z.shape, 3), np.float32)
    normal[..., 2] = accumulation
    return RenderedView(
        rgb=np.zeros((*z.shape, 3), np.float32),
        accumulation=np.full_like(z, accumulation),
        depth=z * 3,
        depth_median=z * 2,
        z_depth=z,
        normals=normal if normals else None,
    )


def test_the_16_bit_picture_reads_back_the_millimetres(tmp_path: Path) -> None:
    z_m = np.random.default_rng(0).uniform(0.5, 60, (20, 30))
    f = frames()
    path = tmp_path / "a" / "depth.png"
    write_png(path, depth_16bit(world_depth(view(z_m), f), f), depth_16bit_meaning(f))
    with Image.open(path) as image:
        assert "metres = value / 1000" in image.text["Description"]
        back = np.asarray(image)
    assert back.dtype == np.uint16
    np.testing.assert_allclose(back, z_m * 1000, atol=0.51)


def test_unscaled_depth_reads_back_by_the_stated_factor() -> None:
    z = np.random.default_rng(0).uniform(0.001, 0.09, (5, 6))
    f = frames(scale=700.0, unit="unscaled")
    values = depth_16bit(world_depth(view(z, scale=700.0), f), f)
    np.testing.assert_allclose(values / steps_per_world_unit(f), z, atol=0.51 / steps_per_world_unit(f))
    assert values.max() > 20000, "the steps must be finer than the scene"
    assert f"value / {steps_per_world_unit(f):.9g}" in depth_16bit_meaning(
        f
    ) and "metre" not in depth_16bit_meaning(f)


def test_no_surface_is_0_near_is_at_least_1_and_far_saturates() -> None:
    f = frames()
    assert (depth_16bit(world_depth(view(np.full((2, 2), 5.0), accumulation=0.49), f), f) == 0).all()
    assert (depth_16bit(world_depth(view(np.full((2, 2), 5.0), accumulation=0.5), f), f) == 5000).all()
    assert (depth_16bit(world_depth(view(np.full((2, 2), 1e-5)), f), f) == 1).all()
    assert (depth_16bit(world_depth(view(np.full((2, 2), 80.0)), f), f) == 65535).all()


def test_the_float_file_holds_world_units(tmp_path: Path) -> None:
    z_m = np.random.default_rng(0).uniform(0.5, 600, (4, 5))
    write_npy(tmp_path / "d.npy", world_depth(view(z_m), frames()))
    back = np.load(tmp_path / "d.npy")
    assert back.dtype == np.float32
    np.testing.assert_allclose(back, z_m, rtol=1e-6)


def test_nearer_is_brighter_and_equal_ratios_are_equal_steps() -> None:
    depth = np.geomspace(2.0, 50.0, 256, dtype=np.float32)[None]
    picture = depth_picture(depth, SHOWN)[0].astype(float)
    luma = picture @ [0.299, 0.587, 0.114]
    assert np.diff(luma).max() < 0.5 and luma[0] > 200 and luma[-1] < 40
    assert np.unique(picture, axis=0).shape[0] > 200  # even in the logarithm: every colour of the map is used
    beyond = depth_picture(np.array([[0.1, 2.0, 50.0, 900.0, 0.0]], np.float32), SHOWN)[0]
    assert (beyond[0] == beyond[1]).all() and (beyond[2] == beyond[3]).all()
    assert tuple(beyond[4]) == NO_SURFACE


def test_the_range_is_that_of_most_surfaces() -> None:
    depth = np.linspace(3, 30, 10_000, dtype=np.float32).reshape(100, 100)
    depth[0, :50], depth[1, :50] = 900.0, 0.0
    shown = depth_range([depth], frames())
    assert 3 <= shown.near < 4 and 28 < shown.far <= 30 and shown.unit == "m"
    flat = depth_range([np.full((3, 3), 7.0, np.float32)], frames())
    assert flat.near == 7.0 < flat.far
    empty = depth_range([np.zeros((3, 3), np.float32)], frames(unit="unscaled"))
    assert 0 < empty.near < empty.far and "unscaled" in empty.unit


@pytest.mark.parametrize("width", [120, 960])
@pytest.mark.parametrize(
    "shown", [SHOWN, DepthRange(7.0, 7.35, "m"), DepthRange(1e-4, 1e5, "units, unscaled")]
)
def test_the_legend_leaves_the_picture_alone_and_states_its_ends(width: int, shown: DepthRange) -> None:
    depth = np.full((20, width), shown.near, np.float32)
    picture = depth_picture(depth, shown)
    labelled = with_legend(picture, shown)
    assert (labelled[:20] == picture).all() and labelled.shape[0] > 20 and labelled.shape[1] == width
    other = with_legend(picture, DepthRange(shown.near, shown.far * 1.9, shown.unit))
    assert (other != labelled).any()


def test_uncertainty_is_bright_where_a_surface_is_spread() -> None:
    spread = replace(view(np.ones((1, 3))), depth_deviation=np.array([[0.1, 1.0, 0.1]], np.float32) * 0.04)
    deviation = world_deviation(spread, frames())
    np.testing.assert_allclose(deviation, [[0.1, 1.0, 0.1]], rtol=1e-6)
    small, large, other = uncertainty_picture(deviation, DepthRange(0.05, 2.0, "m"))[0].astype(int)
    assert large.sum() > small.sum() + 100 and (small == other).all()
    gone = replace(spread, accumulation=np.zeros((1, 3), np.float32))
    picture = uncertainty_picture(world_deviation(gone, frames()), DepthRange(0.05, 2.0, "m"))
    assert (picture == NO_SURFACE).all()


def test_normals_become_colours_and_fade_with_the_surface() -> None:
    v = view(np.ones((2, 2)), accumulation=0.5)
    np.testing.assert_array_equal(normals_picture(v)[0, 0], [64, 64, 128])  # (0, 0, 1), half faded
    solid = view(np.ones((2, 2)))
    np.testing.assert_array_equal(normals_picture(solid)[0, 0], [128, 128, 255])
    assert (normals_picture(view(np.ones((2, 2)), accumulation=0.0)) == 0).all()


def test_colours_and_accumulation_are_rounded_not_cut() -> None:
    grey = np.arange(256)[None] / 255
    assert (accumulation_picture(grey.astype(np.float32) - 1e-3)[0] == np.arange(256)).all()
    assert (rgb_picture(np.repeat(grey[..., None], 3, -1) + 1e-3)[0, :, 0] == np.arange(256)).all()


def test_errors_are_amplified_and_ignored_pixels_black() -> None:
    a, b = np.full((2, 2, 3), 0.5, np.float32), np.full((2, 2, 3), 0.4, np.float32)
    valid = np.array([[True, False], [True, True]])
    picture = error_picture(a, b, valid, 4)
    assert (picture[valid] == 102).all() and (picture[~valid] == 0).all()


@pytest.mark.parametrize(("size", "shown_width"), [((32, 48), 336), ((40, 400), 400), ((90, 2560), 1280)])
@pytest.mark.parametrize("normals", [True, False])
def test_a_panel_holds_the_photo_as_it_is(size: tuple[int, int], shown_width: int, normals: bool) -> None:
    photo = np.random.default_rng(0).integers(0, 256, (*size, 3), dtype=np.uint8)
    rendered = view(np.full(size, 5.0), normals=normals)
    panel = evaluation_panel(
        rendered, photo, np.ones(size, np.bool_), frames(), title="0008.jpg", score="PSNR 20.00 dB"
    )
    tiles = 5 if normals else 4
    assert panel.shape[1] == tiles * shown_width + 6 * (tiles + 1)
    if shown_width == 400:
        rows = [r for r in range(panel.shape[0] - 40) if (panel[r : r + 40, 6:406] == photo).all()]
        assert len(rows) == 1


def test_a_file_is_complete_or_absent(tmp_path: Path) -> None:
    path = tmp_path / "x.txt"
    with pytest.raises(ValueError, match="stop"), complete_file(path) as beside:
        beside.write_text("half")
        raise ValueError("stop")
    assert list(tmp_path.iterdir()) == []
    path.write_text("old")
    with pytest.raises(KeyboardInterrupt), complete_file(path) as beside:
        beside.write_text("half")
        raise KeyboardInterrupt
    assert path.read_text() == "old" and list(tmp_path.iterdir()) == [path]
    with complete_file(path) as beside:
        assert beside.suffix == path.suffix and beside.parent == path.parent
        beside.write_text("new")
        assert path.read_text() == "old"
    assert path.read_text() == "new" and list(tmp_path.iterdir()) == [path]


def test_a_place_that_cannot_be_written_is_an_error_in_words(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("not a folder")
    with pytest.raises(PlnerfError, match="cannot be written"):
        write_png(tmp_path / "file" / "a.png", np.zeros((2, 2), np.uint8))
