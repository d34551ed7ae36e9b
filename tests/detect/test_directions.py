"""Planes of lines in space agree on the lines' direction, whatever else lies about."""

from dataclasses import replace

import numpy as np
import pytest

from plnerf.detect.config_lines import DirectionConfig
from plnerf.detect.directions import given, strongest, vote
from plnerf.detect.line_maps import LineMaps, unit

CONFIG = DirectionConfig()
STEP = CONFIG.step_rad


def seen_lines(
    azimuth_deg: float, slope_deg: float, seed: int, *, count: int = 300, clutter: int = 3000
) -> LineMaps:
    """Pixels on lines of one direction at random places, before clutter of all directions."""
    rng = np.random.default_rng(seed)
    a, e = np.radians([azimuth_deg, slope_deg])
    d = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    rays = unit(rng.normal(size=(count, 3)))
    normals = unit(np.cross(rays, d) + 0.01 * rng.normal(size=(count, 3)))
    others = unit(rng.normal(size=(clutter, 3)))
    m = count + clutter
    return LineMaps(
        np.zeros(m, np.int64), np.arange(m), np.full(m, 0.9, np.float32),
        np.concatenate([normals, others]).astype(np.float32),
    )  # fmt: skip


def turn_between(a: float, b: float) -> float:
    """Of two azimuths of undirected lines."""
    return abs((a - b + np.pi / 2) % np.pi - np.pi / 2)


@pytest.mark.parametrize("azimuth_deg", [0.0, 37.0, 90.0, 178.9])
@pytest.mark.parametrize("slope_deg", [-14.0, 0.0, 8.0])
def test_the_direction_of_lines_has_most_votes(azimuth_deg: float, slope_deg: float) -> None:
    maps = seen_lines(azimuth_deg, slope_deg, seed=1)
    found = strongest(vote(maps, CONFIG), [], CONFIG)
    assert turn_between(found.azimuth_rad, np.radians(azimuth_deg)) <= 2 * STEP
    d = np.array([
        np.cos(np.radians(azimuth_deg)),
        np.sin(np.radians(azimuth_deg)),
        np.tan(np.radians(slope_deg)),
    ])
    assert abs(found.vector @ d) / np.linalg.norm(d) > np.cos(CONFIG.sag_rad + STEP)
    assert found.excess > 0.5


def test_clutter_alone_agrees_on_nothing() -> None:
    maps = seen_lines(0.0, 0.0, seed=2, count=0, clutter=20_000)
    assert strongest(vote(maps, CONFIG), [], CONFIG).excess < CONFIG.min_excess


def test_a_direction_that_was_searched_is_not_found_again() -> None:
    one, other = seen_lines(20.0, 0.0, seed=3, count=400), seen_lines(75.0, 3.0, seed=4)
    votes = vote(one, CONFIG) + vote(other, CONFIG)
    first = strongest(votes, [], CONFIG)
    second = strongest(votes, [first.azimuth_rad], replace(CONFIG, apart_rad=np.radians(12.0)))
    assert turn_between(first.azimuth_rad, np.radians(20.0)) <= 2 * STEP
    assert turn_between(second.azimuth_rad, np.radians(75.0)) <= 2 * STEP


def test_faint_lines_do_not_vote() -> None:
    maps = seen_lines(40.0, 0.0, seed=5)
    faint = LineMaps(maps.view, maps.pixel, 0.4 * maps.response, maps.normal)
    assert vote(faint, CONFIG).sum() == 0 and vote(maps, CONFIG).sum() > 0


def test_an_azimuth_that_is_known_gets_the_slope_that_lines_have() -> None:
    maps = seen_lines(60.0, 10.0, seed=6)
    told = given(np.radians(60.0), vote(maps, CONFIG), CONFIG)
    assert told.azimuth_rad == np.radians(60.0)
    assert np.degrees(told.slope_rad) == pytest.approx(10.0, abs=np.degrees(CONFIG.sag_rad))


def test_a_level_plane_says_nothing_of_the_azimuth() -> None:
    """It holds a direction of every azimuth: a thousand of them weigh no more than the lines do."""
    rng = np.random.default_rng(7)
    lines, normals = seen_lines(40.0, 0.0, seed=5, clutter=0), rng.normal([0, 0, 1], 0.02, (1000, 3))
    level = LineMaps(
        np.zeros(1000, np.int64), np.arange(1000), np.full(1000, 0.9, np.float32),
        unit(normals).astype(np.float32),
    )  # fmt: skip
    votes = vote(level, CONFIG).sum(1)
    assert votes.max() < 1.5 * votes.min()
    both = strongest(vote(level, CONFIG) + vote(lines, CONFIG), [], CONFIG)
    assert turn_between(both.azimuth_rad, np.radians(40.0)) <= 2 * STEP and both.excess > 0.5
