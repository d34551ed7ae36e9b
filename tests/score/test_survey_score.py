"""A survey scored: exact ones have no error, known errors are found, draws are as certain as they say."""

import json
import re
import shutil
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.support.catenary_surveys import conductor, corridor, wires
from tests.support.spans import moved, span, wire

from plnerf.capture.similarity import Similarity
from plnerf.cli.main import main
from plnerf.errors import SurveyError
from plnerf.line.catenary import Catenary, hang
from plnerf.report.data import Clearance
from plnerf.report.deliver import SurveyOptions, deliver
from plnerf.scene.transforms import flip_camera_axes
from plnerf.score.align import cameras_of
from plnerf.score.clearances import DOWN, PLANTS, score_clearances
from plnerf.score.clouds import write_ply
from plnerf.score.found import read_survey
from plnerf.score.score import score_survey
from plnerf.score.truth import TruePlant, TrueWire, WireTruth, read_truth
from plnerf.score.wires import LEAST_COMMON_M, RULES, ConductorScore, score_conductors
from plnerf.survey.fit import Base, CatenaryFit
from plnerf.survey.model import Conductor, Kind

TRUTH = span(*(wire(y, name=name) for y, name in ((0.0, "A"), (3.0, "B"), (6.0, "C"))))


def curve_of(true: TrueWire) -> Catenary:
    a, b = (tuple(float(x) for x in end) for end in true.polyline[[0, -1]])
    return hang(a, b, 1.2)


def exact(true: TrueWire, number: int, off: np.ndarray | None = None, kind: Kind = "phase") -> Conductor:
    """A conductor with the wire's own curve, moved, as if fitted."""
    curve = curve_of(true)
    a, b = (np.array(end) + (np.zeros(3) if off is None else off) for end in (curve.a, curve.b))
    u = np.array(curve.direction)
    base = Base(a[:2], u, curve.span_m)
    q = np.array([0.0, 0.0, a[2], b[2], curve.span_m**2 / (8 * curve.p_m)])
    fit = CatenaryFit(base, q, np.diag([1e-4] * 4 + [4e-4]), np.ones(0, np.bool_), 0.01, 0.01)
    return Conductor(number, 0, kind, fit, 1.0, 0.1, 60, "60 points")


def all_exact(truth: WireTruth = TRUTH, off: np.ndarray | None = None) -> list[Conductor]:
    return [exact(one, i, off) for i, one in enumerate(truth.wires, 1)]


def test_an_exact_survey_has_no_errors() -> None:
    score = score_conductors(all_exact(), TRUTH.wires)
    assert [(one.wire, one.conductor) for one in score.matches] == [("A", 1), ("B", 2), ("C", 3)]
    assert (score.missing, score.again, score.invented, score.unseen) == ((), (), (), ())
    for one in score.matches:
        assert max(one.rmse_across_m, one.rmse_up_m, one.worst_m) < 1e-4  # between vertices of the polyline
        assert abs(one.sag_error_m) < 1e-4 and abs(one.sag_common_error_m) < 1e-4
        assert one.span_m == pytest.approx(40) == one.span_found_m and one.common_m == pytest.approx(40)
        assert one.kind_right and one.sag_within_95
        assert one.within_95_across == 1 == one.within_95_up


@pytest.mark.parametrize("turn", [0.0, 2.0, 4.0])
@pytest.mark.parametrize("backwards", [False, True])
def test_a_displaced_conductor_gives_the_displacement(turn: float, backwards: bool) -> None:
    """Whichever way it is counted, and wherever the line runs."""
    truth, R = moved(TRUTH, turn, np.array([5e5, 5.7e6, 100.0]))
    conductors = all_exact(truth, R @ np.array([0.0, 0.12, -0.05]))
    if backwards:
        conductors = [turned(one) for one in conductors]
    for one in score_conductors(conductors, truth.wires).matches:
        assert one.rmse_across_m == pytest.approx(0.12, abs=1e-5)
        assert one.rmse_up_m == pytest.approx(0.05, abs=1e-4)
        assert one.worst_m == pytest.approx(0.13, abs=1e-4)
        assert one.within_95_across == 0 and one.within_95_up == 0  # 1.96 times 1 cm is stated
        assert abs(one.sag_error_m) < 1e-4 and one.sag_within_95


def turned(one: Conductor) -> Conductor:
    """The same wire, its ends exchanged."""
    base = one.fit.base
    other = Base(base.o + base.length_m * base.u, -base.u, base.length_m)
    y0, y1, z0, z1, b = one.fit.q
    return replace(one, fit=replace(one.fit, base=other, q=np.array([-y1, -y0, z1, z0, b])))


def test_missing_doubled_and_invented_wires_are_told() -> None:
    unseen = replace(wire(9.0, name="D"), seen_m=())
    found = [
        exact(TRUTH.wires[0], 1),
        exact(TRUTH.wires[0], 2, np.array([0.0, 0.2, 0.0])),
        exact(TRUTH.wires[2], 3, np.array([0.0, 0.0, 0.1]), "shield"),
        exact(TRUTH.wires[1], 4, np.array([0.0, 0.0, 1.0])),
    ]
    score = score_conductors(found, (*TRUTH.wires, unseen))
    assert [(one.wire, one.conductor, one.kind_right) for one in score.matches] == [
        ("A", 1, True), ("C", 3, False),
    ]  # fmt: skip
    assert score.again == ((2, "A"),) and score.invented == (4,)
    assert score.missing == ("B",) and score.unseen == ("D",)
    nothing = score_conductors([], TRUTH.wires)
    assert nothing.missing == ("A", "B", "C") and nothing.share_within_95("sag") is None


def test_of_twins_each_is_its_own_wire_even_if_both_are_off() -> None:
    twins = span(wire(0.0, name="left"), wire(0.4, name="right"))
    score = score_conductors(all_exact(twins, np.array([0.0, 0.3, 0.0])), twins.wires)
    assert [(one.wire, one.conductor) for one in score.matches] == [("left", 1), ("right", 2)]
    one = score_conductors(all_exact(twins)[:1], twins.wires)
    assert one.missing == ("right",) and one.again == ()


def test_wrong_ends_are_told_from_a_wrong_shape() -> None:
    """A conductor that goes on for a metre beyond either attachment has more sag, and lies on the wire."""
    true = TRUTH.wires[0]
    curve = curve_of(true)
    longer = conductor(
        Catenary(*(tuple(p.tolist()) for p in curve.points(np.array([-1.0, 41.0]))), curve.p_m)  # type: ignore[arg-type]
    )
    (one,) = score_conductors([longer], [true]).matches
    assert one.sag_error_m == pytest.approx(1.2 * ((42 / 40) ** 2 - 1), abs=2e-3) and not one.sag_within_95
    assert abs(one.sag_common_error_m) < 1e-3 and one.rmse_up_m < 1e-3
    assert one.common_m == pytest.approx(40, abs=0.05) and one.span_found_m == pytest.approx(42, abs=0.05)
    short = conductor(Catenary(*(tuple(p.tolist()) for p in curve.points(np.array([9.0, 10.5]))), curve.p_m))  # type: ignore[arg-type]
    score = score_conductors([short], [true])
    assert score.missing == ("A",) and score.invented == (1,) and short.fit.base.length_m < LEAST_COMMON_M


def test_draws_of_the_stated_covariance_are_covered() -> None:
    """95 % of sags, and of places across and up, over many surveys."""
    random, true = np.random.default_rng(5), TRUTH.wires[0]
    half = np.array([1.0, 0.4, 1.2, 0.5, 0.9])
    covariance = 4e-4 * np.diag(half**2)
    covariance[2, 4] = covariance[4, 2] = 2e-4
    start = exact(true, 1)
    scores: list[ConductorScore] = []
    for q in random.multivariate_normal(start.fit.q, covariance, 400):
        drawn = replace(start, fit=replace(start.fit, q=q, covariance=covariance))
        scores.append(score_conductors([drawn], [true]))
    for name in ("sag", "across", "up"):
        shares = [score.share_within_95(name) for score in scores]
        assert np.mean(shares) == pytest.approx(0.95, abs=0.03), name  # type: ignore[arg-type]


def test_another_frame_is_told() -> None:
    away = all_exact(off=np.array([5e5, 5.7e6, 0.0]))
    with pytest.raises(SurveyError, match=r"is 5,721,\d+ m away .* is not in the truth's frame"):
        score_conductors(away, TRUTH.wires)


def hills(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    z: np.ndarray = 0.5 * np.sin(x / 7 + 1) + 0.3 * np.cos(y / 9) + 0.1 * x
    return z


def over_hills() -> WireTruth:
    x, y = np.meshgrid(np.arange(-25.0, 26.0), np.arange(-10.0, 11.0, 5.0))
    ground = np.stack([x.ravel(), y.ravel(), hills(x.ravel(), y.ravel())], 1)
    feet = ((0.0, 3.0), (5.0, -4.0), (39.0, 0.0))
    plants = (
        TruePlant(np.array([*foot, 0.0]), clearance, wire)
        for foot, clearance, wire in zip(feet, (4.0, 3.0, 1.0), ("B", "A", "B"), strict=True)
    )
    return replace(TRUTH, ground=ground, plants=tuple(plants))


def down(number: int, at: np.ndarray, distance: float, to: str = DOWN) -> Clearance:
    return Clearance(number, to, distance, 0.1, 0.0, at, at, None, "nothing is required")


def test_the_least_height_above_the_ground_is_that_of_brute_force() -> None:
    truth, found = over_hills(), all_exact()
    stated, true = [], []
    for one in found:
        places = one.fit.curve.points(np.linspace(0, 40, 8001))
        height = places[:, 2] - hills(places[:, 0], places[:, 1])
        true.append(float(height.min()))
        at = places[height.argmin()] + [1.5, 0.0, 0.0]
        stated.append(down(one.id, at, true[-1] + 0.1))
    matches = score_conductors(found, truth.wires).matches
    score = score_clearances(matches, found, stated, truth)
    for one, least in zip(score.ground, true, strict=True):
        assert one.true_m == pytest.approx(least, abs=0.01)
        assert one.error_m == pytest.approx(0.1, abs=0.01) and one.within_95
        assert one.off_along_m == pytest.approx(1.5, abs=0.15)
    (first, *_) = score_clearances(matches, found, [], truth).ground
    assert first.found_m is None and first.error_m is None and first.within_95 is None
    beside = replace(truth, ground=truth.ground + np.array([0.0, 100.0, 0.0]))  # type: ignore[operator]
    assert "no ground below A" in score_clearances(matches, found, stated, beside).notes[0]


def test_the_nearest_plant_is_compared_from_the_axis() -> None:
    truth = over_hills()
    truth = replace(truth, wires=tuple(replace(one, diameter_m=0.04) for one in truth.wires))
    stated = [down(1, np.zeros(3), 5.0, PLANTS), down(2, np.zeros(3), 3.32, PLANTS)]
    found = all_exact()
    plant = score_clearances((), found, stated, truth).vegetation  # the third stands beyond the wires' ends
    assert plant is not None and (plant.wire, plant.conductor) == ("A", 2)
    assert plant.true_m == pytest.approx(3.02) and plant.error_m == pytest.approx(0.3) and not plant.within_95
    for other, why in (
        (replace(truth, houses=2), "2 houses, which surveys do not tell from plants"),
        (replace(truth, plants=()), "the truth says nothing of them"),
        (replace(truth, plants=truth.plants[2:]), "the truth has none between the conductors' ends"),
    ):
        score = score_clearances((), found, stated, other)
        assert score.vegetation is None and why in score.notes[-1]
    assert "states no distance" in score_clearances((), found, (), truth).notes[-1]


@pytest.fixture(scope="module")
def delivered(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The survey.json of three known wires."""
    out = tmp_path_factory.mktemp("delivered")
    deliver(replace(corridor(np.zeros(3)), crs=None), out, SurveyOptions(), made={}, synthetic=False)
    return out / "survey.json"


@pytest.fixture
def folder(delivered: Path, tmp_path: Path) -> Path:
    """A survey folder, and truth.json beside the run folder that it is in."""
    out, origin = tmp_path / "run" / "survey", np.zeros(3)
    out.mkdir(parents=True)
    shutil.copy(delivered, out)
    kinds = ("phase", "phase", "shield")
    entries = [
        {"name": f"wire {i}", "kind": kind, "polyline": one.polyline(0.25).tolist()}
        for i, (one, kind) in enumerate(zip(wires(origin), kinds, strict=True), 1)
    ]
    x, y = np.meshgrid(np.arange(-20.0, 141.0, 10), np.arange(-30.0, 61.0, 10))
    ground = np.stack([x, y, 0.03 * x - 0.02 * y], 2)
    truth = {"conductors": entries, "ground": {"rows": [{"points": row.tolist()} for row in ground]}}
    (tmp_path / "truth.json").write_text(json.dumps(truth))
    return out


def test_a_survey_read_back_is_the_survey(folder: Path) -> None:
    found, survey = read_survey(folder / "survey.json"), corridor(np.zeros(3))
    for one, other in zip(found.conductors, survey.conductors, strict=True):
        assert (one.id, one.span, one.kind) == (other.id, other.span, other.kind)
        assert (one.fit.q == other.fit.q).all() and (one.fit.covariance == other.fit.covariance).all()
        s = np.linspace(0, one.fit.base.length_m, 9)
        assert (one.fit.sigma_at(s) == other.fit.sigma_at(s)).all()
    assert {one.to for one in found.clearances} >= {DOWN, PLANTS}


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
    assert content["conductors"]["rules"] == RULES and content["conductors"]["found"] == 3
    for one in content["conductors"]["wires"]:
        assert abs(one["sag_error_m"]) < 5 * one["sag_sigma_m"] and one["worst_m"] < 0.05
    for one in content["clearances"]["ground"]:
        assert abs(one["error_m"]) < 5 * one["sigma_m"] < 1
    write_ply(folder / "wires.ply", np.concatenate([one.polyline(0.02) for one in wires(np.zeros(3))]))
    score_survey(folder, truth=truth)
    assert "| 5 cm | 100.0% | 100.0% | 100.0% |" in capsys.readouterr().out
    content = json.loads((folder / "survey.score.json").read_text())
    assert content["overall"]["f1_5cm"] == 1 and content["conductors"]["found"] == 3


def test_what_the_refit_gained_is_told(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Every wire 2 cm higher before it, and with ends of its own."""
    path = folder / "survey.json"
    data = json.loads(path.read_text())
    for row in data["conductors"]:
        row["end_sigma"] = [0.1, 0.2]
        y0, y1, z0, z1, b = row["q"]
        row["before_refit"] = {**row, "q": [y0, y1, z0 + 0.02, z1 + 0.02, b]}
    path.write_text(json.dumps(data))
    first = read_survey(path).conductors[0]
    assert first.fit.end_sigma_m == (0.1, 0.2) and first.before is not None
    score_survey(folder, truth=folder.parent.parent / "truth.json")
    assert "| before the refit | sag error" in capsys.readouterr().out
    scored = json.loads((folder / "survey.score.json").read_text())["conductors"]
    for now, before in zip(scored["wires"], scored["before_refit"], strict=True):
        assert before["rmse_up_m"] == pytest.approx(0.02, abs=3 * now["rmse_up_m"])
        assert before["rmse_across_m"] == pytest.approx(now["rmse_across_m"])


def test_a_truth_in_another_frame_is_moved_by_its_cameras(
    folder: Path, tiny_scene: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The survey's scene is the tiny one; the truth's cameras and wires lie elsewhere, in the same way."""
    truth = folder.parent.parent / "truth.json"
    score_survey(folder, truth=truth)
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
        score_survey(folder, truth=truth)
    score_survey(folder, truth=truth, by_cameras=tiny_scene)
    assert "by 12 cameras, which are 0.000 m off" in capsys.readouterr().out
    content = json.loads((folder / "survey.score.json").read_text())
    for one, other in zip(content["conductors"]["wires"], before, strict=True):
        for key in ("sag_m", "rmse_across_m", "rmse_up_m", "worst_m", "common_m"):
            assert one[key] == pytest.approx(other[key], abs=1e-6)
    assert content["aligned"]["scale"] == pytest.approx(1) and len(content["clearances"]["ground"]) == 3


Spoil = Callable[[dict], object]
SPOILT: dict[str, tuple[Spoil, str]] = {
    "older": (lambda data: data.update(format_version=1), "has the format version 1, but 2 is needed"),
    "unscaled": (lambda data: data.update(unit="unscaled"), "has the unit 'unscaled', so that its"),
    "uncertain": (lambda data: data["conductors"][0].pop("covariance"), r"is not what .*\('covariance'\)"),
    "null": (lambda data: data["conductors"][0].update(q=[None] * 5), "expected finite numbers of the shape"),
}


@pytest.mark.parametrize("name", SPOILT)
def test_what_is_no_survey_in_metres_is_told(folder: Path, name: str) -> None:
    spoil, text = SPOILT[name]
    data = json.loads((folder / "survey.json").read_text())
    spoil(data)
    (folder / "survey.json").write_text(json.dumps(data))
    with pytest.raises(SurveyError, match=text):
        score_survey(folder, truth=folder.parent.parent / "truth.json")
    assert not (folder / "survey.score.json").exists()


def test_what_is_no_survey_at_all_is_told(folder: Path, tmp_path: Path) -> None:
    (folder / "survey.json").write_text("{")
    with pytest.raises(SurveyError, match="is not valid JSON"):
        score_survey(folder, truth=tmp_path / "truth.json")
    with pytest.raises(SurveyError, match=re.escape(f"{tmp_path}/survey.json cannot be read (No such file")):
        score_survey(tmp_path / "survey.json", truth=tmp_path / "truth.json")


def test_the_truth_of_plants_must_be_numbers(tmp_path: Path) -> None:
    path = tmp_path / "truth.json"
    line = {"polyline": [[0, 0, 9], [20, 0, 8], [40, 0, 9]]}
    plant = {"foot": [0, 0, 0], "clearance_m": "near"}
    path.write_text(json.dumps({"conductors": [line], "vegetation": [plant]}))
    with pytest.raises(SurveyError, match="plant 0, clearance_m: expected a finite number, but found 'near'"):
        read_truth(path)
    path.write_text(json.dumps({"conductors": [line], "ground": {"rows": [{"points": [[0, 0]]}]}}))
    with pytest.raises(SurveyError, match="ground: expected 1 or more points of three finite numbers"):
        read_truth(path)
    path.write_text(json.dumps({"conductors": [line]}))
    assert read_truth(path).wires[0].sag_m == pytest.approx(1) and read_truth(path).ground is None
