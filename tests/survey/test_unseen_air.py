"""The nearest plant is an upper limit where images do not see the air that is nearer to the wire."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.support.catenary_surveys import cloud, fitted, line_of

from plnerf.findings import Finding
from plnerf.line.clearances import Clearances, Place, Requirement
from plnerf.line.cloud import GROUND, HIGH_VEGETATION, VEGETATION
from plnerf.line.files import read_survey, write_survey_json
from plnerf.line.frame import LineFrame
from plnerf.line.hang import hang
from plnerf.line.survey import Survey
from plnerf.report.nearest import by_need
from plnerf.report.rule_table import rule_tables
from plnerf.survey import unseen_air
from plnerf.survey.clearance import measure_clearances
from plnerf.survey.config_encroachments import EncroachmentConfig
from plnerf.survey.config_ground import ClearanceConfig, CoverageConfig
from plnerf.survey.config_rules import RulesConfig
from plnerf.survey.encroachments import find_encroachments
from plnerf.survey.rules import judge_rules
from plnerf.survey.stereo.depth import DepthMap
from plnerf.survey.stereo.stereo_views import View
from plnerf.survey.stereo.witnesses import Sight
from plnerf.survey.unseen_air import air_around, upper_limits, with_air_seen

CONFIG = CoverageConfig()
WIRE = hang((0.0, 0.0, 12.0), (60.0, 0.0, 12.0), 2.0)
TREE = np.random.default_rng(0).uniform([29.0, 4.0, 2.0], [31.0, 6.0, 10.0], (400, 3))
VIEW = View(np.eye(3), np.zeros(3), np.full(2, 10.0), np.full(2, 4.0), np.zeros(5), 8, 8)
SIGHTS = [Sight.of(VIEW, DepthMap(np.ones((8, 8)), np.full((8, 8), 0.1)))]


@pytest.fixture
def survey() -> Survey:
    x, y = np.meshgrid(np.arange(-5.0, 65.0, 0.5), np.arange(-12.0, 12.0, 0.5))
    ground = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    points = cloud({GROUND: ground, HIGH_VEGETATION: TREE})
    many = np.full(len(points.xyz), 9)
    points = replace(points, sigma_m=np.full(len(points.xyz), 0.1), seen=many, past=0 * many)
    frame = LineFrame(np.eye(3), 1.0, np.zeros(3), "m")
    whole = Survey(frame, (line_of([fitted(WIRE)]),), points, "test", from_images=True)
    return replace(whole, clearances=measure_clearances(whole, ClearanceConfig())[0])


def clearances(survey: Survey) -> Clearances:
    assert survey.clearances is not None
    return survey.clearances


def test_the_air_is_below_and_beside_the_wire_above_the_ground_and_counts_by_volume(survey: Survey) -> None:
    profile, (wire,) = clearances(survey).wires[0].profile, survey.wires
    for reach in (4.0, 20.0):
        places, weights = air_around(wire, profile, reach, CONFIG)
        s, off = wire.base.local(places)[:, 0], wire.base.local(places)[:, 1:]
        away = np.linalg.norm(off - wire.at(s), axis=1)
        assert away.max() < reach and away.max() > 0.9 * reach
        assert places[:, 2].min() > CONFIG.above_ground_m and (off[:, 1] <= wire.at(s)[:, 1] + 1e-9).all()
        np.testing.assert_allclose(weights, away, atol=1e-9)
        assert len(np.unique(s.round(6))) == CONFIG.most_stations
    unknown = replace(profile, ground_z=np.full_like(profile.ground_z, np.nan))
    places, _ = air_around(wire, unknown, 20.0, CONFIG)
    assert places[:, 2].min() < 10.0 - CONFIG.unknown_drop_m + 3.0


def _check_rules(survey: Survey, tmp: Path, *, at_most: bool) -> None:
    """A limit is clear of no rule about plants, falls short as any distance, and is none for the ground."""
    row = "[[row]]\nobject = '{}'\ndirection = 'radial'\ndistance = {}\nread_in = 'here'\n"
    text = "name = 'a rule'\nsource = 'a page'\ndate = '2026'\n"
    for kind, distance in (("vegetation", 1.0), ("vegetation", 30.0), ("ground", 1.0)):
        text += row.format(kind, distance).replace("radial", "vertical" if kind == "ground" else "radial")
    (tmp / "rule.toml").write_text(text)
    config = RulesConfig(matrix=tmp / "rule.toml", voltage_kv=110.0)
    report, _ = judge_rules(survey, ClearanceConfig(), config)
    assert report is not None
    verdicts = {one.rule: (one.verdict, one.at_most) for one in report.judged}
    assert verdicts[1] == (("not all seen", True) if at_most else ("clear", False))
    assert verdicts[2] == ("closer than required", at_most) and verdicts[3] == ("clear", False)
    judged = replace(survey, rules=report)
    write_survey_json(tmp / "rules.json", judged)
    again = read_survey(tmp / "rules.json").rules
    assert again is not None
    assert [one.at_most for one in again.judged] == [one.at_most for one in report.judged]
    words = json.dumps([str(table.rows) for table in rule_tables(judged)], ensure_ascii=False)
    assert ("≤" in words) == at_most == ("not all seen" in words)
    found = find_encroachments(judged, [], ClearanceConfig(), config, EncroachmentConfig())
    assert found is not None
    assert any("images do not show" in text for text in found.not_examined) == at_most


@pytest.mark.parametrize(("farthest", "at_most"), [(30.0, False), (1.0, True)])
def test_the_nearest_plant_is_at_most_so_far_where_less_than_half_was_seen(
    survey: Survey, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, farthest: float, at_most: bool
) -> None:
    """Images see what is within 30 m of the wire's axis in plan, or within 1."""

    def seen(points: np.ndarray, *_: object) -> tuple[np.ndarray, np.ndarray]:
        return np.zeros(len(points)), np.where(np.abs(points[:, 1]) < farthest, CONFIG.min_images, 0)

    monkeypatch.setattr(unseen_air, "witnesses", seen)
    found, findings = with_air_seen(clearances(survey), survey, SIGHTS, CONFIG)
    least = found.wires[0].least("vegetation")
    assert least is not None and least.air_seen is not None
    assert least.at_most == at_most == (least.air_seen < CONFIG.least_share) == bool(findings)
    asked = Requirement(1.0, ("vegetation",), "test", "test")
    kept = replace(survey, clearances=replace(found, requirement=asked))
    assert clearances(kept).verdict(least) == ("not all seen" if at_most else "clear")
    short = replace(asked, distance_m=30.0)
    assert replace(found, requirement=short).verdict(least) == "closer than required"
    (row,) = [one for one in by_need(kept) if one.to == "vegetation"]
    assert (row.sign, row.standing) == (("≤\u00a0", "doubtful") if at_most else ("", "kept"))
    _check_rules(kept, tmp_path, at_most=at_most)
    path = tmp_path / "survey.json"
    write_survey_json(path, kept)
    again = clearances(read_survey(path)).wires[0].least("vegetation")
    assert again is not None and (again.air_seen, again.at_most) == (least.air_seen, at_most)


def test_clouds_and_wires_without_plants_state_nothing_about_the_air(survey: Survey) -> None:
    assert with_air_seen(clearances(survey), survey, [], CONFIG) == (clearances(survey), [])
    bare = replace(clearances(survey).wires[0], places=dict.fromkeys(clearances(survey).wires[0].places, ()))
    none = replace(clearances(survey), wires=(bare,))
    found, findings = with_air_seen(none, survey, SIGHTS, CONFIG)
    assert found.wires == (bare,) and findings == []


def with_bush(survey: Survey, height_m: float, sigma_m: float) -> Survey:
    """Below the wire, nearer than the tree."""
    bush = np.random.default_rng(1).uniform([9.0, -1.0, height_m - 0.1], [11.0, 1.0, height_m], (50, 3))
    old = survey.cloud
    assert old.sigma_m is not None and old.seen is not None
    ground, tree = old.xyz[old.label == GROUND], TREE + np.array([0.0, 12.0, 0.0])
    points = cloud({GROUND: ground, HIGH_VEGETATION: tree, VEGETATION: bush})
    many = np.full(len(points.xyz), 9)
    sigma = np.where(points.label == VEGETATION, sigma_m, 0.1)
    return replace(survey, cloud=replace(points, sigma_m=sigma, seen=many, past=0 * many))


def test_what_does_not_stand_out_from_the_ground_is_no_plant_and_limits_the_others(
    survey: Survey, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A bush 9 m below the wire, and a tree 16 m beside it."""
    monkeypatch.setattr(unseen_air, "witnesses", lambda points, *_: (0 * points[:, 0], 0 * points[:, 0] + 9))

    def least_of(height_m: float, sigma_m: float) -> tuple[Place, list[Finding]]:
        there = with_bush(survey, height_m, sigma_m)
        before = measure_clearances(there, ClearanceConfig())[0]
        found, findings = with_air_seen(before, there, SIGHTS, CONFIG)
        least = found.wires[0].least("vegetation")
        assert least is not None
        return least, findings

    deviations = ClearanceConfig().obstacles.above_sigmas
    bush, findings = least_of(1.0, 0.9 / (deviations + 0.1))
    assert bush.class_code == VEGETATION and not bush.at_most and not findings
    tree, (finding,) = least_of(1.0, 1.0 / (deviations - 0.1))
    assert tree.class_code == HIGH_VEGETATION and tree.at_most
    assert tree.hidden_m == pytest.approx(bush.distance_m) and f"{bush.distance_m:.1f} m" in finding.text
    # What is hidden is as near as the bush at most: it is clear of less.
    between = bush.distance_m + 0.5
    for required_m, verdict in ((bush.distance_m - 0.5, "clear"), (between, "not all seen")):
        asked = Requirement(required_m, ("vegetation",), "test", "test")
        assert Clearances((), asked).verdict(tree) == verdict
    bare, _ = least_of(0.5, 0.01)  # a bush is one where its points are good
    assert bare.class_code == VEGETATION


def test_what_is_green_and_seen_by_too_few_limits_the_distances_too(survey: Survey) -> None:
    """Unless more images see past it, or it is grey."""
    there = with_bush(survey, 5.0, 0.05)  # in the air, 5.8 m below the wire
    cloud = there.cloud
    bush = cloud.label == VEGETATION
    assert cloud.seen is not None and cloud.past is not None
    for seen, past, rgb, at_most in (
        (2, 1, (60, 120, 50), True), (2, 2, (60, 120, 50), False), (2, 1, (90, 90, 90), False),
    ):  # fmt: skip
        colours = np.where(bush[:, None], rgb, (60, 120, 50)).astype(np.uint8)
        views = np.where(bush, seen, cloud.seen), np.where(bush, past, cloud.past)
        few = replace(cloud, seen=views[0], past=views[1], rgb=colours)
        found = measure_clearances(replace(there, cloud=few), ClearanceConfig())[0]
        least = found.wires[0].least("vegetation")
        assert least is not None and least.class_code == HIGH_VEGETATION and least.at_most == at_most
        assert least.hidden_m == (pytest.approx(5.8, abs=0.1) if at_most else 0.0)


def test_rules_take_a_limit_for_clear_of_what_nothing_hidden_reaches(survey: Survey, tmp_path: Path) -> None:
    there = with_bush(survey, 1.0, 0.25)
    found = measure_clearances(there, ClearanceConfig())[0]
    there = replace(there, clearances=found)
    least = found.wires[0].least("vegetation")
    assert least is not None and upper_limits(there) == {(1, 1): least.hidden_m}
    row = "[[row]]\nobject = 'vegetation'\ndirection = 'radial'\ndistance = {}\nread_in = 'here'\n"
    text = "name = 'a rule'\nsource = 'a page'\ndate = '2026'\n"
    rows = (least.hidden_m - 0.5, least.hidden_m + 0.5)
    (tmp_path / "rule.toml").write_text(text + "".join(row.format(required) for required in rows))
    config = RulesConfig(matrix=tmp_path / "rule.toml", voltage_kv=110.0)
    report, _ = judge_rules(there, ClearanceConfig(), config)
    assert report is not None
    assert {one.rule: one.verdict for one in report.judged} == {1: "clear", 2: "not all seen"}
    encroaching = find_encroachments(there, [], ClearanceConfig(), config, EncroachmentConfig())
    assert encroaching is None or not any("images do not show" in text for text in encroaching.not_examined)
