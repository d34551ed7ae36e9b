"""Pairs of views agree on the direction of lines in space, whatever else lies about."""

from dataclasses import replace

import numpy as np
import pytest
from tests.support.drawn import pinhole_cameras

from plnerf.detect.config_lines import DirectionConfig
from plnerf.detect.directions import (
    Direction,
    Votes,
    bins,
    flown,
    given,
    pairs_of_views,
    stands_out,
    strongest,
    vote,
)
from plnerf.detect.line_maps import unit
from plnerf.detect.segments import Segments
from plnerf.detect.views import Views, views_of

CONFIG = DirectionConfig()
STEP = CONFIG.step_rad


def around(seed: int, count: int = 12) -> Views:
    """Cameras about the origin, 10 away, looking at it."""
    centres = 10 * unit(np.random.default_rng(seed).normal(size=(count, 3)))
    return views_of(pinhole_cameras(centres, np.zeros((count, 3))))


def looking(centres: np.ndarray) -> Views:
    return views_of(pinhole_cameras(centres, centres + np.array([1.0, 0.0, 0.0])))


def vector(azimuth_deg: float, slope_deg: float) -> np.ndarray:
    a, e = np.radians([azimuth_deg, slope_deg])
    return np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])


def segments(views: Views, lines: np.ndarray, px: float = 40.0) -> Segments:
    """What each view shows of lines (k, 2, 3) between two points, all of them, to half a pixel."""
    rng = np.random.default_rng(0)
    rays = lines[None] - views.centre[:, None, None]
    rays = rays / np.linalg.norm(rays, axis=3, keepdims=True) + 0.002 * rng.normal(size=(*rays.shape,))
    ends = rays.reshape(-1, 2, 3)
    owner = np.repeat(np.arange(len(views.R)), len(lines))
    return Segments(owner, unit(np.cross(ends[:, 0], ends[:, 1])), ends, np.full(len(owner), px))


def parallel(azimuth_deg: float, slope_deg: float, count: int = 4, seed: int = 1) -> np.ndarray:
    middle = np.random.default_rng(seed).uniform(-2, 2, (count, 1, 3))
    return middle + 2.0 * np.array([[-1.0], [1.0]]) * vector(azimuth_deg, slope_deg)


def clutter(count: int, seed: int = 2) -> np.ndarray:
    """Short lines of any direction."""
    rng = np.random.default_rng(seed)
    return rng.uniform(-3, 3, (count, 1, 3)) + np.array([[-0.3], [0.3]]) * unit(rng.normal(size=(count, 3)))[
        :, None
    ]


def turn_between(a: float, b: float) -> float:
    """Of two azimuths of undirected lines."""
    return abs((a - b + np.pi / 2) % np.pi - np.pi / 2)


@pytest.mark.parametrize("azimuth_deg", [0.0, 37.0, 90.0, 178.9])
@pytest.mark.parametrize("slope_deg", [-14.0, 0.0, 8.0])
def test_the_direction_of_lines_has_most_votes(azimuth_deg: float, slope_deg: float) -> None:
    views = around(1)
    shown = segments(views, np.concatenate([parallel(azimuth_deg, slope_deg), clutter(12)]))
    found = strongest(vote(shown, views, CONFIG), [], CONFIG)
    assert turn_between(found.azimuth_rad, np.radians(azimuth_deg)) <= STEP
    assert abs(found.vector @ vector(azimuth_deg, slope_deg)) > np.cos(CONFIG.sag_rad + STEP)
    assert found.excess > 10 * CONFIG.min_excess


@pytest.mark.parametrize("count", [12, 150])
def test_the_footprint_of_images_follows_from_what_pairs_show(count: int) -> None:
    """Lines 4 long that are 40 px long in the images, however many views of them there are."""
    views = around(1, count)
    votes = vote(segments(views, np.concatenate([parallel(37.0, 0.0), clutter(6)])), views, CONFIG)
    w, h = views.sizes[0]
    for found in (strongest(votes, [], CONFIG), given(np.radians(37.0), votes, CONFIG)):
        assert found.footprint == pytest.approx(4.0 / 40 * np.sqrt(w * h), rel=0.1)
    assert given(0.0, vote(segments(views, clutter(0)), views, CONFIG), CONFIG).footprint == 0


def test_cameras_fly_along_a_direction_where_they_move_far_along_it() -> None:
    """To and fro, on two sides of a line; about one; not at all."""
    rng, u, aside = np.random.default_rng(4), vector(125.0, 0.0), vector(35.0, 0.0)
    there = np.linspace(-9, 9, 19)[:, None] * u + 0.2 * rng.normal(size=(19, 3))
    azimuth = flown(looking(np.concatenate([there - 8 * aside, there[::-1] + 8 * aside])), CONFIG)
    assert azimuth is not None and turn_between(azimuth, np.radians(125.0)) < np.radians(3.0)
    turns = np.linspace(0, 2 * np.pi, 24)[:, None]
    assert flown(looking(9 * (np.cos(turns) * u + np.sin(turns) * aside)), CONFIG) is None
    assert flown(looking(np.zeros((5, 3))), CONFIG) is None


def test_a_direction_that_was_searched_is_not_found_again() -> None:
    views = around(3)
    shown = segments(views, np.concatenate([parallel(20.0, 0.0, 5), parallel(75.0, 3.0, 3)]))
    votes = vote(shown, views, CONFIG)
    first = strongest(votes, [], CONFIG)
    second = strongest(votes, [first.azimuth_rad], replace(CONFIG, apart_rad=np.radians(12.0)))
    assert turn_between(first.azimuth_rad, np.radians(20.0)) <= STEP
    assert turn_between(second.azimuth_rad, np.radians(75.0)) <= STEP


def test_a_direction_is_no_other_ones_flank() -> None:
    """Views that look along their own way vote for all directions about it: none of them is one more."""
    azimuths, slopes = bins(CONFIG)
    wide, narrow = ((np.degrees(azimuths) - at) / width for at, width in ((50.0, 15.0), (120.0, 2.0)))
    pixels = np.zeros((len(azimuths), len(slopes)))
    pixels[:, len(slopes) // 2] = 1000 * np.exp(-(wide**2) / 2) + 300 * np.exp(-(narrow**2) / 2)
    votes = Votes(pixels, pixels, 0 * pixels, np.zeros((1, len(azimuths))))
    first = strongest(votes, [], CONFIG)
    second = strongest(votes, [first.azimuth_rad], CONFIG)
    assert turn_between(first.azimuth_rad, np.radians(50.0)) <= STEP
    assert turn_between(second.azimuth_rad, np.radians(120.0)) <= STEP


def test_what_two_views_do_not_show_together_does_not_vote() -> None:
    """One line in one half of the views and another, farther along, in the other half."""
    views = around(5, 6)
    here, there = segments(views, parallel(30.0, 0.0, 1)), segments(views, parallel(30.0, 0.0, 1) + 9.0)
    half = here.owner < 3
    mixed = Segments(*(np.concatenate([a[half], b[~half]]) for a, b in zip(here, there, strict=True)))
    apart = vote(mixed, views, CONFIG).pixels.sum()
    assert 0 < apart <= vote(here, views, CONFIG).pixels.sum() / 2
    assert vote(here.of(np.zeros(6, bool)), views, CONFIG).pixels.sum() == 0


def test_planes_that_meet_at_a_small_angle_say_less() -> None:
    """Of one line from two places: far apart, near to each other, and so near that they say nothing."""
    line = np.array([[[-1.0, 0, 0], [1.0, 0, 0]]])
    votes = []
    for angle in (0.6, 0.25, 0.05):
        centres = np.array([[0.3, 10 * np.cos(a), 10 * np.sin(a)] for a in (0.0, angle)])
        views = views_of(pinhole_cameras(centres, np.zeros((2, 3))))
        exact = line[None] - views.centre[:, None, None]
        ends = exact.reshape(-1, 2, 3)
        shown = Segments(np.arange(2), unit(np.cross(ends[:, 0], ends[:, 1])), ends, np.full(2, 40.0))
        votes.append(vote(shown, views, CONFIG).pixels.sum())
    assert votes[0] == pytest.approx(40.0)
    assert votes[1] == pytest.approx(40.0 * np.sin(0.25) / CONFIG.full_angle) and votes[2] == 0


def test_a_direction_needs_votes_of_its_own_and_a_share_of_the_first_ones() -> None:
    def of(excess: float) -> Direction:
        return Direction(0.0, 0.0, excess)

    least, share = CONFIG.min_excess, CONFIG.min_share
    assert stands_out(of(1.01 * least), None, CONFIG) and not stands_out(of(0.99 * least), None, CONFIG)
    strong, weak = of(2 * least / share), of(2 * least)
    assert stands_out(of(1.01 * share * strong.excess), strong, CONFIG)
    assert not stands_out(of(0.99 * share * strong.excess), strong, CONFIG)
    assert not stands_out(of(0.99 * least), weak, CONFIG)


def test_views_are_compared_once_with_those_nearby_and_with_few_of_the_others() -> None:
    centres = np.stack([np.arange(300.0), np.zeros(300), np.full(300, 5.0)], 1)
    views = views_of(pinhole_cameras(centres, centres + np.array([0.0, 1.0, -1.0])))
    near, spread = pairs_of_views(views, 64)
    for pairs in (near, spread):
        assert not np.tril(pairs).any() and 300 * 64 / 2 <= pairs.sum() <= 300 * 64
    apart = np.subtract(*np.nonzero(near)[::-1])
    assert apart.max() == 64 and near[0, 1:65].all()
    apart = np.subtract(*np.nonzero(spread)[::-1])
    share = np.bincount(apart) / (300 - np.arange(apart.max() + 1))  # of the views that are so far apart
    assert (share[1:5] == 1).all() and share[1:50].mean() > 2 * share[100:200].mean() > 0
    few = views_of(pinhole_cameras(centres[:9], centres[:9] + np.array([0.0, 1.0, -1.0])))
    assert (pairs_of_views(few, 64).sum((1, 2)) == 9 * 8 / 2).all()


def test_an_azimuth_that_is_known_gets_the_slope_that_lines_have() -> None:
    views = around(6)
    told = given(np.radians(60.0), vote(segments(views, parallel(60.0, 10.0)), views, CONFIG), CONFIG)
    assert told.azimuth_rad == np.radians(60.0)
    assert np.degrees(told.slope_rad) == pytest.approx(10.0, abs=np.degrees(CONFIG.sag_rad))
