"""Points on wires: what makes a long line that several views see is kept, all else is dropped."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from plnerf.survey import collinear
from plnerf.survey.config_wires import CollinearConfig

RADIUS = 0.05
CONFIG = CollinearConfig()
NOISE = 0.1 * RADIUS


def on_lines(points: np.ndarray, view: np.ndarray, radius: float) -> np.ndarray:
    return collinear.on_lines(points, view, radius, CONFIG)


def in_long_pieces(points: np.ndarray, radius: float) -> np.ndarray:
    return collinear.in_long_pieces(points, radius, CONFIG)


def line(
    views: int, *, seed: int = 0, turn_deg: float = 0.0, count: int = 400
) -> tuple[np.ndarray, np.ndarray]:
    """A noisy line from -0.5 to 0.5, turned about z from the x axis; its points seen by views in turn."""
    rng = np.random.default_rng(seed)
    turn = np.deg2rad(turn_deg)
    along = np.array([np.cos(turn), np.sin(turn), 0])
    points = rng.uniform(-0.5, 0.5, (count, 1)) * along + rng.normal(0, NOISE, (count, 3))
    return points, rng.integers(0, views, count)


@pytest.mark.slow
def test_a_line_seen_from_three_views_is_kept() -> None:
    assert on_lines(*line(3), RADIUS).mean() > 0.95


@pytest.mark.parametrize("turn_deg", [0.0, 15.0, -20.0])
def test_a_line_may_turn_a_little_and_the_sign_of_the_axis_does_not_count(turn_deg: float) -> None:
    points, view = line(5, turn_deg=turn_deg)
    keep = on_lines(points, view, RADIUS)
    assert keep.mean() > 0.9
    np.testing.assert_array_equal(on_lines(points * [-1, 1, 1], view, RADIUS), keep)


@pytest.mark.parametrize("turn_deg", [45.0, 60.0, 90.0])
def test_a_line_across_is_dropped(turn_deg: float) -> None:
    assert on_lines(*line(5, turn_deg=turn_deg), RADIUS).mean() < 0.02


@pytest.mark.parametrize("views", range(1, CONFIG.min_views))
def test_a_line_that_few_views_see_is_dropped(views: int) -> None:
    assert not on_lines(*line(views), RADIUS).any()


def test_an_upright_post_a_plane_and_a_cloud_are_dropped() -> None:
    rng = np.random.default_rng(1)
    view = rng.integers(0, 6, 4000)
    post = np.stack([*rng.normal(0, NOISE, (2, 4000)), rng.uniform(-0.5, 0.5, 4000)], 1)
    plane = np.stack([*rng.uniform(-0.5, 0.5, (2, 4000)), rng.normal(0, NOISE, 4000)], 1)
    wall = plane[:, [0, 2, 1]]
    cloud = rng.normal(0, 0.1, (4000, 3))
    for points in (post, plane, wall, cloud):
        assert on_lines(points, view, RADIUS).mean() < 0.03


def test_twins_are_kept_both_but_for_their_ends() -> None:
    points, view = line(5)
    points = points * [1, 0.4, 0.4]  # as clear as twins must be to be told apart
    for apart in ([0, 0.8 * RADIUS, 0], [0, 0, 0.8 * RADIUS]):
        both, views = np.concatenate([points, points + apart]), np.concatenate([view, view])
        whole = np.abs(both[:, 0]) < 0.5 - CONFIG.elongation * RADIUS  # the neighbourhood is whole
        assert on_lines(both, views, RADIUS)[whole].mean() > 0.95


def test_of_twins_the_one_that_is_seen_less_is_kept_too() -> None:
    points, view = line(5, count=1200)
    points = points * [1, 0.4, 0.4]
    few = slice(0, 240)
    both = np.concatenate([points, points[few] + np.array([0, 0.8 * RADIUS, 0])])
    keep = on_lines(both, np.concatenate([view, view[few]]), RADIUS)
    whole = np.abs(both[:, 0]) < 0.5 - CONFIG.elongation * RADIUS
    assert keep[whole & (np.arange(len(both)) >= 1200)].mean() > 0.9


def test_clumps_are_dropped_though_they_are_longer_along_the_span() -> None:
    """All of a clump lies near the line through each of its points."""
    rng = np.random.default_rng(2)
    middle = np.repeat(np.arange(20)[:, None] * [10 * RADIUS, 0, 0], 40, axis=0)
    points = middle + rng.normal(0, 0.05 * RADIUS, (800, 3)) * [2, 1, 1]
    assert on_lines(points, rng.integers(0, 6, 800), RADIUS).mean() < 0.03


def test_points_alone_are_dropped() -> None:
    x = np.arange(40.0)
    alone = np.stack([x, 0 * x, 0 * x], 1)
    assert not on_lines(alone, np.arange(40) % 5, RADIUS).any()
    few = np.linspace(0, RADIUS, CONFIG.min_points - 1)[:, None] * [1, 0, 0]
    assert not on_lines(few, np.arange(len(few)), RADIUS).any()
    enough = np.linspace(0, 5 * RADIUS, CONFIG.min_points)[:, None] * [1, 0, 0]
    assert on_lines(enough, np.arange(len(enough)), 2 * RADIUS).all()


def test_what_is_far_away_changes_nothing() -> None:
    points, view = line(4)
    rng = np.random.default_rng(2)
    clutter = rng.uniform(-0.5, 0.5, (3000, 3)) + np.array([0, 0, 3])
    together = on_lines(
        np.concatenate([clutter, points]), np.concatenate([rng.integers(0, 4, 3000), view]), RADIUS
    )
    np.testing.assert_array_equal(together[3000:], on_lines(points, view, RADIUS))


@given(st.integers(0, 100), st.floats(0.1, 10))
@settings(max_examples=8, deadline=None)
def test_order_units_and_place_do_not_count(seed: int, scale: float) -> None:
    points, view = line(3, seed=seed, count=120)
    points = np.concatenate([points, np.random.default_rng(seed).uniform(-0.5, 0.5, (200, 3))])
    view = np.concatenate([view, np.arange(200) % 3])
    keep = on_lines(points, view, RADIUS)
    order = np.random.default_rng(seed).permutation(len(points))
    np.testing.assert_array_equal(on_lines(points[order], view[order], RADIUS), keep[order])
    moved = scale * (points + np.array([1.0, -2.0, 3.0]))
    assert (on_lines(moved, view, scale * RADIUS) == keep).mean() > 0.99  # but for rounding


def test_a_piece_that_is_long_enough_is_kept_whole_and_a_shorter_one_dropped_whole() -> None:
    for length, kept in ((1.05 * CONFIG.min_length, True), (0.95 * CONFIG.min_length, False)):
        x = np.linspace(0, length * RADIUS, 400)
        piece = np.stack([x, 0.1 * x, -0.05 * x], 1)  # askew, climbing
        assert (in_long_pieces(piece, RADIUS) == kept).all()


def test_pieces_apart_do_not_make_a_long_one_and_small_gaps_do_not_part_it() -> None:
    x = np.linspace(0, 2 * CONFIG.min_length * RADIUS, 2000)
    line = np.stack([x, 0 * x, 0 * x], 1)
    for gap, whole in ((0.7, True), (1.3, False)):
        hole = np.abs(x - x.mean()) * 2 < gap * CONFIG.max_gap * CONFIG.elongation * RADIUS
        ends = np.abs(x - x.mean()) < 0.55 * CONFIG.min_length * RADIUS
        assert (in_long_pieces(line[ends & ~hole], RADIUS) == whole).all()
    beside = np.concatenate([line[:800], line[800:1600] + np.array([0, 1.3 * CONFIG.max_gap * RADIUS, 0])])
    assert not in_long_pieces(beside, RADIUS).any()


@given(st.integers(0, 100))
@settings(max_examples=10, deadline=None)
def test_pieces_do_not_depend_on_the_order_and_points_twice_change_nothing(seed: int) -> None:
    rng = np.random.default_rng(seed)
    parts = [
        rng.uniform(0, length, (60, 1)) * [1, 0, 0] + rng.uniform(-1, 1, 3)
        for length in rng.uniform(0.5, 1.5, 6) * CONFIG.min_length * RADIUS
    ]
    points = np.concatenate(parts)
    keep = in_long_pieces(points, RADIUS)
    order = rng.permutation(len(points))
    np.testing.assert_array_equal(in_long_pieces(points[order], RADIUS), keep[order])
    np.testing.assert_array_equal(in_long_pieces(np.repeat(points, 2, 0), RADIUS), np.repeat(keep, 2))


def test_no_points_are_none() -> None:
    none = np.zeros((0, 3))
    assert len(in_long_pieces(none, RADIUS)) == len(on_lines(none, np.zeros(0, int), RADIUS)) == 0
