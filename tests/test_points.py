"""Points on wires: what makes a line that several views see is kept, all else is dropped."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from plnerf.survey.points import FEWEST_POINTS, FEWEST_VIEWS, LEAST_SHARE, LONGER, first_thing, on_lines

RADIUS = 0.05
NOISE = 0.1 * RADIUS


def line(
    views: int, *, seed: int = 0, turn_deg: float = 0.0, count: int = 400
) -> tuple[np.ndarray, np.ndarray]:
    """A noisy line from -0.5 to 0.5, turned about z from the x axis; its points seen by views in turn."""
    rng = np.random.default_rng(seed)
    turn = np.deg2rad(turn_deg)
    along = np.array([np.cos(turn), np.sin(turn), 0])
    points = rng.uniform(-0.5, 0.5, (count, 1)) * along + rng.normal(0, NOISE, (count, 3))
    return points, rng.integers(0, views, count)


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


@pytest.mark.parametrize("views", range(1, FEWEST_VIEWS))
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
        whole = np.abs(both[:, 0]) < 0.5 - LONGER * RADIUS  # the neighbourhood is whole
        assert on_lines(both, views, RADIUS)[whole].mean() > 0.95


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
    few = np.linspace(0, RADIUS, FEWEST_POINTS - 1)[:, None] * [1, 0, 0]
    assert not on_lines(few, np.arange(len(few)), RADIUS).any()
    enough = np.linspace(0, RADIUS, FEWEST_POINTS)[:, None] * [1, 0, 0]
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


def test_the_first_thing_by_hand() -> None:
    t = torch.tensor([[0.0, 1.0, 2.0, 3.0, 5.0]])  # middles 0.5, 1.5, 2.5, 4
    for w, thick, depth, share in (
        ((0.1, 0.2, 0.5, 0.2), 0.0, 2.5, 0.5),  # the first two are too faint
        ((0.4, 0.0, 0.0, 0.6), 0.0, 0.5, 0.4),  # the wire, not the more solid ground behind it
        ((0.0, 0.2, 0.2, 0.6), 0.7, 2.0, 0.4),  # two halves of one thing
        ((0.1, 0.1, 0.1, 0.1), 0.0, 0.0, 0.0),  # nothing
    ):
        found, light = first_thing(t, torch.tensor([w]), torch.tensor([thick]))
        torch.testing.assert_close(found, torch.tensor([depth]))
        torch.testing.assert_close(light, torch.tensor([share]))


@given(st.integers(0, 1000))
@settings(deadline=None)
def test_the_first_thing_is_within_the_ray_and_gets_no_farther_with_more_light(seed: int) -> None:
    generator = torch.Generator().manual_seed(seed)
    t = 1 + torch.rand(6, 20, generator=generator).sort(1).values
    w = torch.rand(6, 19, generator=generator) ** 8
    w = w / w.sum(1, keepdim=True)
    depth, share = first_thing(t, w, torch.full((6,), 0.3))
    there = share > 0
    assert (share[there] >= LEAST_SHARE).all() and (share <= 1 + 1e-6).all()
    assert (depth[there] >= t[there, 0]).all() and (depth[there] <= t[there, -1]).all()
    assert (depth[~there] == 0).all()
    wider, more = first_thing(t, w, torch.full((6,), 9.0))
    assert (more > 0).all()  # all light is within reach of everything
    torch.testing.assert_close(wider, (w * (t[:, 1:] + t[:, :-1]) / 2).sum(1))
