"""The span that comes with the package: its truth, its poses and its masks agree to the pixel.

Read here from the files alone, with a projection of this test's own: OpenGL camera-to-world axes.
"""

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy.ndimage import binary_dilation, minimum_filter
from scipy.spatial import cKDTree

import plnerf

ROOT = Path(plnerf.__file__).parent / "data" / "span"
TRANSFORMS = json.loads((ROOT / "transforms.json").read_text())
TRUTH = json.loads((ROOT / "truth.json").read_text())
FRAMES = TRANSFORMS["frames"]


def fine_polyline(conductor) -> np.ndarray:
    """The truth's polyline with points every 5 mm."""
    points = np.array(conductor["polyline"])
    at = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    fine = np.arange(0, at[-1], 0.005)
    return np.stack([np.interp(fine, at, points[:, k]) for k in range(3)], axis=1)


LINES = [fine_polyline(conductor) for conductor in TRUTH["conductors"]]
RADII = [conductor["diameter_m"] / 2 for conductor in TRUTH["conductors"]]


def project(frame, wires=slice(None)):
    """Pixel, depth and radius in pixels of every polyline point inside or near the image."""
    T_world_gl = np.array(frame["transform_matrix"])
    points = np.concatenate(LINES[wires])
    radius = np.repeat(RADII[wires], [len(line) for line in LINES[wires]])
    local = (points - T_world_gl[:3, 3]) @ T_world_gl[:3, :3] * [1, -1, -1]
    local, radius = local[local[:, 2] > 0.1], radius[local[:, 2] > 0.1]
    pixel = local[:, :2] / local[:, 2:] * [TRANSFORMS["fl_x"], TRANSFORMS["fl_y"]]
    pixel += [TRANSFORMS["cx"], TRANSFORMS["cy"]]
    inside = (pixel > -20).all(1) & (pixel < [TRANSFORMS["w"] + 20, TRANSFORMS["h"] + 20]).all(1)
    return pixel[inside], local[inside, 2], TRANSFORMS["fl_x"] * radius[inside] / local[inside, 2]


def read(path):
    return np.asarray(Image.open(ROOT / path))


def test_the_bundle_is_small_and_complete():
    size = sum(path.stat().st_size for path in ROOT.rglob("*") if path.is_file())
    assert size <= 12e6
    assert TRUTH["images"] == len(FRAMES) == len(list((ROOT / "images").iterdir()))
    for i, frame in enumerate(FRAMES):
        shape = (TRANSFORMS["h"], TRANSFORMS["w"])
        assert read(frame["file_path"]).shape == (*shape, 3)
        mask = read(frame["wire_mask_path"])
        assert mask.shape == shape and mask.dtype == np.uint8
        assert set(np.unique(mask)) <= {0, 255}
        assert ("depth_path" in frame) == (i % 8 == 0)


@pytest.mark.slow
def test_every_mask_pixel_lies_on_a_projected_wire():
    """Within 1.5 px and the wire's radius of the axis, in every image."""
    for frame in FRAMES:
        mask = read(frame["wire_mask_path"]) > 0
        assert mask.sum() > 100
        centres = np.stack(np.nonzero(mask)[::-1], axis=1) + 0.5
        beside = np.full(len(centres), np.inf)  # from each mask pixel to the nearest wire's edge
        for i in range(len(LINES)):
            pixel, _, radius_px = project(frame, slice(i, i + 1))
            if len(pixel):
                distance, nearest = cKDTree(pixel, balanced_tree=False, compact_nodes=False).query(centres)
                beside = np.minimum(beside, distance - radius_px[nearest])
        assert beside.max() <= 1.5, frame["file_path"]


def test_every_visible_point_of_a_wire_lies_on_its_mask():
    """In held-out images, where the depth tells what stands in front: 95 % on the mask, within 1 px."""
    for frame in FRAMES[::8]:
        near_mask = binary_dilation(read(frame["wire_mask_path"]) > 0, np.ones((3, 3)))
        depth = read(frame["depth_path"]).astype(float) / 1000
        depth[depth == 0] = np.inf
        nearest_around = minimum_filter(depth, 5)
        pixel, z, _ = project(frame)
        column, row = np.floor(pixel).astype(int).T
        inside = (column >= 0) & (column < TRANSFORMS["w"]) & (row >= 0) & (row < TRANSFORMS["h"])
        column, row, z = column[inside], row[inside], z[inside]
        visible = nearest_around[row, column] > z - 0.25  # nothing in front, not even beside it
        assert visible.sum() > 100
        assert near_mask[row[visible], column[visible]].mean() >= 0.95, frame["file_path"]


def test_depth_on_thick_wires_is_the_wires_own():
    """Where a wire is 4 px wide or more, the depth along its axis is its front: axis less radius."""
    checked = 0
    for frame in FRAMES[::8]:
        depth = read(frame["depth_path"]).astype(float) / 1000
        mask = read(frame["wire_mask_path"]) > 0
        pixel, z, radius_px = project(frame)
        column, row = np.floor(pixel).astype(int).T
        inside = (column >= 0) & (column < TRANSFORMS["w"]) & (row >= 0) & (row < TRANSFORMS["h"])
        use = inside & (radius_px > 2)
        column, row, z = column[use], row[use], z[use]
        use = mask[row, column]
        gap = z[use] - depth[row[use], column[use]]
        if len(gap):
            assert (np.abs(gap) < 0.06).mean() > 0.97, frame["file_path"]
            assert 0 < np.median(gap) < max(RADII) + 0.005  # in front of the axis, not on it
        checked += len(gap)
    assert checked > 1000


def test_truth_closes_on_itself():
    """The conductors' parameters give the polyline, the sag, the length and the towers' clamps."""
    for i, wire in enumerate(TRUTH["conductors"]):
        points = np.array(wire["polyline"])
        assert np.linalg.norm(np.diff(points, axis=0), axis=1).max() <= 0.2501
        a, b, p, s0, z0 = (np.array(wire["a"]), np.array(wire["b"]), wire["p_m"], wire["s0_m"], wire["z0_m"])
        s = (points[:, :2] - a[:2]) @ wire["direction"]
        np.testing.assert_allclose(z0 + p * (np.cosh((s - s0) / p) - 1), points[:, 2], atol=2e-6)
        s = np.linspace(0, wire["span_m"], 100_001)
        chord = a[2] + (b[2] - a[2]) * s / wire["span_m"]
        assert (chord - z0 - p * (np.cosh((s - s0) / p) - 1)).max() == pytest.approx(wire["sag_m"], abs=1e-8)
        assert p * (np.sinh((wire["span_m"] - s0) / p) + np.sinh(s0 / p)) == pytest.approx(wire["length_m"])
        for tower, end in zip(TRUTH["towers"], (a, b), strict=True):
            np.testing.assert_allclose(tower["attachments"][i], end, atol=1e-9)
