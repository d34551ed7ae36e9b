"""Each pixel on a line holds the plane that the line in space lies in, through any lens."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from tests.support.drawn import draw, hanging, pinhole_cameras, polyline, scene_of, two_passes

from plnerf.detect.config_lines import LineMapConfig
from plnerf.detect.line_maps import line_maps, ridges_of
from plnerf.detect.line_ridges import HALF_TURN
from plnerf.detect.views import project_point, views_of

CONFIG = LineMapConfig()
MOST_PX = 1280


@pytest.mark.parametrize("lens", [(0.0,) * 5, (-0.05, 0.02, 0.001, -0.002, 0.003)], ids=["pinhole", "lens"])
def test_the_planes_hold_the_line(tmp_path: Path, lens: tuple[float, ...]) -> None:
    straight = polyline(hanging(0.02, 0.05, 0.0))
    plain = two_passes(4)
    cameras = replace(plain, distortion=torch.tensor(lens).repeat(len(plain), 1))
    scene = scene_of(tmp_path, cameras, draw(cameras, [straight], noise=1.0))
    maps = line_maps(scene.images, cameras, scene.train, MOST_PX, CONFIG)
    strong = maps.of(maps.response > 0.6)
    assert len(np.unique(strong.view)) == len(scene.train) and len(strong.view) > 100 * len(scene.train)
    assert np.median(np.abs(strong.normal[:, 0])) < np.sin(np.radians(1.5))  # the line runs along x
    ends = straight[[0, -1]]
    centre = cameras.centre.double().numpy()[strong.view]
    for end in ends:  # and lies in the plane
        towards = (end - centre) / np.linalg.norm(end - centre, axis=1, keepdims=True)
        assert np.median(np.abs((towards * strong.normal).sum(1))) < np.sin(np.radians(1.5))
    np.testing.assert_allclose(np.linalg.norm(strong.normal, axis=1), 1, atol=1e-5)


def test_what_is_masked_out_shows_no_line(tmp_path: Path) -> None:
    cameras = pinhole_cameras(np.array([[0.0, -0.5, 0.1]]), np.zeros((1, 3)))
    scene = scene_of(tmp_path, cameras, draw(cameras, [polyline(hanging(0.0, 0.0))]))
    whole = line_maps(scene.images, cameras, (0,), MOST_PX, CONFIG)
    valid = np.ones((180, 240), np.uint8)
    valid[:, :120] = 0
    valid.tofile(tmp_path / "valid.u8")
    half = line_maps(replace(scene, images=type(scene.images)(tmp_path, scene.images.sizes_px)).images,
                     cameras, (0,), MOST_PX, CONFIG)  # fmt: skip
    assert (half.pixel % 240 >= 120).all()
    assert set(half.pixel.tolist()) == {p for p in whole.pixel.tolist() if p % 240 >= 120}


def test_a_reduced_photo_shows_the_same_planes(tmp_path: Path) -> None:
    """Blocks of two pixels: half the size, the same lines in space."""
    straight = polyline(hanging(0.02, 0.05, 0.0))
    plain = two_passes(2)
    cameras = plain.at_size(2 * plain.size_px - 1)  # 479 x 359: the last blocks are half empty
    scene = scene_of(tmp_path, cameras, draw(cameras, [straight], noise=1.0, thick=3))
    maps = line_maps(scene.images, cameras, scene.train, 240, CONFIG)
    strong = maps.of(maps.response > 0.6)
    assert len(strong.view) > 100 * len(scene.train) and strong.pixel.max() < 240 * 180
    assert np.median(np.abs(strong.normal[:, 0])) < np.sin(np.radians(1.5))


def test_the_ridges_of_some_views_are_their_pixels_and_run_along_the_line(tmp_path: Path) -> None:
    cameras, line = two_passes(3), polyline(hanging(0.02, 0.05, 0.0, climb=0.2))
    scene = scene_of(tmp_path, cameras, draw(cameras, [line], noise=1.0))
    maps = line_maps(scene.images, cameras, scene.train, MOST_PX, CONFIG)
    views = views_of(scene.photo_cameras[list(scene.train)], MOST_PX)
    ridges = ridges_of(maps, views, np.array([4, 1]))
    count = 240 * 180
    assert ridges.response.shape == ridges.tangent.shape == (2 * count,)
    for k, view in enumerate((4, 1)):
        mine = maps.of(maps.view == view)
        response = np.zeros(count, np.float32)
        response[mine.pixel] = mine.response
        np.testing.assert_array_equal(ridges.response[k * count : (k + 1) * count], response)
        strong = mine.pixel[mine.response > 0.6]
        (u, v, _), (u_on, v_on, _) = (project_point(views, view, *line[j]) for j in (195, 205))
        along = np.arctan2(v_on - v, u_on - u) * HALF_TURN / np.pi  # it climbs: down or up to the right
        turn = (ridges.tangent[k * count + strong] - along + HALF_TURN / 2) % HALF_TURN - HALF_TURN / 2
        assert np.median(np.abs(turn)) < HALF_TURN * 3 / 180
        assert abs(np.sin(along * np.pi / HALF_TURN)) > np.sin(np.radians(6.0))
