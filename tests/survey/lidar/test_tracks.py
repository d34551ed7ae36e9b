"""Tracks follow one hanging curve to its end; a bundle's wires are told apart in its cross-section."""

from itertools import pairwise

import numpy as np
import pytest

from plnerf.line.hang import hang
from plnerf.line.wire import Wire
from plnerf.survey.lidar.bundles import split
from plnerf.survey.lidar.config import BundleConfig, LidarConfig, TrackConfig
from plnerf.survey.lidar.linear import find_linear, pieces, thinned
from plnerf.survey.lidar.parabola import Parabola, fit_parabola
from plnerf.survey.lidar.spans import find_spans, meet
from plnerf.survey.lidar.tracks import find_tracks

CONFIG = LidarConfig()


def sampled(wire: Wire, per_metre: float = 3.0, noise_m: float = 0.02, seed: int = 0) -> np.ndarray:
    random = np.random.default_rng(seed)
    s = random.uniform(0, wire.base.length_m, int(per_metre * wire.base.length_m))
    return wire.points(s) + noise_m * random.normal(size=(len(s), 3))


def fitted(points: np.ndarray) -> Parabola:
    return fit_parabola(points, TrackConfig())


def test_a_track_is_the_parabola_of_its_points_whichever_way_it_runs() -> None:
    s = np.linspace(-60, 70, 200)
    u, n = np.array([0.6, 0.8]), np.array([-0.8, 0.6])
    flat = [3e5, 5e6] + s[:, None] * u + 0.0002 * s[:, None] ** 2 * n
    points = np.column_stack([flat, 20 + 0.0005 * s * s])
    for track in (fitted(points), fitted(points).turned(), fitted(points[::-1])):
        assert np.abs(track.local(points)[:, 1:]).max() < 1e-3
        ends = track.points(np.array(track.ends))
        assert np.abs(np.sort(ends, axis=0) - np.sort(points[[0, -1]], axis=0)).max() < 1e-3
        assert track.near(points, 1.0).all() and not track.near(np.add(points, [0, 0, 0.7]), 1.0).any()


def test_a_track_never_stands_up_and_never_swings_out() -> None:
    s = np.linspace(0, 100, 80)
    arch = fitted(np.column_stack([s, np.zeros(80), 20 - 0.001 * (s - 50) ** 2]))
    assert arch.z[2] == 0.0
    road = fitted(np.column_stack([s, 0.002 * s * s, 20 + 0.0001 * s * s]))
    assert road.y[2] == 0.0


def test_tracks_end_where_the_slope_breaks_and_go_on_over_gaps() -> None:
    feet = np.array([[0.0, 0.0, 30.0], [120.0, 0.0, 30.0], [235.0, 30.0, 28.0]])
    wires = [hang(tuple(a), tuple(b), 3.0) for a, b in pairwise(feet.tolist())]
    points = np.concatenate([sampled(wire, seed=k) for k, wire in enumerate(wires)])
    points = points[np.abs(points[:, 0] - 50) > 4]  # an eighth of the span without a point
    linear = find_linear(points, CONFIG.linear)
    found = find_tracks(linear, CONFIG)
    assert len(found) == 2
    for wire in wires:
        held = wire.points(np.array([0.0, wire.base.length_m]))
        middle = held[:, 0].mean()
        track = min(found, key=lambda track, middle=middle: abs(track.middle[0] - middle))
        ends = track.points(np.array(track.ends))
        ends = ends[np.argsort(ends[:, 0])]
        assert np.abs(ends - held).max() < 5.0  # past the support it soon departs by the gate
        assert 2 * track.z[2] * wire.plane[2] == pytest.approx(1, rel=0.1)
    assert meet(*find_spans(found, linear, CONFIG), CONFIG.span) == (True, False)


@pytest.mark.parametrize("offsets", [
    [(0.0, 0.0)],
    [(-0.2, 0.0), (0.2, 0.0)],
    [(-0.2, 0.02), (0.2, -0.02), (-0.2, 0.42), (0.2, 0.38)],
])  # fmt: skip
def test_the_wires_of_a_bundle_are_told_apart(offsets: list[tuple[float, float]]) -> None:
    random = np.random.default_rng(1)
    u, gate = np.array([1.0, 0.0]), np.full(2, 0.6)
    track = Parabola(np.zeros(2), u, np.zeros(3), np.zeros(3), (-100.0, 100.0), 0, gate)
    s = random.uniform(-100, 100, (len(offsets), 400))
    parts = [
        np.column_stack([t, y + 0.0004 * t, z + 0.00001 * t * t]) + 0.04 * random.normal(size=(400, 3))
        for t, (y, z) in zip(s, offsets, strict=True)
    ]
    wires = split(track, np.concatenate(parts), BundleConfig(), TrackConfig())
    assert len(wires) == len(offsets)
    owner = np.repeat(np.arange(len(offsets)), 400)
    for curve, mine in wires:
        k = np.bincount(owner[mine]).argmax()
        assert (owner[mine] == k).mean() > 0.99 and len(mine) > 390
        assert curve[0] == pytest.approx(np.array(offsets[k]), abs=0.02)  # at t = 0
        assert curve.sum(0) == pytest.approx(np.add(offsets[k], [0.04, 0.1]), abs=0.03)  # at t = 1, 100 m on


def test_cells_stand_for_their_points_however_many() -> None:
    points = np.random.default_rng(2).uniform(0, 3, (500, 3))
    cells = thinned(points, 0.5)
    assert len(cells) <= 216 and thinned(points[::-1], 0.5) == pytest.approx(cells)
    whole = thinned(points, 10.0)
    assert whole == pytest.approx(points.mean(0)[None])


def test_a_part_of_a_cloud_has_the_cells_of_the_whole() -> None:
    points = np.random.default_rng(2).uniform(-3, 3, (2000, 3))
    right = points[:, 0] > 0.37
    cells, part = thinned(points, 0.2), thinned(points[right], 0.2)
    inside = cells[:, 0] > 0.4
    assert part[part[:, 0] > 0.4] == pytest.approx(cells[inside], abs=1e-12)


def test_neither_leaves_nor_surfaces_are_lines() -> None:
    random = np.random.default_rng(3)
    leaves = random.uniform(0, 12, (6000, 3))
    roof = random.uniform([20, 0, 0], [32, 12, 0.12], (2000, 3))
    wire = sampled(hang((0.0, -9.0, 9.0), (60.0, -9.0, 9.0), 1.0))
    found = find_linear(np.concatenate([leaves, roof, wire]), CONFIG.linear)
    on_wire = np.abs(found.at[:, 1] + 9) < 0.5
    assert on_wire.sum() > 100 and (~on_wire).sum() < 0.02 * 8000
    assert len(pieces(found, CONFIG.linear)[0]) > 0.9 * on_wire.sum()
    assert np.abs(found.along[on_wire] @ [1.0, 0.0, 0.0]).min() > 0.9
