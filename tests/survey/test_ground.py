"""The ground is found under what stands on it, through holes and errors; heights above it are exact."""

from typing import Any

import numpy as np
import pytest

from plnerf.errors import ConfigError
from plnerf.survey.config_ground import GroundConfig
from plnerf.survey.ground import Ground, find_ground, settled, vegetation

EXTENT = 120.0
CONFIG = GroundConfig()


def terrain(xy: np.ndarray) -> np.ndarray:
    return 4 * np.sin(xy[:, 0] / 35) + 3 * np.cos(xy[:, 1] / 45) + 0.25 * xy[:, 0] - 0.1 * xy[:, 1]


@pytest.fixture(scope="module")
def cloud() -> tuple[np.ndarray, np.ndarray]:
    """A hillside with trees, a house, a pond without points, errors below ground; and what is ground."""
    random = np.random.default_rng(0)
    xy = random.uniform(0, EXTENT, (40_000, 2))
    xy = xy[np.hypot(*(xy - [80, 40]).T) > 12]  # the pond
    house = (np.abs(xy - [30, 80]) < [6, 9]).all(1)
    z = terrain(xy) + np.where(house, 7.0, 0.02 * random.normal(size=len(xy)))
    parts, ground = [np.column_stack([xy, z])], [~house]
    for middle in random.uniform(5, EXTENT - 5, (60, 2)):
        if np.hypot(*(middle - [80, 40])) < 16 or (np.abs(middle - [30, 80]) < 14).all():
            continue
        leaves = middle + random.normal(size=(150, 2))
        parts.append(np.column_stack([leaves, terrain(leaves) + random.uniform(2, 12, 150)]))
        ground.append(np.zeros(150, bool))
    low = random.uniform(0, EXTENT, (25, 2))
    parts.append(np.column_stack([low, terrain(low) - random.uniform(3, 20, 25)]))
    ground.append(np.zeros(25, bool))
    return np.concatenate(parts), np.concatenate(ground)


def test_the_ground_is_distinguished_from_what_stands_on_it(cloud: tuple[np.ndarray, np.ndarray]) -> None:
    points, truth = cloud
    ground = find_ground(points, CONFIG)
    assert ground is not None
    mine = np.abs(ground.above(points)) <= CONFIG.near_m
    assert mine[truth].mean() > 0.97 and (~mine[~truth]).mean() > 0.99
    xy = np.random.default_rng(1).uniform(2, EXTENT - 2, (3000, 2))
    off = np.abs(ground.below(xy) - terrain(xy))
    assert np.median(off) < 0.15 and np.percentile(off, 99) < 0.8  # cells are as low as their lowest point


def test_the_ground_of_a_noisy_cloud_is_where_most_of_its_points_are(
    cloud: tuple[np.ndarray, np.ndarray],
) -> None:
    """The lowest of many points lies three deviations low; cells without points are lifted as their
    neighbours are."""
    random = np.random.default_rng(3)
    xy = random.uniform(0, EXTENT, (400_000, 2))
    noisy = np.column_stack([xy, terrain(xy) + 0.1 * random.normal(size=len(xy))])
    clean, of_ground = cloud
    points = np.concatenate([noisy[np.hypot(*(xy - [80, 40]).T) > 12], clean[~of_ground]])
    ground = find_ground(points, CONFIG)
    assert ground is not None
    near_m = np.full(len(points), 0.3)
    at = random.uniform(2, EXTENT - 2, (3000, 2))
    dry = np.hypot(*(at - [80, 40]).T) > 13
    low, off = (one.below(at) - terrain(at) for one in (ground, settled(ground, points, near_m, 2)))
    assert np.median(low) < -0.2 and np.abs(np.median(off)) < 0.01
    assert np.abs(np.median(off[~dry]) - np.median(low[~dry])) > 0.15
    assert np.percentile(np.abs(off[dry]), 95) < 0.1
    far = settled(ground, points + np.array([0, 0, 50.0]), near_m, 2)
    assert np.array_equal(far.z, ground.z)


def test_a_plane_is_a_plane_between_cells_and_across_holes() -> None:
    """Of each cell the lowest point counts, which here lies half a cell from its middle: a constant."""
    x, y = np.meshgrid(np.arange(60.0), np.arange(40.0))
    points = np.column_stack([x.ravel(), y.ravel(), (0.3 * x - 0.2 * y + 7).ravel()])
    hole = (np.abs(points[:, :2] - [30, 20]) < 8).all(1)
    ground = find_ground(points[~hole], CONFIG)
    assert ground is not None
    inside = np.random.default_rng(2).uniform([1, 1], [59, 39], (500, 2))
    off = ground.below(inside) - (0.3 * inside[:, 0] - 0.2 * inside[:, 1] + 7)
    assert np.ptp(off) < 1e-9 and off.mean() == pytest.approx(-0.5 * 0.3 + 0.5 * 0.2)
    above = ground.above(np.column_stack([inside, np.full(500, 50.0)]))
    assert above == pytest.approx(50 - ground.below(inside), abs=1e-12)


def test_holes_go_on_from_one_rim_to_the_other() -> None:
    """Not in steps, as the nearest known cell would: under a barn on a bank the ground climbs."""
    x, y = np.meshgrid(np.arange(60.0), np.arange(40.0))
    bank = np.clip(0.2 * (x - 20), 0.0, 4.0)  # bends at both sides of the hole
    points = np.column_stack([x.ravel(), y.ravel(), bank.ravel()])
    hole = (points[:, 0] >= 20) & (points[:, 0] <= 40) & (np.abs(points[:, 1] - 20) < 12)
    ground = find_ground(points[~hole], CONFIG)
    assert ground is not None
    inside = np.column_stack([np.arange(23.0, 39.0), np.full(16, 20.0)])
    assert ground.below(inside) == pytest.approx(0.2 * (inside[:, 0] - 20.5), abs=0.25)


def test_the_edge_of_a_canopy_that_hides_the_ground_behind_it_is_no_ground() -> None:
    """It rises in small steps, and nothing is seen beyond it."""
    x, y = np.meshgrid(np.arange(-25.0, 25.0, 0.4), np.arange(-20.0, 6.0, 0.4))
    crowns = np.clip((y + np.sin(x)) * 0.75, 0.0, 5.0)
    shown = (crowns < 0.3) | (crowns > 0.9)
    points = np.column_stack([x[shown], y[shown], crowns[shown]])
    ground = find_ground(points, GroundConfig())
    assert ground is not None
    under = np.column_stack([np.linspace(-20, 20, 30), np.full(30, 4.5)])
    assert ground.below(under).max() < 2.1  # of crowns of 2.6 to 4.1 m; by single steps up to 2.7


def test_moving_the_cloud_moves_the_ground(cloud: tuple[np.ndarray, np.ndarray]) -> None:
    points, _ = cloud
    shift = np.array([250_000.0, 5_800_000.0, 30.0])
    one, other = find_ground(points, CONFIG), find_ground(points + shift, CONFIG)
    assert one is not None and other is not None
    assert other.above(points + shift) == pytest.approx(one.above(points), abs=0.05)


def test_a_part_of_a_cloud_has_the_cells_of_the_whole(cloud: tuple[np.ndarray, np.ndarray]) -> None:
    """So that neighbouring tiles, each cut where it may be, state one ground where they overlap."""
    points, _ = cloud
    part = points[(points[:, 0] > 7.3) & (points[:, 1] > 3.9)]
    one, other = find_ground(points, CONFIG), find_ground(part, CONFIG)
    assert one is not None and other is not None
    inside = np.random.default_rng(4).uniform([30, 30], EXTENT - 2, (1000, 2))
    assert np.median(np.abs(one.below(inside) - other.below(inside))) < 1e-9


def test_far_coordinates_keep_millimetres() -> None:
    ground = Ground(np.array([250_000.5, 5_800_000.5]), 1.0, np.arange(12.0).reshape(3, 4))
    at = np.array([[250_000.5, 5_800_000.5], [250_001.25, 5_800_001.0], [250_003.5, 5_800_002.5], [0.0, 0.0]])
    assert ground.below(at) == pytest.approx([0.0, 2.75, 11.0, 0.0], abs=1e-6)


def test_lines_alone_are_no_ground() -> None:
    s = np.linspace(0, 200, 3000)
    hang = 20 + (s - 100) ** 2 / 3000
    wires = [np.column_stack([s, np.full_like(s, y), hang]) for y in (-5.0, 0.0, 0.4, 5.0)]
    assert find_ground(np.concatenate(wires), CONFIG) is None
    assert find_ground(np.zeros((1, 3)), CONFIG) is None


def test_memory_is_bounded_by_cells_that_grow() -> None:
    random = np.random.default_rng(3)
    xy = random.uniform(0, 60_000, (100_000, 2))
    xy = np.concatenate([xy, random.uniform(0, 10_000, (100_000, 2))])
    ground = find_ground(np.column_stack([xy, np.zeros(len(xy))]), GroundConfig(max_cells=10_000))
    assert ground is not None and ground.z.size < 1.1e4 and np.abs(ground.z).max() < 1e-9


def test_vegetation_is_banded_by_height() -> None:
    above = np.array([0.31, 0.49, 0.5, 1.99, 2.0, 30.0])
    assert vegetation(above, CONFIG).tolist() == [3, 3, 4, 4, 5, 5]
    tall = GroundConfig(low_vegetation_m=1.0, high_vegetation_m=20.0)
    assert vegetation(above, tall).tolist() == [3, 3, 3, 4, 4, 5]


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"cell_m": 0.0}, "needs cell_m > 0"),
        ({"max_cells": 0}, "max_cells >= 1"),
        ({"pit_rank": 49}, "pit_rank must be from 0 to 48"),
        ({"windows": (5, 3)}, "windows must be positive and rise"),
        ({"near_m": -0.1}, "near_m >= 0"),
        ({"low_vegetation_m": 3.0}, "low_vegetation_m <= high_vegetation_m"),
    ],
)
def test_settings_that_make_no_ground_are_refused(wrong: dict[str, Any], said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        GroundConfig(**wrong)
