"""A survey scored: exact ones have no error, known errors are found, draws are as certain as they say."""

import json
import re
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.support.catenary_surveys import corridor, wires
from tests.support.spans import span, turned, wire

from plnerf.capture.similarity import Similarity
from plnerf.cli.main import main
from plnerf.errors import ConfigError, SurveyError
from plnerf.line.base import Base
from plnerf.line.clearances import GROUPS, Group, Place, Profile, WireClearance
from plnerf.line.ends import Open
from plnerf.line.files import SURVEY_VERSION, read_survey, write_survey_json
from plnerf.line.line import Line, Span
from plnerf.line.wire import Kind, Wire
from plnerf.scene import memory
from plnerf.scene.ply import write_ply
from plnerf.scene.transforms import flip_camera_axes
from plnerf.score.align import cameras_of
from plnerf.score.clearance_score import ClearanceScore, score_clearances
from plnerf.score.compared import Compared
from plnerf.score.config import DEFAULT, WireScoreConfig
from plnerf.score.score import score_files
from plnerf.score.survey_score import score_survey
from plnerf.score.true_plants import TrueLeaf, TruePlant
from plnerf.score.truth import Truth, read_truth
from plnerf.score.wire_matches import WireMatches, match_wires, rules
from plnerf.survey.clearance import measure_clearances
from plnerf.survey.config_ground import ClearanceConfig

TRUTH = span(*(wire(y, name=name) for y, name in ((0.0, "A"), (3.0, "B"), (6.0, "C"))))
RAISED = np.array([0.0, 0.0, 0.02, 0.02, 0.0, 0.0])
"""Added to theta: 2 cm higher."""


def exact(true: Wire, number: int, off: np.ndarray | None = None, kind: Kind = "phase") -> Wire:
    """The true wire, moved, as if fitted."""
    there = np.zeros(3) if off is None else off
    base = Base(true.base.a + there[:2], true.base.b + there[:2])
    theta = true.theta + there[2] / 0.02 * RAISED
    covariance = np.diag([1e-4] * 4 + [4e-4, 0.0])
    return replace(true, id=number, base=base, theta=theta, covariance=covariance, kind=kind, name=None)


def all_exact(truth: Truth = TRUTH, off: np.ndarray | None = None) -> list[Wire]:
    return [exact(one, i, off) for i, one in enumerate(truth.wires, 1)]


def test_an_exact_survey_has_no_errors() -> None:
    score = match_wires(all_exact(), TRUTH.wires)
    assert [(one.wire, one.conductor) for one in score.matches] == [("A", 1), ("B", 2), ("C", 3)]
    assert (score.missing, score.again, score.invented, score.unseen) == ((), (), (), ())
    for one in score.matches:
        assert max(one.rmse_across_m, one.rmse_up_m, one.worst_m) < 1e-5  # between vertices of the polyline
        assert abs(one.sag_error_m) < 1e-9 and abs(one.sag_common_error_m) < 1e-9
        assert one.no_sag_because is None
        assert one.span_m == pytest.approx(40) == one.span_found_m and one.common_m == pytest.approx(40)
        assert one.kind_right and one.sag_within_95
        assert one.within_95_across == 1 == one.within_95_up


@pytest.mark.parametrize("turn", [0.0, 2.0, 4.0])
@pytest.mark.parametrize("backwards", [False, True])
def test_a_displaced_conductor_gives_the_displacement(turn: float, backwards: bool) -> None:
    """Whichever way it is counted, and wherever the line runs."""
    motion = turned(turn, np.array([5e5, 5.7e6, 100.0]))
    truth = TRUTH.moved(motion)
    found = all_exact(truth, motion.R @ np.array([0.0, 0.12, -0.05]))
    if backwards:
        found = [reversed_(one) for one in found]
    for one in match_wires(found, truth.wires).matches:
        assert one.rmse_across_m == pytest.approx(0.12, abs=1e-5)
        assert one.rmse_up_m == pytest.approx(0.05, abs=1e-4)
        assert one.worst_m == pytest.approx(0.13, abs=1e-4)
        assert one.within_95_across == 0 and one.within_95_up == 0  # 1.96 times 1 cm is stated
        assert abs(one.sag_error_m) < 1e-4 and one.sag_within_95


def reversed_(one: Wire) -> Wire:
    """The same wire, its ends exchanged."""
    y0, y1, z0, z1, b, phi = one.theta
    return replace(one, base=Base(one.base.b, one.base.a), theta=np.array([-y1, -y0, z1, z0, b, -phi]))


def test_missing_doubled_and_invented_wires_are_reported() -> None:
    unseen = wire(9.0, name="D")
    unseen = replace(unseen, evidence=replace(unseen.evidence, seen_m=()))
    found = [
        exact(TRUTH.wires[0], 1),
        exact(TRUTH.wires[0], 2, np.array([0.0, 0.2, 0.0])),
        exact(TRUTH.wires[2], 3, np.array([0.0, 0.0, 0.1]), "shield"),
        exact(TRUTH.wires[1], 4, np.array([0.0, 0.0, 1.0])),
    ]
    score = match_wires(found, (*TRUTH.wires, unseen))
    assert [(one.wire, one.conductor, one.kind_right) for one in score.matches] == [
        ("A", 1, True), ("C", 3, False),
    ]  # fmt: skip
    assert score.again == ((2, "A"),) and score.invented == (4,)
    assert score.missing == ("B",) and score.unseen == ("D",)
    nothing = match_wires([], TRUTH.wires)
    assert nothing.missing == ("A", "B", "C") and nothing.share_within_95("sag") is None


def test_of_twins_each_is_its_own_wire_even_if_both_are_off() -> None:
    twins = span(wire(0.0, name="left"), wire(0.4, name="right"))
    score = match_wires(all_exact(twins, np.array([0.0, 0.3, 0.0])), twins.wires)
    assert [(one.wire, one.conductor) for one in score.matches] == [("left", 1), ("right", 2)]
    one = match_wires(all_exact(twins)[:1], twins.wires)
    assert one.missing == ("right",) and one.again == ()


def test_wrong_ends_are_told_from_a_wrong_shape() -> None:
    """A wire that goes on for a metre beyond either attachment has more sag, and lies on the true one."""
    true = TRUTH.wires[0]
    longer = exact(true, 1).between(-1.0, 41.0)
    (one,) = match_wires([longer], [true]).matches
    assert one.sag_error_m == pytest.approx(1.2 * ((42 / 40) ** 2 - 1), abs=2e-3) and not one.sag_within_95
    assert abs(one.sag_common_error_m) < 1e-3 and one.rmse_up_m < 1e-3
    assert one.common_m == pytest.approx(40, abs=0.05) and one.span_found_m == pytest.approx(42, abs=0.05)
    short = exact(true, 1).between(9.0, 10.5)
    score = match_wires([short], [true])
    assert score.missing == ("A",) and score.invented == (1,)
    assert short.base.length_m < DEFAULT.wires.least_common_m


def test_no_sag_is_compared_where_none_is_stated() -> None:
    """Of a wire with an open end its shape is: between the ends of the common stretch."""
    true, why = TRUTH.wires[0], "not filmed"
    half = replace(exact(true, 1).between(0.0, 25.0), ends=(true.ends[0], Open(why)))
    score = match_wires([half, exact(TRUTH.wires[1], 2)], TRUTH.wires)
    one, other = score.matches
    assert one.sag_found_m is None and one.sag_sigma_m is None and one.span_found_m is None
    assert one.sag_error_m is None and one.sag_within_95 is None
    assert one.no_sag_because == "the last end is open (not filmed)"
    assert one.sag_m == pytest.approx(1.2) and other.sag_within_95
    assert score.share_within_95("sag") == 1  # of the other alone
    points = true.points(np.linspace(0, 25, 250_001))
    chord = np.linspace(points[0, 2], points[-1, 2], len(points))
    assert one.sag_common_m == pytest.approx((chord - points[:, 2]).max(), abs=1e-9)
    assert one.sag_common_error_m == pytest.approx(0, abs=1e-9)
    assert match_wires([half], TRUTH.wires).share_within_95("sag") is None


def test_draws_of_the_stated_covariance_are_covered() -> None:
    """95 % of sags, and of places across and up, over many surveys."""
    random, true = np.random.default_rng(5), TRUTH.wires[0]
    half = np.array([1.0, 0.4, 1.2, 0.5, 0.9, 0.0])
    covariance = 4e-4 * np.diag(half**2)
    covariance[2, 4] = covariance[4, 2] = 2e-4
    start = exact(true, 1)
    scores: list[WireMatches] = []
    for theta in random.multivariate_normal(start.theta, covariance, 400):
        drawn = replace(start, theta=theta, covariance=covariance)
        scores.append(match_wires([drawn], [true]))
    for name in ("sag", "across", "up"):
        shares = [score.share_within_95(name) for score in scores]
        assert np.mean(shares) == pytest.approx(0.95, abs=0.03), name  # type: ignore[arg-type]


def test_another_frame_is_refused() -> None:
    away = all_exact(off=np.array([5e5, 5.7e6, 0.0]))
    with pytest.raises(SurveyError, match=r"is 5,721,\d+ m away .* is not in the truth's frame"):
        match_wires(away, TRUTH.wires)


def hills(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    z: np.ndarray = 0.5 * np.sin(x / 7 + 1) + 0.3 * np.cos(y / 9) + 0.1 * x
    return z


def over_hills() -> Truth:
    x, y = np.meshgrid(np.arange(-25.0, 26.0), np.arange(-10.0, 11.0, 5.0))
    ground = np.stack([x.ravel(), y.ravel(), hills(x.ravel(), y.ravel())], 1)
    feet = ((0.0, 3.0), (5.0, -4.0), (39.0, 0.0))
    plants = (
        TruePlant(np.array([*foot, 0.0]), clearance, wire)
        for foot, clearance, wire in zip(feet, (4.0, 3.0, 1.0), ("B", "A", "B"), strict=True)
    )
    return replace(TRUTH, ground=ground, plants=tuple(plants))


def stating(wire: int, *places: Place) -> WireClearance:
    """What a survey states of a wire."""
    groups = {group: tuple(one for one in places if one.measure == "distance" and one.to == group)
              for group in GROUPS}  # fmt: skip
    no = np.zeros(0)
    profile = Profile(wire, no, np.zeros((0, 3)), no, no, no, {})
    vertical = next((one for one in places if one.measure == "vertical"), None)
    return WireClearance(wire, 1, "phase", groups, vertical, profile)


def place(wire: int, at: np.ndarray, distance: float, to: Group = "ground") -> Place:
    measure = "vertical" if to == "ground" else "distance"
    return Place(wire, 1, "phase", to, 2, measure, distance, 0.1, 0.0, at, at)


def test_the_least_height_above_the_ground_is_that_of_brute_force() -> None:
    truth, found = over_hills(), all_exact()
    stated, true = [], []
    for one in found:
        places = one.points(np.linspace(0, 40, 8001))
        height = places[:, 2] - hills(places[:, 0], places[:, 1])
        true.append(float(height.min()))
        at = places[height.argmin()] + [1.5, 0.0, 0.0]
        stated.append(stating(one.id, place(one.id, at, true[-1] + 0.1)))
    matches = match_wires(found, truth.wires).matches
    score = score_clearances(matches, found, stated, truth, DEFAULT.wires)
    for one, least in zip(score.ground, true, strict=True):
        assert one.true_m == pytest.approx(least, abs=0.01)
        assert one.error_m == pytest.approx(0.1, abs=0.01) and one.within_95
        assert one.off_along_m == pytest.approx(1.5, abs=0.15)
    (first, *_) = score_clearances(matches, found, [], truth, DEFAULT.wires).ground
    assert first.found_m is None and first.error_m is None and first.within_95 is None
    beside = replace(truth, ground=truth.ground + np.array([0.0, 100.0, 0.0]))  # type: ignore[operator]
    notes = score_clearances(matches, found, stated, beside, DEFAULT.wires).notes
    assert "no ground below A" in notes[0]


def test_the_nearest_plant_is_compared_from_the_axis() -> None:
    truth = over_hills()
    truth = replace(truth, wires=tuple(replace(one, diameter_m=0.04) for one in truth.wires))
    stated = [stating(1, place(1, np.zeros(3), 5.0, "vegetation")),
              stating(2, place(2, np.zeros(3), 3.32, "vegetation"))]  # fmt: skip
    found = all_exact()
    matches = match_wires(found, truth.wires).matches

    def scored(stated: Sequence[WireClearance], truth: Truth) -> ClearanceScore:
        return score_clearances(matches, found, stated, truth, DEFAULT.wires)

    plant = scored(stated, truth).vegetation  # the third stands beyond the wires' ends
    assert plant is not None and (plant.wire, plant.conductor) == ("A", 2)
    assert plant.true_m == pytest.approx(3.02) and plant.error_m == pytest.approx(0.3) and not plant.within_95
    limit = stating(2, replace(place(2, np.zeros(3), 3.32, "vegetation"), at_most=True))
    plant = scored([stated[0], limit], truth).vegetation
    assert plant is not None and plant.at_most and plant.within_95
    for other, why in (
        (replace(truth, houses=2), "2 houses, which surveys do not distinguish from plants"),
        (replace(truth, plants=()), "the truth has none"),
        (replace(truth, plants=truth.plants[2:]), "the truth has none between the conductors' ends"),
    ):
        score = scored(stated, other)
        assert score.vegetation is None and why in score.notes[-1]
    assert "states no distance" in scored((), truth).notes[-1]
    beyond = stating(2, place(2, truth.plants[2].foot, 3.0, "vegetation"))
    assert "stands beyond a wire's end" in scored([beyond], truth).notes[-1]
    without = [match for match in matches if match.wire != "A"]
    score = score_clearances(without, found, stated, truth, DEFAULT.wires)
    assert score.vegetation is None and "3.02 m from A, which the survey does not have" in score.notes[-1]


def test_the_plant_that_is_nearest_to_each_wire_is_compared() -> None:
    """Of the leaves that images show, or that the survey finds all the same, between its wire's ends."""
    truth = replace(TRUTH, wires=tuple(replace(one, diameter_m=0.04) for one in TRUTH.wires))

    def plant(x: float, *leaves: tuple[str, float, bool]) -> TruePlant:
        foot = np.array([x, 3.0, 0.0])
        own = tuple(TrueLeaf(wire, foot, clearance, shown) for wire, clearance, shown in leaves)
        return TruePlant(foot, leaves[0][1], leaves[0][0], 1.0, True, own)

    hidden, shown = plant(-12.0, ("A", 2.0, False), ("B", 5.0, True)), plant(6.0, ("A", 3.0, True))
    beyond = plant(39.0, ("A", 1.0, True))
    truth = replace(truth, plants=(hidden, shown, beyond))
    found = all_exact()
    matches = match_wires(found, truth.wires).matches

    def scored(at: np.ndarray, truth: Truth = truth) -> dict[str, Compared]:
        stated = [stating(1, place(1, at, 3.1, "vegetation"))]
        score = score_clearances(matches, found, stated, truth, DEFAULT.wires)
        return {one.wire: one for one in score.vegetation_of_wires}

    def a_of(x: float) -> tuple[float, float | None]:
        one = scored(np.array([x, 3.0, 0.0]))["A"]
        return round(one.true_m, 6), one.error_m

    both = scored(shown.foot)
    assert a_of(6.0) == (3.02, pytest.approx(0.08))
    assert both["B"].true_m == pytest.approx(5.02) and both["B"].found_m is None
    assert a_of(-10.1) == (2.02, pytest.approx(1.08))  # a metre beside the crown of one that is hidden
    assert a_of(-9.9) == (3.02, pytest.approx(0.08))
    assert scored(np.array([7.5, 9.0, 0.0]))["A"].off_along_m == pytest.approx(1.5)
    assert "A" not in scored(beyond.foot)
    assert scored(shown.foot, replace(truth, houses=1)) == {}
    turned = truth.moved(Similarity(2.0, np.eye(3)[[1, 0, 2]] * [1, -1, 1], np.ones(3)))
    leaf = turned.plants[0].leaves[0]
    assert leaf.clearance_m == 4.0 and np.allclose(leaf.place, turned.plants[0].foot)


def test_a_survey_is_compared_in_its_own_frame() -> None:
    """The truth is in the world; nothing depends on where the survey's frame lies."""
    survey = corridor(np.zeros(3))
    truth = span(*(replace(one, name=f"wire {one.id}") for one in wires()))
    here = score_survey(survey, truth)
    assert len(here.wires.matches) == 3 and here.before_refit == ()
    turn = Rotation.from_euler("z", 40, degrees=True).as_matrix()
    frame = replace(survey.frame, R_line_world=turn, origin_world=np.array([5e5, 5.7e6, 30.0]))
    into_world = Similarity(1.0, turn.T, frame.origin_world)  # what lay in the LineFrame lies in the world
    there = score_survey(replace(survey, frame=frame), truth.moved(into_world))
    for one, other in zip(here.wires.matches, there.wires.matches, strict=True):
        for key in ("sag_m", "sag_found_m", "rmse_across_m", "rmse_up_m", "worst_m", "common_m"):
            assert getattr(one, key) == pytest.approx(getattr(other, key), abs=1e-6), key


def test_wires_as_detected_are_scored_where_the_survey_kept_them() -> None:
    survey = corridor(np.zeros(3))
    before = [replace(one, theta=one.theta + RAISED) for one in survey.wires]
    dropped = replace(before[0], id=9)
    truth = span(*(replace(one, name=f"wire {one.id}") for one in wires()))
    score = score_survey(replace(survey, detected=(*before, dropped)), truth)
    assert [one.conductor for one in score.before_refit] == [1, 2, 3]
    for now, old in zip(score.wires.matches, score.before_refit, strict=True):
        assert old.rmse_up_m == pytest.approx(0.02, abs=3 * now.rmse_up_m)
        assert old.rmse_across_m == pytest.approx(now.rmse_across_m)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A survey folder of three known wires, and truth.json beside the run folder that it is in."""
    out = tmp_path / "run" / "survey"
    out.mkdir(parents=True)
    survey = corridor(np.zeros(3))
    clearances, _ = measure_clearances(survey, ClearanceConfig())
    before = tuple(replace(one, theta=one.theta + RAISED) for one in survey.wires)
    survey = replace(survey, clearances=clearances, detected=before)
    write_survey_json(out / "survey.json", survey)
    entries = [
        {"name": f"wire {one.id}", "kind": one.kind, "polyline": one.polyline(0.25).tolist()}
        for one in wires()
    ]
    x, y = np.meshgrid(np.arange(-20.0, 141.0, 10), np.arange(-30.0, 61.0, 10))
    ground = np.stack([x, y, 0.03 * x - 0.02 * y], 2)
    truth = {"conductors": entries, "ground": {"rows": [{"points": row.tolist()} for row in ground]}}
    (tmp_path / "truth.json").write_text(json.dumps(truth))
    return out


@pytest.mark.parametrize("where", ["ends", "observable_m"])
def test_true_wires_too_long_for_memory_are_refused(
    where: str, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(memory, "available_bytes", lambda: 8e9)
    truth = folder.parent.parent / "truth.json"
    long = {"ends": {"b": [1e10, 0.0, 20.0]}, "observable_m": {"observable_m": [[0.0, 1e10]]}}
    wire = {"name": "far", "a": [0.0, 0.0, 20.0], "b": [90.0, 0.0, 20.0], "sag_m": 2.0} | long[where]
    truth.write_text(json.dumps({"conductors": [wire]}))
    monkeypatch.setattr(sys, "argv", ["plnerf", "score", str(folder), "--truth", str(truth)])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 1 and "GB of memory, but 8.0 GB are free" in capsys.readouterr().err


def test_the_command_scores_folders_and_files(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    truth = folder.parent.parent / "truth.json"
    for place in (folder.parent, folder, folder / "survey.json"):
        monkeypatch.setattr(sys, "argv", ["plnerf", "score", str(place), "--truth", str(truth)])
        main()
        out = capsys.readouterr().out
        assert "3 true wires: 3 found once, 0 more than once, 0 missing; 0 conductors invented." in out
        assert "| wire 3 | 3 | shield | 1.500 | 1.5" in out and "| wire 1, above ground | 1 | " in out
        assert "Note: Distances to plants are not compared" in out
        assert str(folder / "survey.score.json") in out and "recall" not in out
    content = json.loads((folder / "survey.score.json").read_text())
    assert content["conductors"]["rules"] == rules(DEFAULT.wires) and content["conductors"]["found"] == 3
    for one in content["conductors"]["wires"]:
        assert abs(one["sag_error_m"]) < 5 * one["sag_sigma_m"] and one["worst_m"] < 0.05
    for one in content["clearances"]["ground"]:
        assert abs(one["error_m"]) < 5 * one["sigma_m"] < 1
    write_ply(folder / "wires.ply", np.concatenate([one.polyline(0.02) for one in wires()]))
    done = score_files(folder, truth=truth)
    assert "| 5 cm | 100.0% | 100.0% | 100.0% |" in done.text and capsys.readouterr().out == ""
    assert done.places == f"{folder}/survey.json against {truth}\nscore: {folder}/survey.score.json"
    content = json.loads((folder / "survey.score.json").read_text())
    assert content["overall"]["f1_5cm"] == 1 and content["conductors"]["found"] == 3


def test_what_the_refit_gained_is_reported(folder: Path) -> None:
    """Every wire is 2 cm higher before it."""
    done = score_files(folder, truth=folder.parent.parent / "truth.json")
    assert "| before the refit | sag error" in done.text
    scored = json.loads(done.path.read_text())["conductors"]
    for now, before in zip(scored["wires"], scored["before_refit"], strict=True):
        assert before["rmse_up_m"] == pytest.approx(0.02, abs=3 * now["rmse_up_m"])
        assert before["rmse_across_m"] == pytest.approx(now["rmse_across_m"])


def test_why_there_is_no_sag_is_reported(folder: Path) -> None:
    survey = read_survey(folder / "survey.json")
    first, *others = survey.wires
    span_ = Span(1, (1, None), (replace(first, ends=(first.ends[0], Open("hidden"))), *others))
    write_survey_json(folder / "survey.json", replace(survey, lines=(Line(1, survey.structures, (span_,)),)))
    done = score_files(folder, truth=folder.parent.parent / "truth.json")
    assert "Conductor 1 (wire 1) has no sag: the last end is open (hidden)." in done.text
    (row, *_) = json.loads(done.path.read_text())["conductors"]["wires"]
    assert row["sag_found_m"] is None and row["no_sag_because"] == "the last end is open (hidden)"


def test_a_truth_in_another_frame_is_moved_by_its_cameras(folder: Path, tiny_scene: Path) -> None:
    """The survey's scene is the tiny one; the truth's cameras and wires lie elsewhere, in the same way."""
    truth = folder.parent.parent / "truth.json"
    score_files(folder, truth=truth)
    before = json.loads((folder / "survey.score.json").read_text())["conductors"]["wires"]
    R = Rotation.from_euler("z", 77, degrees=True).as_matrix()
    turn = Similarity(1.0, R, np.array([1e4, 2e3, -50.0]))
    data = json.loads(truth.read_text())
    for one in data["conductors"]:
        one["polyline"] = turn(np.array(one["polyline"])).tolist()
    for row in data["ground"]["rows"]:
        row["points"] = turn(np.array(row["points"])).tolist()
    data["poses"] = []
    for name, T in cameras_of(tiny_scene).items():
        there = np.eye(4)
        there[:3] = np.column_stack([turn.R @ T[:3, :3], turn(T[:3, 3])])
        data["poses"].append({"name": name, "T_world_camera": flip_camera_axes(there).tolist()})
    truth.write_text(json.dumps(data))
    with pytest.raises(SurveyError, match="not in the truth's frame"):
        score_files(folder, truth=truth)
    done = score_files(folder, truth=truth, by_cameras=tiny_scene)
    assert "by 12 cameras, which are 0.000 m off" in done.text
    content = json.loads((folder / "survey.score.json").read_text())
    for one, other in zip(content["conductors"]["wires"], before, strict=True):
        for key in ("sag_m", "rmse_across_m", "rmse_up_m", "worst_m", "common_m"):
            assert one[key] == pytest.approx(other[key], abs=1e-6)
    assert content["aligned"]["scale"] == pytest.approx(1) and len(content["clearances"]["ground"]) == 3


def test_an_unscaled_survey_is_compared_with_an_unscaled_truth(folder: Path, tiny_scene: Path) -> None:
    """The truth is in units three times as long, and its cameras say so."""
    truth = folder.parent.parent / "truth.json"
    score_files(folder, truth=truth)
    before = json.loads((folder / "survey.score.json").read_text())["conductors"]["wires"]
    data = json.loads(truth.read_text())
    del data["ground"]
    for one in data["conductors"]:
        one["polyline"] = (np.array(one["polyline"]) / 3).tolist()
    data |= {"unit": "unscaled", "poses": []}
    for name, T in cameras_of(tiny_scene).items():
        there = T.copy()
        there[:3, 3] /= 3
        data["poses"].append({"name": name, "T_world_camera": flip_camera_axes(there).tolist()})
    truth.write_text(json.dumps(data))
    found = json.loads((folder / "survey.json").read_text())
    found["frame"]["unit"] = "unscaled"
    (folder / "survey.json").write_text(json.dumps(found))
    done = score_files(folder, truth=truth, by_cameras=tiny_scene)
    assert "was turned, shifted and scaled by 12 cameras" in done.text
    after = json.loads((folder / "survey.score.json").read_text())["conductors"]["wires"]
    for one, other in zip(after, before, strict=True):
        assert one["sag_m"] == pytest.approx(other["sag_m"], abs=1e-5)
        assert one["worst_m"] == pytest.approx(other["worst_m"], abs=1e-5)


def row_of(data: dict) -> dict:
    return data["lines"][0]["spans"][0]["wires"][0]


Spoil = Callable[[dict], object]
SPOILT: dict[str, tuple[Spoil, str]] = {
    "older": (
        lambda data: data.update(format_version=2),
        f"has format version 2, but .* reads {SURVEY_VERSION}. Survey again",
    ),
    "unscaled": (lambda data: data["frame"].update(unit="unscaled"), "is unscaled, so that its wires cannot"),
    "uncertain": (lambda data: row_of(data).pop("covariance"), "is no survey .it has no 'covariance'"),
    "null": (lambda data: row_of(data).update(theta=[None] * 6), "finite numbers"),
}


@pytest.mark.parametrize("name", SPOILT)
def test_what_is_no_survey_in_metres_is_refused(folder: Path, name: str) -> None:
    spoil, text = SPOILT[name]
    data = json.loads((folder / "survey.json").read_text())
    spoil(data)
    (folder / "survey.json").write_text(json.dumps(data))
    with pytest.raises(SurveyError, match=text):
        score_files(folder, truth=folder.parent.parent / "truth.json")
    assert not (folder / "survey.score.json").exists()


def test_what_is_no_survey_at_all_is_refused(folder: Path, tmp_path: Path) -> None:
    (folder / "survey.json").write_text("{")
    with pytest.raises(SurveyError, match="is not valid JSON"):
        score_files(folder, truth=tmp_path / "truth.json")
    with pytest.raises(SurveyError, match=re.escape(f"There is no file {tmp_path}/survey.json")):
        score_files(tmp_path / "survey.json", truth=tmp_path / "truth.json")


def test_the_truth_of_plants_must_be_numbers(tmp_path: Path) -> None:
    path = tmp_path / "truth.json"
    line = {"polyline": [[0, 0, 9], [20, 0, 8], [40, 0, 9]]}
    plant = {"foot": [0, 0, 0], "clearance_m": "near"}
    path.write_text(json.dumps({"conductors": [line], "vegetation": [plant]}))
    with pytest.raises(SurveyError, match="plant 1, clearance_m: expected a finite number, but found 'near'"):
        read_truth(path)
    path.write_text(json.dumps({"conductors": [line], "ground": {"rows": [{"points": [[0, 0]]}]}}))
    with pytest.raises(SurveyError, match="ground: expected 1 or more points of three finite numbers"):
        read_truth(path)
    path.write_text(json.dumps({"conductors": [line]}))
    assert read_truth(path).wires[0].sag.value == pytest.approx(1) and read_truth(path).ground is None


def test_a_true_wire_is_what_its_file_states(tmp_path: Path) -> None:
    """By p, by its sag, or by vertices: one curve; where it was seen and what holds it stay."""
    true = wire(3.0, name="A")
    a, b = true.points(np.array([0.0, 40.0])).tolist()
    ends, line = {"a": a, "b": b}, true.polyline(0.25).round(6).tolist()
    towers = [{"foot": [20, 0, 0], "height_m": 12, "name": "east"}, {"foot": [-20, 0, 0], "height_m": 12}]
    path = tmp_path / "truth.json"
    for entry in (ends | {"p_m": true.plane[2]}, ends | {"sag_m": 1.2}, {"polyline": line},
                  ends | {"sag_m": 1.2, "polyline": line}):  # fmt: skip
        entry |= {"name": "A", "kind": "shield", "seen_m": [[1, 2]], "diameter_m": 0.02}
        path.write_text(json.dumps({"conductors": [entry], "towers": towers}))
        truth = read_truth(path)
        (found,) = truth.wires
        assert np.abs(found.polyline() - true.polyline()).max() < 2e-6
        assert found.sag is not None and found.sag.value == pytest.approx(1.2, abs=2e-6)
        assert (found.id, found.name, found.kind, found.diameter_m) == (1, "A", "shield", 0.02)
        assert found.evidence.seen_m == ((1.0, 2.0),)
        assert [end.structure for end in found.ends] == [2, 1]  # type: ignore[union-attr]
        assert [one.name for one in truth.structures] == ["east", None]


def test_a_true_wire_may_swing(tmp_path: Path) -> None:
    """A polyline whose plane leans by wind is fitted as one."""
    upright = wire(0.0)
    swung = replace(upright, theta=upright.theta + np.array([0, 0, 0, 0, 0, 0.3]))
    path = tmp_path / "truth.json"
    path.write_text(json.dumps({"conductors": [{"polyline": swung.polyline(0.5).tolist()}]}))
    (found,) = read_truth(path).wires
    assert np.abs(found.theta - swung.theta).max() < 1e-5


def test_the_configuration_of_wires_is_checked() -> None:
    for wrong in ({"place_m": 0.0}, {"match_m": -1.0}, {"end_m": 1.0}):
        with pytest.raises(ConfigError):
            WireScoreConfig(**wrong)
