"""Where images did not see the ground none is made up, and no height is stated that may be too great."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from tests.support.catenary_surveys import cloud, fitted, line_of

from plnerf.line.cloud import GROUND, HIGH_VEGETATION, UNCLASSIFIED
from plnerf.line.coverage import Coverage
from plnerf.line.files import read_survey, write_survey_json
from plnerf.line.frame import LineFrame
from plnerf.line.hang import hang
from plnerf.line.survey import Survey
from plnerf.survey.clearance import measure_clearances
from plnerf.survey.config_ground import ClearanceConfig, GroundConfig, GroundSectionConfig
from plnerf.survey.unseen_ground import may_be_less_m, without_unseen_ground

CONFIG, FILTER = GroundSectionConfig(), GroundConfig()
WIRE = hang((0.0, 0.0, 20.0), (100.0, 0.0, 20.0), 4.0)
"""16 m high at mid-span."""


def plain(low: float, high: float, z: float = 0.0) -> np.ndarray:
    """Ground along the wire, one point in a quarter of a square metre."""
    x, y = np.meshgrid(np.arange(low, high, 0.5), np.arange(-12.0, 12.0, 0.5))
    return np.column_stack([x.ravel(), y.ravel(), np.full(x.size, z)])


def survey_of(ground: np.ndarray) -> Survey:
    points = replace(cloud({GROUND: ground}), sigma_m=np.full(len(ground), 0.1))
    frame = LineFrame(np.eye(3), 1.0, np.zeros(3), "m")
    return Survey(frame, (line_of([fitted(WIRE)]),), points, "test", from_images=True)


def coverage(seen: tuple[float, ...]) -> Coverage:
    """Shares of ground of stretches as long as each other."""
    edges, one = np.linspace(0.0, 100.0, len(seen) + 1), np.ones(len(seen))
    return Coverage(1, 1, edges[:-1], edges[1:], np.array(seen), one, 5 * one, 0.5)


def test_what_is_lowest_below_stretches_that_were_not_seen_is_no_ground() -> None:
    """Bushes 3 m high; ground that continues what was seen stays ground."""
    survey = survey_of(np.concatenate([plain(-5.0, 25.0), plain(25.0, 50.0, 3.0), plain(50.0, 105.0)]))
    found, (finding,) = without_unseen_ground(survey, [coverage((1.0, 0.3, 1.0, 0.9))], CONFIG, FILTER)
    x, y, _ = survey.cloud.xyz.T
    doubted = (x >= 25.0) & (x < 50.0) & (np.abs(y) <= CONFIG.side_m)
    assert np.array_equal(found.cloud.label, np.where(doubted, UNCLASSIFIED, GROUND))
    assert f"{doubted.sum():,} points" in finding.what
    assert without_unseen_ground(survey, [coverage((1.0, 0.6))], CONFIG, FILTER) == (survey, ())
    lidar, bare = replace(survey, from_images=False), survey_of(plain(-5.0, 105.0))
    for other in (lidar, bare):
        assert without_unseen_ground(other, [coverage((1.0, 0.3, 1.0, 0.9))], CONFIG, FILTER) == (other, ())


def test_what_is_lowest_beyond_an_end_that_was_not_seen_is_no_ground() -> None:
    """The top of a structure that was not found, say."""
    top = plain(102.0, 108.0, 8.0)
    survey = survey_of(np.concatenate([plain(-5.0, 75.0), top[np.abs(top[:, 1]) <= 3.0]]))
    found, _ = without_unseen_ground(survey, [coverage((1.0, 1.0, 1.0, 0.0))], CONFIG, FILTER)
    assert np.array_equal(found.cloud.label, np.where(survey.cloud.xyz[:, 0] > 100.0, UNCLASSIFIED, GROUND))


def test_the_lowest_leaves_of_a_crown_are_no_ground_though_they_rise_no_more_than_ground_may() -> None:
    """A crown from 30 to 40 m hides the ground below; ground that is seen between its leaves stays ground."""
    ground, edge = plain(-5.0, 105.0), plain(30.0, 40.0)
    x, y, _ = ground.T
    hidden = (x > 32.0) & (x < 38.0) & (np.abs(y) < 3.0) & ~((x == 35.0) & (y == 0.0))
    edge = edge[np.abs(edge[:, 1]) < 3.0]
    edge[:, 2] = 0.5 * (5.0 - np.abs(edge[:, 0] - 35.0))
    leaves = edge + np.array([0.0, 0.0, 2.0])
    points = cloud({GROUND: np.concatenate([ground[~hidden], edge]), HIGH_VEGETATION: leaves})
    points = replace(points, sigma_m=np.full(len(points.xyz), 0.1))
    survey = replace(survey_of(ground), cloud=points)
    found, _ = without_unseen_ground(survey, [coverage((1.0, 1.0))], CONFIG, FILTER)
    left = found.cloud.xyz[found.cloud.label == GROUND]
    assert left[:, 2].max() < FILTER.near_m + 3.0 * CONFIG.unseen_slope + 1e-9
    assert (left == [35.0, 0.0, 0.0]).all(1).any()
    assert (found.cloud.label == HIGH_VEGETATION).sum() == len(leaves)
    lidar = replace(survey, from_images=False)
    assert without_unseen_ground(lidar, [coverage((1.0, 1.0))], CONFIG, FILTER) == (lidar, ())


def test_a_height_is_less_elsewhere_only_where_the_ground_may_be_as_near() -> None:
    s = np.linspace(0.0, 100.0, 201)
    z = WIRE.points(s)[:, 2]
    assert may_be_less_m(s, z - 0.0, z, CONFIG) == 0
    unknown = np.where((s > 40) & (s < 60), np.nan, z)  # below the lowest place
    assert 19 <= may_be_less_m(s, unknown, z, CONFIG) <= 20
    assert may_be_less_m(s, np.where(s < 8, np.nan, z), z, CONFIG) == 0  # high up at a structure
    far = np.where(s < 40, np.nan, z)  # 40 m from the nearest ground that is known, it may be 8 m higher
    assert may_be_less_m(s, far, z, CONFIG) > 30
    assert may_be_less_m(s, np.full(201, np.nan), z, CONFIG) == 0  # nothing is known, and nothing stated


def test_a_least_height_over_unseen_ground_is_not_stated_but_its_reason(tmp_path: Path) -> None:
    whole = survey_of(plain(-5.0, 105.0))
    (one,) = measure_clearances(whole, ClearanceConfig())[0].wires
    assert one.vertical is not None and one.no_vertical is None
    survey = survey_of(np.concatenate([plain(-5.0, 20.0), plain(80.0, 105.0)]))  # 60 m between are unknown
    found, findings = measure_clearances(survey, ClearanceConfig())
    (one,) = found.wires
    assert one.vertical is None and one.no_vertical is not None and "was not seen below 4" in one.no_vertical
    assert any("not stated of 1 of 1 wires (wire 1: ground was not seen" in text.what for text in findings)
    write_survey_json(tmp_path / "survey.json", replace(survey, clearances=found))
    again = read_survey(tmp_path / "survey.json").clearances
    assert again is not None and again.wires[0].no_vertical == one.no_vertical


def test_plants_whose_ground_is_hidden_are_no_ground() -> None:
    """Tops of bushes 3 m high are the lowest that is seen below the middle of the span."""
    bushes = plain(40.0, 60.0, 3.0)[::7]
    survey = survey_of(np.concatenate([plain(-5.0, 40.0), bushes, plain(60.0, 105.0)]))
    (before,) = measure_clearances(survey, ClearanceConfig())[0].wires
    assert before.vertical is not None and before.vertical.distance_m < 13.5  # they were the ground
    doubted, _ = without_unseen_ground(survey, [coverage((1.0, 1.0, 0.2, 1.0, 1.0))], CONFIG, FILTER)
    (one,) = measure_clearances(doubted, ClearanceConfig())[0].wires
    assert one.vertical is not None and abs(one.vertical.distance_m - 16.0) < 2 * one.vertical.sigma_m + 0.01
    place = one.least("other")
    assert place is not None and place.class_code == UNCLASSIFIED
