"""Straight pieces of thin lines: each one line's, with the plane that the line lies in."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from tests.support.drawn import draw, hanging, pinhole_cameras, polyline, scene_of, two_passes

from plnerf.detect.config_lines import LineMapConfig, SegmentConfig
from plnerf.detect.line_maps import LineMaps, line_maps
from plnerf.detect.segments import segments_of
from plnerf.detect.views import Views, views_of

CONFIG = SegmentConfig()
CAMERAS = pinhole_cameras(np.array([[0.0, -5.0, 0.0]]), np.zeros((1, 3)))


def drawn(lines: list[tuple[tuple[int, int], tuple[int, int]]], response: float = 0.9) -> LineMaps:
    """Pixels of lines between two places (column, row) in one image, each with its plane."""
    views = views_of(CAMERAS)
    pixels, normals = [], []
    for (u0, v0), (u1, v1) in lines:
        count = max(abs(u1 - u0), abs(v1 - v0)) + 1
        u, v = (np.linspace(a, b, count).round().astype(int) for a, b in ((u0, u1), (v0, v1)))
        ends = np.array([[u0, v0], [u1, v1]]) + 0.5
        rays = (ends - views.principal[0]) / views.focal[0]
        normal = views.R[0].T @ np.cross(np.append(rays[0], 1), np.append(rays[1], 1))
        pixels.append(v * views.sizes[0, 0] + u)
        normals.append(np.tile(normal / np.linalg.norm(normal), (count, 1)))
    pixel, first = np.unique(np.concatenate(pixels), return_index=True)
    normal = np.concatenate(normals)[first].astype(np.float32)
    return LineMaps(np.zeros(len(pixel), np.int64), pixel, np.full(len(pixel), response, np.float32), normal)


def lengths(maps: LineMaps, config: SegmentConfig = CONFIG) -> list[int]:
    found, piece = segments_of(maps, views_of(CAMERAS), config)
    assert len(piece) == len(maps.pixel) and piece.max(initial=-1) == len(found.owner) - 1
    return sorted(round(length) for length in found.length_px)


def test_lines_that_cross_stay_two_and_what_meets_end_to_end_is_one() -> None:
    across, steep = ((20, 60), (120, 60)), ((60, 20), (60, 110))
    assert lengths(drawn([across, steep])) == [39, 49, 100]  # one of them passes through
    bent = drawn([((20, 60), (60, 60)), ((60, 61), (100, 101))])
    assert lengths(bent) == [40, 57] and len(lengths(bent, replace(CONFIG, turn_rad=1.5))) == 0
    assert lengths(drawn([((20, 60), (70, 60)), ((71, 60), (120, 60))])) == [100]
    assert lengths(drawn([((20, 60), (70, 60)), ((73, 60), (120, 60))])) == [47, 50]


def test_short_faint_and_surplus_lines_are_left_out() -> None:
    least = round(CONFIG.least_px)
    assert lengths(drawn([((20, 60), (20 + least, 60)), ((20, 90), (18 + least, 90))])) == [least]
    assert lengths(drawn([((20, 60), (90, 60))], response=0.4)) == []
    many = [((20, 20 + 9 * k), (60 + 5 * k, 20 + 9 * k)) for k in range(6)]
    assert lengths(drawn(many), replace(CONFIG, most=2)) == [60, 65]


@pytest.mark.parametrize("lens", [(0.0,) * 5, (-0.05, 0.02, 0.001, -0.002, 0.003)], ids=["pinhole", "lens"])
def test_the_plane_of_a_segment_holds_the_line(tmp_path: Path, lens: tuple[float, ...]) -> None:
    straight = polyline(hanging(0.02, 0.05, 0.0))
    plain = two_passes(4)
    cameras = replace(plain, distortion=torch.tensor(lens).repeat(len(plain), 1))
    scene = scene_of(tmp_path, cameras, draw(cameras, [straight], noise=1.0))
    maps = line_maps(scene.images, cameras, scene.train, 1280, LineMapConfig())
    views: Views = views_of(cameras[list(scene.train)])
    found, piece = segments_of(maps, views, CONFIG)
    longest = [found.length_px[found.owner == n].argmax() for n in range(len(scene.train))]
    for n, k in enumerate(longest):
        normal = found.normal[found.owner == n][k]
        for end in straight[[0, -1]]:
            towards = (end - views.centre[n]) / np.linalg.norm(end - views.centre[n])
            assert abs(towards @ normal) < np.sin(np.radians(1.0))
    np.testing.assert_allclose(np.linalg.norm(found.normal, axis=1), 1)
    assert (maps.view[piece >= 0] == found.owner[piece[piece >= 0]]).all()
