"""Two surveys of a line are matched by place; what differs is told from errors and from temperature."""

import csv
import json
import sys
from dataclasses import replace
from functools import cache
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from tests.support import many_spans, surveys

from plnerf.change.change_files import change_rows, change_text, write_change
from plnerf.change.compare_surveys import compare_surveys
from plnerf.change.places import onto
from plnerf.cli.main import main
from plnerf.errors import SurveyError
from plnerf.line.clearances import Clearances, WireClearance
from plnerf.line.files import write_survey_json
from plnerf.line.frame import LineFrame
from plnerf.line.hang import hang
from plnerf.line.line import Line
from plnerf.line.move import move_wire
from plnerf.line.states import Load
from plnerf.line.survey import Survey
from plnerf.line.wire import Wire
from plnerf.mechanics.config import MechanicsConfig
from plnerf.mechanics.states import compute_states
from plnerf.survey.clearance import measure_clearances
from plnerf.survey.config_ground import ClearanceConfig

ALST = MechanicsConfig(Path("243-al1-39-st1a"))
TURN = surveys.turned(37.0)


@cache
def first() -> Survey:
    return replace(surveys.short(0.1), temperature_c=20.0)


def with_wires(survey: Survey, change) -> Survey:  # type: ignore[no-untyped-def]
    """Its wires changed one by one."""
    lines = tuple(
        replace(line, spans=tuple(
            replace(span, wires=tuple(change(wire) for wire in span.wires)) for span in line.spans
        ))
        for line in survey.lines
    )  # fmt: skip
    return replace(survey, lines=lines)


def flown_again(survey: Survey, seed: int) -> Survey:
    """With errors of its own, as large as are stated."""
    random = np.random.default_rng(seed)

    def off(wire: Wire) -> Wire:
        return replace(wire, theta=random.multivariate_normal(wire.theta, wire.covariance))

    return with_wires(survey, off)


def in_another_frame(survey: Survey) -> Survey:
    """The same survey, its LineFrame turned and shifted, its wires and structures numbered otherwise."""
    frame = replace(
        survey.frame, R_line_world=TURN @ survey.frame.R_line_world,
        origin_world=survey.frame.origin_world + np.array([5.0, -3.0, 1.0]),
    )  # fmt: skip
    to = onto(survey.frame, frame)

    def line(one: Line) -> Line:
        masts = tuple(replace(mast, id=mast.id + 7, foot=to(mast.foot[None])[0]) for mast in one.structures)
        spans = tuple(
            replace(span, wires=tuple(
                replace(move_wire(wire, survey.frame, frame), id=wire.id + 20) for wire in span.wires
            ))
            for span in one.spans
        )  # fmt: skip
        return replace(one, structures=masts, spans=spans)

    def near(one: WireClearance) -> WireClearance:
        places = {
            group: tuple(
                replace(
                    place, wire=place.wire + 20, on_wire=to(place.on_wire[None])[0],
                    on_obstacle=to(place.on_obstacle[None])[0],
                )
                for place in found
            )
            for group, found in one.places.items()
        }  # fmt: skip
        return replace(one, wire=one.wire + 20, places=places)

    assert survey.clearances is not None
    clearances = Clearances(tuple(near(one) for one in survey.clearances.wires))
    lines = tuple(line(one) for one in survey.lines)
    return replace(survey, frame=frame, lines=lines, clearances=clearances)


@pytest.mark.skipif(find_spec("mechaphlowers") is None, reason="plnerf[mechanics] is not installed")
def test_a_survey_flown_again_is_the_same_whatever_its_frame_and_numbers() -> None:
    for seed in range(6):
        found = compare_surveys(first(), in_another_frame(flown_again(first(), seed)), ALST)
        assert found.different == 0, change_text(found)
    assert [(one.a, one.b) for one in found.structures] == [(1, 8), (2, 9)]
    assert [(one.a, one.b) for one in found.sags] == [(k, k + 20) for k in range(1, 6)]
    assert found.comparisons > 15 and found.sigmas > 2.9
    judged = [one.standing for one in found.sags if one.expected_m is not None]
    assert set(judged) == {"within the uncertainties"}
    assert all(one.moved_m is not None and one.moved_m.value < 1e-6 for one in found.structures)


def test_wires_of_a_bent_line_are_matched_span_by_span() -> None:
    survey = many_spans.bent()
    found = compare_surveys(survey, survey)
    assert {(one.a, one.b) for one in found.sags} == {(wire.id, wire.id) for wire in survey.wires}
    assert not found.wires and found.different == 0


def warmer(survey: Survey, degrees: float) -> Survey:
    """Its phases as they hang at another temperature; the survey states it."""
    loads = [Load("hot", 20.0 + degrees)]
    states, _ = compute_states(survey.lines, 20.0, ALST, loads)
    assert states is not None
    hot = {one.wire: one for one in states.states[0].wires}

    def change(wire: Wire) -> Wire:
        return replace(wire, theta=hot[wire.id].theta) if wire.id in hot else wire

    return replace(with_wires(survey, change), temperature_c=20.0 + degrees)


def test_thirty_degrees_are_found_within_their_interval_and_explained() -> None:
    pytest.importorskip("mechaphlowers", reason="plnerf[mechanics] is not installed")
    hot = warmer(first(), 30.0)
    found = compare_surveys(first(), flown_again(hot, 1), ALST)
    assert found.different == 0, change_text(found)
    phases = {wire.id for wire in first().wires if wire.kind == "phase"}
    for one in found.sags:
        if one.a not in phases:
            continue
        before, after = (next(w for w in s.wires if w.id == one.a).sag for s in (first(), hot))
        assert before is not None and after is not None and one.difference_m is not None
        true = after.value - before.value
        assert true > 0.08 and abs(one.difference_m.value - true) < one.difference_m.half_95
        assert one.standing == "explained by temperature" and one.rest_m is not None
        assert abs(one.rest_m.value) < one.rest_m.half_95
    cold = compare_surveys(first(), replace(hot, temperature_c=20.0), ALST)  # which is not true
    wrong = [one.standing for one in cold.sags if one.a in phases]
    assert set(wrong) == {"different"}
    assert all(one.standing in {"different", "within the uncertainties"} for one in cold.clearances)


def test_wind_at_a_survey_is_not_taken_for_its_temperature() -> None:
    """Both were flown in the same wind: at one temperature, nothing is expected of either."""
    pytest.importorskip("mechaphlowers", reason="plnerf[mechanics] is not installed")
    swing = np.array([0, 0, 0, 0, 0, 0.3])
    blown = measured(with_wires(first(), lambda wire: replace(wire, theta=wire.theta + swing)))
    found = compare_surveys(blown, blown, ALST)
    expected = [one.expected_m for one in (*found.sags, *found.clearances) if one.expected_m is not None]
    assert len(expected) > 8 and max(abs(one.value) for one in expected) < 1e-9


def measured(survey: Survey) -> Survey:
    """With points known to a centimetre, and nothing between them: the spacing of these few would hide what
    wires do."""
    known = replace(survey.cloud, sigma_m=np.full(len(survey.cloud.xyz), 0.01))
    config = ClearanceConfig()
    config = replace(config, sampling=replace(config.sampling, point_m=0.01, share=0.001, leaves_m=0.001))
    found, _ = measure_clearances(replace(survey, cloud=known), config)
    return replace(survey, clearances=found)


def test_a_clearance_that_a_warm_wire_lost_is_explained_by_its_wire() -> None:
    """What is below is the same: the wire's own movement makes the difference."""
    pytest.importorskip("mechaphlowers", reason="plnerf[mechanics] is not installed")
    found = compare_surveys(measured(first()), measured(warmer(first(), 60.0)), ALST)
    phases = {wire.id for wire in first().wires if wire.kind == "phase"}
    down = [one for one in found.clearances if one.to == "ground" and one.a in phases]
    assert len(down) == len(phases) and found.different == 0
    for one in down:
        assert one.difference_m.value < -0.1 and one.standing == "explained by temperature"
        assert one.expected_m.value == pytest.approx(one.difference_m.value, abs=0.03)
        assert abs(one.by_object_m.value) < 0.03
    others = [one for one in found.clearances if one.a not in phases]
    assert {one.standing for one in others} == {"within the uncertainties"}


def test_without_temperatures_sags_are_stated_and_not_judged() -> None:
    lower = np.array([0, 0, 0, 0, 0.4, 0])
    deeper = with_wires(first(), lambda wire: replace(wire, theta=wire.theta + lower))
    found = compare_surveys(first(), replace(deeper, clearances=None))
    assert {one.standing for one in found.sags} == {"not known"} and not found.clearances
    same = compare_surveys(first(), first())
    assert {one.standing for one in same.rows} == {"within the uncertainties"}
    assert all(one.difference_m is not None and one.difference_m.value > 0.35 for one in found.sags)
    assert "is not known without the conductor (--conductor)" in found.notes[0]
    unknown = compare_surveys(first(), replace(deeper, temperature_c=None), ALST)
    assert "without the conductors' temperature at B (--temperature-c of" in unknown.notes[0]
    assert found.different == 0


def grown(survey: Survey, by_m: float) -> Survey:
    """With the tree that is nearest to its first wire grown towards it."""
    assert survey.clearances is not None
    one, *others = survey.clearances.wires
    place = one.places["vegetation"][0]
    up = by_m * (place.on_wire - place.on_obstacle) / place.distance_m
    near = replace(place, on_obstacle=place.on_obstacle + up, distance_m=place.distance_m - by_m)
    wire = replace(one, places=one.places | {"vegetation": (near, *one.places["vegetation"][1:])})
    return replace(survey, clearances=replace(survey.clearances, wires=(wire, *others)))


def test_a_tree_that_grew_while_the_wire_rose_is_different() -> None:
    """By as much: the distance is what it was, and in summer the wire hangs lower again."""
    pytest.importorskip("mechaphlowers", reason="plnerf[mechanics] is not installed")
    hot, cold = measured(warmer(first(), 60.0)), measured(first())
    assert hot.clearances is not None and cold.clearances is not None
    wire = cold.clearances.wires[0].wire
    rise = (cold.clearances.wires[0].places["vegetation"][0].distance_m
            - hot.clearances.wires[0].places["vegetation"][0].distance_m)  # fmt: skip
    found = compare_surveys(hot, grown(cold, rise), ALST)
    (one,) = (each for each in found.clearances if (each.a, each.to) == (wire, "vegetation"))
    assert rise > 0.1 and abs(one.difference_m.value) < 1e-9 and one.standing == "different"
    assert one.by_object_m.value == pytest.approx(-rise, abs=0.02)
    assert one.expected_m.value == pytest.approx(rise, abs=0.02)
    assert found.different == 1, change_text(found)


def test_what_one_survey_alone_has_near_a_wire_is_different() -> None:
    """A crane, of which the other survey has nothing."""
    before = first()
    assert before.clearances is not None
    one, *others = before.clearances.wires
    crane = replace(one.places["vegetation"][0], to="other", class_code=1)
    wire = replace(one, places=one.places | {"other": (crane,)})
    after = replace(before, clearances=replace(before.clearances, wires=(wire, *others)))
    for found, both in ((compare_surveys(before, after), (None, crane.distance_m)),
                        (compare_surveys(after, before), (crane.distance_m, None))):  # fmt: skip
        (changed,) = (each for each in found.rows if each.standing == "different")
        assert changed.to == "other" and found.different == 1
        distances = (changed.distance_a_m, changed.distance_b_m)
        assert tuple(None if each is None else each.value for each in distances) == both
        np.testing.assert_allclose(changed.place, crane.on_obstacle)
    assert "clearance to other things" in change_text(found)


def test_a_new_object_is_told_from_a_wire_that_hangs_lower() -> None:
    """A tree has grown by 1 m towards the first wire; all else is as it was."""
    before = first()
    one = before.clearances.wires[0]  # type: ignore[union-attr]
    found = compare_surveys(before, grown(before, 1.0))
    (changed,) = (each for each in found.clearances if each.standing == "different")
    assert (changed.a, changed.to) == (one.wire, "vegetation") and found.different == 1
    assert changed.by_object_m.value == pytest.approx(-1.0, abs=0.01)
    assert changed.difference_m.value == pytest.approx(-1.0, abs=0.01)
    assert changed.moved_m == pytest.approx(1.0)


def test_a_wire_that_crosses_at_right_angles_is_another() -> None:
    """Its chord has no length along the other wire's."""
    before = first()
    (line,) = before.lines
    wire = line.spans[0].wires[0]
    middle = wire.base.place(np.array([20.0]), wire.at(np.array([20.0])))[0]
    aside = np.array([*wire.base.n, 0.0])
    across = hang(middle - 10 * aside, middle + 10 * aside, 1.0, id=99)
    other = replace(line, id=2, structures=(), spans=(replace(line.spans[0], id=9, wires=(across,)),))
    found = compare_surveys(before, replace(before, lines=(line, other), clearances=None))
    assert [(one.a, one.b) for one in found.wires] == [(None, 99)]
    assert {(one.a, one.b) for one in found.sags} == {(one.id, one.id) for one in before.wires}


def test_a_wire_and_a_structure_that_one_survey_alone_has_are_differences() -> None:
    before = first()
    (line,) = before.lines
    fewer = replace(line.spans[0], wires=line.spans[0].wires[1:])
    after = replace(before, lines=(replace(line, structures=line.structures[:1], spans=(fewer,)),))
    found = compare_surveys(before, after)
    assert [(one.a, one.b) for one in found.wires] == [(1, None)] and found.different == 2
    assert [(one.a, one.b) for one in found.structures] == [(1, 1), (2, None)]
    assert [(one.a, one.b) for one in compare_surveys(after, before).wires] == [(None, 1)]


def test_a_structure_that_moved_is_a_difference() -> None:
    before = first()
    (line,) = before.lines
    moved = replace(line.structures[0], foot=line.structures[0].foot + np.array([0.0, 3.0, 0.0]))
    after = replace(before, lines=(replace(line, structures=(moved, line.structures[1])),))
    one = compare_surveys(before, after).structures[0]
    assert one.moved_m is not None and one.moved_m.value == pytest.approx(3.0)
    assert one.standing == "different"


def test_surveys_of_two_crs_are_laid_over_each_other() -> None:
    """Of UTM zone 32 and of local metres about a place in it."""
    from pyproj import Transformer

    to = Transformer.from_crs("EPSG:4326", "EPSG:25832", always_xy=True)
    x, y = to.transform(9.0, 51.0)
    local = LineFrame(np.eye(3), 1.0, np.zeros(3), "m", "EPSG:25832", np.array([9.0, 51.0, 0.0]))
    utm = LineFrame(np.eye(3), 1.0, np.array([x, y, 0.0]), "m", "EPSG:25832")
    points = np.array([[0.0, 0.0, 12.0], [100.0, 0.0, 12.0]])  # 9 degrees: north is north, scale 0.9996
    np.testing.assert_allclose(onto(local, utm)(points), points * [0.9996, 1, 1], atol=2e-3)
    np.testing.assert_allclose(onto(utm, local)(onto(local, utm)(points)), points, atol=2e-3)


def test_surveys_that_share_no_place_are_refused() -> None:
    nowhere = replace(first(), frame=replace(first().frame, crs=None, origin_lon_lat_height=None))
    with pytest.raises(SurveyError, match=r"is EPSG:25832, that of the other is not known"):
        compare_surveys(first(), nowhere)
    sea, ellipsoid = (
        replace(first(), frame=replace(first().frame, crs=crs)) for crs in ("EPSG:25832+7837", "EPSG:4979")
    )
    with pytest.raises(SurveyError, match=r"heights of one survey are above DHHN2016 .* other above the ell"):
        compare_surveys(sea, ellipsoid)
    with pytest.raises(SurveyError, match=r"in metres, but one is unscaled"):
        compare_surveys(first(), surveys.unscaled())


def test_the_command_writes_files_and_says_by_its_status_whether_anything_differs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, fewer = tmp_path / "a", tmp_path / "b" / "survey.json"
    folder.mkdir(), fewer.parent.mkdir()
    (line,) = first().lines
    write_survey_json(folder / "survey.json", first())
    span = replace(line.spans[0], wires=line.spans[0].wires[1:])
    clearances = replace(first().clearances, wires=first().clearances.wires[1:])  # type: ignore[union-attr, type-var]
    write_survey_json(fewer, replace(first(), lines=(replace(line, spans=(span,)),), clearances=clearances))
    for other, status in ((folder, 0), (fewer, 3)):
        out = tmp_path / f"change-{status}"
        monkeypatch.setattr(sys, "argv", ["plnerf", "change", str(folder), str(other), "-o", str(out)])
        with pytest.raises(SystemExit) as ended:
            main()
        assert ended.value.code == status
        text = capsys.readouterr().out
        assert f" {int(status > 0)} different, 0 not known. A difference counts beyond" in text
        content = json.loads((out / "change.json").read_text())
        assert len(content["wires"]) == int(status > 0) and content["a"].endswith("a/survey.json")
        with (out / "change.csv").open(newline="") as file:
            rows = list(csv.DictReader(file))
        assert [row["what"] for row in rows][:3] == ["structure", "structure", "sag"]
        assert len(rows) == sum(
            len(content[name]) for name in ("structures", "sags", "clearances", "wires")
        )


def test_rows_have_both_figures_and_the_difference(tmp_path: Path) -> None:
    found = compare_surveys(first(), first())
    row = next(one for one in change_rows(found) if one["what"] == "sag")
    assert row["before_m"] == row["after_m"] and row["difference_m"] == 0.0 and row["difference_95_m"]
    write_change(tmp_path / "new", found, Path("a"), Path("b"))
    assert {path.name for path in (tmp_path / "new").iterdir()} == {"change.json", "change.csv"}
