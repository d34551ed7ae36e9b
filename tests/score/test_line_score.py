"""A survey of many spans scored: each true span once, supports along the line, swing, what images show."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.support.catenary_surveys import corridor
from tests.support.spans import turned

from plnerf.errors import SurveyError
from plnerf.line.base import Base
from plnerf.line.ends import Open
from plnerf.line.line import Line, Span, Structure
from plnerf.line.wire import Wire
from plnerf.score.config import DEFAULT
from plnerf.score.observable import score_observable
from plnerf.score.supports_score import match_supports
from plnerf.score.survey_report import markdown, to_json
from plnerf.score.survey_score import score_survey
from plnerf.score.truth import Truth, read_truth
from plnerf.score.wire_matches import match_wires
from plnerf.synth.build import stand
from plnerf.synth.config import SceneConfig
from plnerf.synth.line_scenes import LINE_SCENES
from plnerf.synth.near_plants import near_plants
from plnerf.synth.truth import Shows, truth_of

CONFIG = DEFAULT.wires
NAMES = ["three-spans", "crossing", "wind"]


def truth_from(scene: SceneConfig, path: Path) -> Truth:
    """As `plnerf synth` writes it and `plnerf score` reads it, with all of every wire observable."""
    site = stand(scene.span)
    whole = [[(0.0, wire.base.length_m)] for wire in site.wires]
    path.write_text(json.dumps(truth_of(site, scene, (), near_plants(site), Shows(whole, whole))))
    return read_truth(path)


@pytest.fixture(params=NAMES)
def truth(request: pytest.FixtureRequest, tmp_path: Path) -> Truth:
    return truth_from(LINE_SCENES[request.param], tmp_path / "truth.json")


def exact(truth: Truth) -> list[Wire]:
    return [replace(wire, covariance=np.diag([1e-6] * 6), name=None) for wire in truth.wires]


def backwards(one: Wire) -> Wire:
    y0, y1, z0, z1, b, phi = one.theta
    base = Base(one.base.b, one.base.a)
    return replace(one, base=base, theta=np.array([-y1, -y0, z1, z0, b, -phi]), ends=one.ends[::-1])


def test_what_synth_writes_is_what_score_reads(tmp_path: Path) -> None:
    for name in NAMES:
        site = stand(LINE_SCENES[name].span)
        truth = truth_from(LINE_SCENES[name], tmp_path / "truth.json")
        for read, wire in zip(truth.wires, site.wires, strict=True):
            np.testing.assert_allclose(read.theta, wire.theta, atol=1e-9)
            assert read.sag is not None and wire.sag is not None
            assert read.sag.value == pytest.approx(wire.sag.value)
            assert [end.structure for end in read.ends] == [end.structure for end in wire.ends]  # type: ignore[union-attr]
        for structure, tower in zip(truth.structures, site.towers, strict=True):
            assert (structure.id, structure.name, structure.kind) == (tower.id, tower.name, tower.config.kind)
            assert structure.line_angle_deg in (None, tower.config.turn_deg)


@pytest.mark.parametrize("turns", [False, True])
def test_each_true_span_is_found_once_whichever_way_it_is_counted(truth: Truth, turns: bool) -> None:
    found = [backwards(one) if turns else one for one in exact(truth)]
    score = match_wires(found, truth.wires)
    assert [(one.wire, one.conductor) for one in score.matches] == [(w.name, w.id) for w in truth.wires]
    assert (score.missing, score.again, score.invented) == ((), (), ())
    for one in score.matches:
        assert one.worst_m < 1e-4 and abs(one.sag_error_m or 0) < 1e-6
        assert abs(one.swing_error_deg) < 1e-6 and one.swing_within_95
        assert one.ends_off_m == pytest.approx((0.0, 0.0), abs=1e-6)


def test_a_wire_that_reaches_into_the_next_span_is_not_that_span_s(tmp_path: Path) -> None:
    """The middle span's wires go 3 m too far, and the next span's are not found: missing, not matched."""
    truth = truth_from(LINE_SCENES["three-spans"], tmp_path / "truth.json")
    middle = [wire for wire in exact(truth) if "span 2" in (truth.wires[wire.id - 1].name or "")]
    longer = [wire.between(0.0, wire.base.length_m + 3.0) for wire in middle]
    score = match_wires(longer, truth.wires)
    assert len(score.matches) == len(middle) and all("span 2" in one.wire for one in score.matches)
    assert score.invented == () and all("span 2" not in name for name in score.missing)
    for one in score.matches:  # their attachments are where they were
        assert one.ends_off_m == pytest.approx((0.0, 0.0), abs=1e-6)


def test_a_wire_through_all_spans_is_one_of_them_and_the_others_are_missing(tmp_path: Path) -> None:
    straight = replace(
        LINE_SCENES["grid"].span, wires=LINE_SCENES["grid"].span.wires[:1], before_m=(40.0,), after_m=(40.0,)
    )
    truth = truth_from(replace(LINE_SCENES["grid"], span=straight), tmp_path / "truth.json")
    middle = exact(truth)[1]
    through = replace(middle.between(-30.0, 70.0), ends=(Open("hidden"), Open("hidden")))
    score = match_wires([through], truth.wires)
    assert [one.wire for one in score.matches] == [truth.wires[1].name] and len(score.missing) == 2
    assert score.matches[0].ends_off_m == (None, None)


def test_supports_are_compared_along_the_line(truth: Truth) -> None:
    moved = []
    for one in truth.structures:
        held = [wire.base.u for wire in truth.wires if one.id in [end.structure for end in wire.ends]]  # type: ignore[union-attr]
        u = np.mean(held, axis=0)
        u /= np.linalg.norm(u)
        off = np.array([0.07 * u[0] - 0.2 * u[1], 0.07 * u[1] + 0.2 * u[0], 0.5])
        moved.append(replace(one, id=one.id + 10, foot=one.foot + off, kind="unknown", line_angle_deg=None))
    far = Structure(99, truth.structures[0].foot + np.array([0.0, 30.0, 0.0]), 9.0, 0.1, "made up")
    score = match_supports([*moved[1:], far], truth.structures, truth.wires, CONFIG)
    assert [one.structure for one in score.matches] == [one.id + 10 for one in truth.structures[1:]]
    assert score.missing == (truth.structures[0].name,) and score.invented == (99,)
    for one in score.matches:
        assert one.along_m == pytest.approx(0.07) and one.across_m == pytest.approx(0.2)


def test_a_support_that_no_image_shows_is_not_missing(truth: Truth) -> None:
    unseen = [replace(wire, evidence=replace(wire.evidence, seen_m=((12.0, 20.0),))) for wire in truth.wires]
    assert match_supports([], truth.structures, unseen, CONFIG).missing == ()


def test_what_images_show_well_is_found_within_the_distance(tmp_path: Path) -> None:
    truth = truth_from(LINE_SCENES["wind"], tmp_path / "truth.json")
    half = tuple(((0.0, wire.base.length_m / 2),) for wire in truth.wires)
    truth = replace(truth, observable=half)
    found = exact(truth)
    score = score_observable(found, truth, CONFIG)
    assert score is not None and score.recall == pytest.approx(1.0)
    assert score.total_m == pytest.approx(2 * 40.0, rel=0.01)
    upper = [replace(one, theta=one.theta + np.array([0, 0, 0.12, 0.12, 0, 0])) for one in found]
    high = score_observable(upper, truth, CONFIG)
    assert high is not None and high.recall == pytest.approx(0.0, abs=0.01)
    partly = score_observable([found[0].between(0.0, 10.0)], truth, CONFIG)
    assert partly is not None and partly.wires[0].found_m == pytest.approx(10.1, abs=0.1)
    assert score_observable(found, replace(truth, observable=()), CONFIG) is None
    there = truth.moved(turned(1.0, np.array([9.0, 8.0, 7.0])))
    assert there.observable[0][0][1] == pytest.approx(half[0][0][1])


def test_a_survey_of_lines_is_reported(truth: Truth) -> None:
    """A survey that is the truth, but for a wire of its own making."""
    wires = exact(truth)
    odd = replace(wires[0], id=500, theta=wires[0].theta + np.array([0, 0, 3.0, 3.0, 0, 0]))
    span = Span(1, (1, 2), (*wires, odd))
    frame = replace(corridor(np.zeros(3)).frame, origin_world=np.zeros(3))
    survey = replace(
        corridor(np.zeros(3)), frame=frame, lines=(Line(1, truth.structures, (span,)),), clearances=None
    )
    score = score_survey(survey, truth)
    assert score.wires.invented == (500,) == score.invented_certain
    content = json.loads(json.dumps(to_json(score, CONFIG)))
    assert content["observable"]["recall"] == pytest.approx(1.0)
    assert len(content["supports"]["matches"]) == len(truth.structures)
    assert all(abs(row["swing_error_deg"]) < 1e-6 for row in content["conductors"]["wires"])
    text = markdown(score)
    assert (
        "are found within 10 cm" in text and "| structure | id |" in text and "1 conductors invented" in text
    )


def test_a_swung_wire_must_state_its_parameter(tmp_path: Path) -> None:
    path = tmp_path / "truth.json"
    entry = {"a": [0, 0, 9], "b": [40, 0, 9], "sag_m": 1.0, "swing_deg": 10.0}
    path.write_text(json.dumps({"conductors": [entry]}))
    with pytest.raises(SurveyError, match="must state its p_m too"):
        read_truth(path)
    path.write_text(json.dumps({"conductors": [entry | {"p_m": 200.0}]}))
    assert read_truth(path).wires[0].swing_rad == pytest.approx(math.radians(10))
    path.write_text(json.dumps({"conductors": [entry | {"p_m": 200.0}], "towers": [
        {"foot": [0, 0, 0], "structure": "odd"}
    ]}))  # fmt: skip
    with pytest.raises(SurveyError, match="its structure must be one of suspension"):
        read_truth(path)
