"""A surface's points get the class of what they lie on, and the ground is not that of a crown."""

from typing import Any

import numpy as np
import pytest

from plnerf.errors import ConfigError
from plnerf.line.hang import hang
from plnerf.line.line import Structure
from plnerf.survey.classify import classified, ground_of, standing_on
from plnerf.survey.config_ground import ClassifyConfig, OnWiresConfig
from plnerf.survey.on_wires import NONE, on_wires
from plnerf.survey.surface import Surface

CONFIG = ClassifyConfig()
ACROSS, DOWN = (0.0, 1.0, 0.0), (0.0, 0.0, -1.0)


def seen(xyz: np.ndarray, sigma_m: float, sight: tuple[float, float, float] = ACROSS) -> Surface:
    """Points that are all seen in one direction."""
    n = len(xyz)
    return Surface(xyz, np.zeros((n, 3), np.uint8), np.full(n, sigma_m), np.tile(sight, (n, 1)))


@pytest.mark.parametrize("kind", ["phase", "shield"])
def test_points_on_a_wire_are_its_own(kind: Any) -> None:
    wire = hang((-18.0, 0.0, 12.0), (18.0, 0.0, 12.0), 0.8, id=7, kind=kind)
    xy = np.random.default_rng(0).uniform(-18, 18, (4000, 2))
    floor = np.column_stack([xy, 0.02 * xy[:, 0]])
    on = wire.points(np.linspace(0, wire.base.length_m, 50))
    bush = np.random.default_rng(1).normal(size=(60, 3)) * 0.3 + [3, 5, 2.0]
    surface = seen(np.concatenate([floor, on, bush]), 0.02)
    none = np.zeros(len(surface.xyz), bool)
    ground = ground_of(surface, [wire], none, CONFIG)
    cloud, findings = classified(surface, ground, [wire], none, CONFIG)
    assert (cloud.wire[4000:4050] == 7).all() and (cloud.wire[:4000] == 0).all()
    assert (cloud.label[4000:4050] == (13 if kind == "shield" else 14)).all()
    assert (cloud.label[:4000] == 2).mean() > 0.99 and np.isin(cloud.label[4050:], (4, 5)).mean() > 0.9
    assert cloud.rgb is not None and cloud.sigma_m is not None
    assert [(one.kind, one.degree) for one in findings] == [("classes", "note")]


def test_points_of_structures_are_theirs_and_structures_stand_on_the_ground() -> None:
    xy = np.random.default_rng(0).uniform(-18, 18, (4000, 2))
    surface = seen(np.column_stack([xy, 0.02 * xy[:, 0]]), 0.02)
    of_structure = np.hypot(*(xy - [4, 4]).T) < 0.5
    ground = ground_of(surface, [], of_structure, CONFIG)
    cloud, _ = classified(surface, ground, [], of_structure, CONFIG)
    assert of_structure.any() and ((cloud.label == 15) == of_structure).all()
    sunk = Structure(3, np.array([4.0, 4.0, -3.0]), 15.0, 0.1, "given", name="T3")
    (tower,) = standing_on(ground, [sunk])
    assert tower.foot[2] == pytest.approx(0.08, abs=0.05) and tower.top[2] == 12.0
    assert (tower.id, tower.name) == (3, "T3")
    assert standing_on(None, [sunk]) == (sunk,)


def test_without_ground_nothing_is_classified_and_a_finding_says_so() -> None:
    surface = seen(np.random.default_rng(0).uniform(-18, 18, (50, 3)), 5.0, DOWN)
    none = np.zeros(50, bool)
    assert ground_of(surface, [], none, CONFIG) is None
    cloud, findings = classified(surface, None, [], none, CONFIG)
    assert (cloud.label == 1).all() and (cloud.sigma_m == 5.0).all()
    assert [(one.kind, one.degree) for one in findings] == [("classes", "harms")]


def test_a_crown_that_hides_the_ground_is_no_ground() -> None:
    random = np.random.default_rng(0)
    xy = random.uniform(-20, 20, (9000, 2))
    hidden = np.hypot(*(xy - [4, 4]).T) < 5
    floor = np.column_stack([xy[~hidden], random.normal(0, 0.03, (~hidden).sum())])
    crown = random.normal(size=(1500, 3)) * [1.2, 1.2, 0.9] + [4, 4, 4.0]
    surface = seen(np.concatenate([floor, crown]), 0.05)
    ground = ground_of(surface, [], np.zeros(len(surface.xyz), bool), CONFIG)
    assert ground is not None and abs(float(ground.above(np.array([[4.0, 4.0, 0.0]]))[0])) < 0.2
    fooled = ground_of(surface, [], np.zeros(len(surface.xyz), bool), ClassifyConfig(min_low_share=0.0))
    assert fooled is not None and abs(float(fooled.above(np.array([[4.0, 4.0, 0.0]]))[0])) > 0.2


@pytest.mark.parametrize(
    ("place", "half_m", "without"),
    [
        ((32.0, -10.0, 9.4), 0.2, ClassifyConfig(clear_beside_m=0.0)),
        ((37.0, -10.0, 10.5), 0.5, ClassifyConfig(clear_beyond_m=0.0)),
    ],
    ids=["an arm", "a structure that was not found"],
)
def test_what_is_at_the_height_of_a_wire_beyond_its_end_is_no_ground(
    place: tuple[float, float, float], half_m: float, without: ClassifyConfig
) -> None:
    """It is all that is seen there, far from all ground that is seen, and no higher than a hill might be."""
    random = np.random.default_rng(0)
    xy = random.uniform(-18, 2, (9000, 2))
    floor = np.column_stack([xy, random.normal(0, 0.03, len(xy))])
    thing = random.uniform(-half_m, half_m, (60, 3)) + place
    wire = hang((-5.0, -10.0, 10.0), (30.0, -10.0, 10.0), 0.8)
    surface, below = seen(np.concatenate([floor, thing]), 0.02), np.array([[*place[:2], 0.0]])
    none = np.zeros(len(surface.xyz), bool)
    ground = ground_of(surface, [wire], none, CONFIG)
    assert ground is not None and abs(float(ground.above(below)[0])) < 0.2
    fooled = ground_of(surface, [wire], none, without)
    assert fooled is not None and float(fooled.above(below)[0]) < -8.0


def test_ground_that_is_known_to_a_metre_only_is_no_crown() -> None:
    random = np.random.default_rng(0)
    xyz = np.column_stack([random.uniform(-20, 20, (9000, 2)), random.normal(0, 0.8, 9000)])
    surface = seen(xyz, 0.8, DOWN)
    assert ground_of(surface, [], np.zeros(len(xyz), bool), CONFIG) is not None


def test_points_of_the_ground_have_the_deviation_of_their_height() -> None:
    """A point may move along flat ground as it will: of its deviation only the upright part counts."""
    xy = np.random.default_rng(0).uniform(-18, 18, (4000, 2))
    sight = (0.0, 0.8, -0.6)
    surface = seen(np.column_stack([xy, np.zeros(4000)]), 0.5, sight)
    none = np.zeros(4000, bool)
    cloud, _ = classified(surface, ground_of(surface, [], none, CONFIG), [], none, CONFIG)
    assert (cloud.label == 2).all() and cloud.sigma_m == pytest.approx(0.3)


def test_what_is_smeared_along_a_line_of_sight_is_noise_and_not_the_wire_s() -> None:
    """A wire along x at y = 0; seen along y, points within three deviations around it are doubtful."""
    wires = [hang((-10.0, 0.0, 5.0), (10.0, 0.0, 5.0), 0.01), hang((-10.0, 0.0, 9.0), (10.0, 0.0, 9.0), 0.01)]
    y, z = np.array([0.0, 0.2, 1.0, 1.6, 0.0, 0.0]), np.array([5.0, 5.0, 5.0, 5.0, 6.0, 9.0])
    surface = seen(np.stack([0 * y, y, z], 1), 0.4)
    wire, doubtful = on_wires(surface, wires, OnWiresConfig())
    assert wire.tolist() == [0, 0, NONE, NONE, NONE, 1]
    assert doubtful.tolist() == [False, False, True, False, False, False]
    cloud, _ = classified(surface, None, wires, np.zeros(len(y), bool), CONFIG)
    assert cloud.label.tolist() == [14, 14, 18, 1, 1, 14]
    _, farther = on_wires(surface, wires, OnWiresConfig(reach_sigmas=4.0))
    assert farther.tolist() == [False, False, True, True, False, False]
    nowhere, none = on_wires(surface, [], OnWiresConfig())
    assert (nowhere == NONE).all() and not none.any()


@pytest.mark.parametrize(
    ("config", "wrong"),
    [
        (ClassifyConfig, {"max_sigma_m": 0.0}),
        (ClassifyConfig, {"crown_cells": 0}),
        (OnWiresConfig, {"near_m": 0.0}),
        (OnWiresConfig, {"max_reach_m": -1.0}),
    ],
)
def test_settings_that_classify_nothing_are_refused(config: Any, wrong: dict[str, Any]) -> None:
    (name,) = wrong
    with pytest.raises(ConfigError, match=name):
        config(**wrong)


def test_what_has_a_smooth_roof_is_a_building_and_a_crown_is_not() -> None:
    random = np.random.default_rng(2)
    xy = random.uniform(-20, 20, (20000, 2))
    house = (np.abs(xy[:, 0] - 6) < 5) & (np.abs(xy[:, 1]) < 4)
    floor = np.column_stack([xy[~house], np.zeros((~house).sum())])
    roof = np.column_stack([xy[house], 7.0 - 0.7 * np.abs(xy[house, 1])])
    wall = np.column_stack([random.uniform(1, 11, 800), np.full(800, -4.0), random.uniform(0.5, 4.2, 800)])
    crown = random.normal(size=(3000, 3))
    crown = crown / np.linalg.norm(crown, axis=1, keepdims=True) * random.uniform(2.0, 2.6, (3000, 1))
    parts = [floor, roof, wall, np.array([-9, 0, 6.0]) + crown]
    xyz = np.concatenate(parts)
    surface = seen(xyz + 0.05 * random.normal(size=xyz.shape), 0.08, DOWN)
    none = np.zeros(len(xyz), bool)
    cloud, _ = classified(surface, ground_of(surface, [], none, CONFIG), [], none, CONFIG)
    of = np.split(cloud.label, np.cumsum([len(part) for part in parts])[:-1])
    assert (of[1] == 6).mean() > 0.98 and (of[2] == 6).mean() > 0.95
    assert not (of[0] == 6).any() and not (of[3] == 6).any()
