"""Green plants count though few images see them; grey things and what hangs in the air do not."""

from dataclasses import replace

import numpy as np
import pytest

from plnerf.errors import ConfigError
from plnerf.line.cloud import HIGH_VEGETATION, NO_WIRE, Cloud
from plnerf.survey.config_obstacles import GreenConfig
from plnerf.survey.green import green_plants

GREEN, GREY = (70, 110, 60), (120, 124, 118)


def cloud_of(xyz: np.ndarray, colour: tuple[int, int, int], seen: int = 1, past: int = 0) -> Cloud:
    n = len(xyz)
    label, rgb = np.full(n, HIGH_VEGETATION, np.uint8), np.tile(np.array(colour, np.uint8), (n, 1))
    images = {"seen": np.full(n, seen), "past": np.full(n, past)}
    return Cloud(xyz, label, np.full(n, NO_WIRE), rgb, np.full(n, 0.1), **images)


def tree() -> np.ndarray:
    """Its side that few images see, and its top."""
    random = np.random.default_rng(3)
    plan = random.normal(0, 0.3, (400, 2))
    return np.column_stack([plan, random.uniform(0, 5, 400)])


TOP = np.array([tree()[:, 2].argmax()])


def found(cloud: Cloud) -> bool:
    return bool(green_plants(cloud, TOP, GreenConfig())[0])


def test_a_green_tree_counts_and_a_pole_does_not() -> None:
    assert found(cloud_of(tree(), GREEN)) and not found(cloud_of(tree(), GREY))


def test_what_is_seen_past_as_often_as_seen_still_counts() -> None:
    assert found(cloud_of(tree(), GREEN, 1, 1)) and not found(cloud_of(tree(), GREEN, 1, 2))


def test_what_hangs_in_the_air_does_not_count() -> None:
    top = tree() * [1, 1, 0.1] + [0, 0, 5]
    assert not found(cloud_of(top, GREEN))
    both = np.concatenate([top, tree() * [1, 1, 0.1]])  # grass far below
    assert not found(cloud_of(both, GREEN))


def test_a_wire_before_green_is_not_green() -> None:
    """Its own points are, in part, what is behind it; most around it are grey."""
    cloud = cloud_of(tree(), GREY)
    some = np.array(cloud.rgb)
    some[::4] = GREEN
    assert not found(replace(cloud, rgb=some))


def test_without_colours_or_points_nothing_is_known() -> None:
    cloud = cloud_of(tree(), GREEN)
    assert not found(replace(cloud, rgb=None))
    assert len(green_plants(cloud, TOP[:0], GreenConfig())) == 0


def test_settings_that_make_no_sense_are_refused() -> None:
    with pytest.raises(ConfigError, match="least_below_m"):
        GreenConfig(least_below_m=4.0)
