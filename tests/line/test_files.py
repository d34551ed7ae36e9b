"""Files of wires and surveys hold every field, as strict JSON, and what cannot be read is refused in words.

The texts are stored in tests/snapshots/line_*.txt; ``pytest --update-snapshots`` writes them anew.
"""

import json
from collections.abc import Callable
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.conftest import SNAPSHOTS

from plnerf.errors import SurveyError
from plnerf.findings import Finding, harms, note
from plnerf.line.base import Base
from plnerf.line.clearances import (
    Clearances,
    Crossing,
    Group,
    Place,
    Possible,
    Profile,
    Requirement,
    WireClearance,
)
from plnerf.line.cloud import Cloud
from plnerf.line.coverage import Coverage
from plnerf.line.ends import Attached, Evidence, Open, Quantity
from plnerf.line.files import (
    SURVEY_VERSION,
    read_survey,
    read_wires,
    survey_json,
    write_survey_json,
    write_wires,
)
from plnerf.line.frame import LineFrame
from plnerf.line.line import Line, Span, Structure
from plnerf.line.rules import Judged, NotJudged, Rule, RuleReport
from plnerf.line.states import Load, State, States, WireState
from plnerf.line.survey import Survey
from plnerf.line.wire import Wire

RANDOM = np.random.default_rng(4)
FRAME = LineFrame(
    Rotation.from_euler("zyx", [40, 1, -2], degrees=True).as_matrix(), 1.25,
    np.array([500_123.456789012, 5_700_000.1, 31.0]), "m", "EPSG:25832", np.array([10.1, 51.2, 250.3]), 0.05,
)  # fmt: skip


def wire(number: int, **more: Any) -> Wire:
    """With a value of its own in every field."""
    root = RANDOM.normal(0, 0.05, (6, 6))
    first = Attached(1, RANDOM.normal(0, 50, 3), 0.123)
    evidence = Evidence("83 images", 83, 0.87, 3.25, 0.012, 0.034, False, 0.21, ((0.5, 20.25), (31.0, 60.0)))
    base = Base(RANDOM.normal(0, 50, 2), RANDOM.normal(200, 50, 2))
    theta = np.array([0.1, -0.2, 30.0, 33.3, 4.4, 0.05])
    made = Wire(
        number, base, theta, root @ root.T, (first, Open("not filmed")), evidence,
        "communication", 3, 0.0316, "phase A 1", ("Its bend is a prior's.", "A pole hides 3 m of it."),
    )  # fmt: skip
    return replace(made, **more)


def place(number: int, to: Group, distance: float) -> Place:
    points = RANDOM.normal(0, 50, (2, 3))
    return Place(number, 1, "phase", to, 5, "distance", distance, 0.21, 17.5, *points)


def states() -> States:
    """Two, the second without wires."""
    root = RANDOM.normal(0, 0.05, (6, 6))
    lengths = [Quantity(*RANDOM.uniform(1, 9, 2).tolist()) for _ in range(4)]
    one = WireState(2, RANDOM.normal(0, 5, 6), root @ root.T, *lengths, 0.23, 312.5)
    loads = (Load("hot", 75.0), Load("ice, to the left", -5.0, 300.0, 12.5, 611.0))
    made_of = (("phase", "a conductor (a page)"), ("shield", "a strand (a sheet)"))
    shown = (State(loads[0], (one, replace(one, wire=1, strength_share=None))), State(loads[1], ()))
    return States(shown, Quantity(17.5, 3.0), "given", made_of)


def rules() -> RuleReport:
    """Of two rules, one of which was not judged."""
    kept = ("still", "ice"), 6.7, "5.00 m + 1.70 m (D_el)", "a page", False, "a note"
    return RuleReport(
        "a matrix", "a standard", "2026", 220.0, ("An example.",),
        (Rule(1, "ground", "vertical", *kept), Rule(3, "road", "radial", ("wind",), 7.0, "7 m", "b", True)),
        (Judged(1, "hot", 1, 1, 2, Quantity(7.125, 0.25), *RANDOM.normal(0, 50, (2, 3)), "clear"),),
        (NotJudged(3, "road", "vertical", "no road of a map is given"),), (("road", 2), ("rail", 1)),
    )  # fmt: skip


def survey() -> Survey:
    """With a value of its own in every field but the points of its cloud, and its pictures."""
    held = Attached(2, RANDOM.normal(0, 50, 3), 0.05)
    both = wire(2, ends=(held, replace(held, structure=1)), kind="phase", bundle=None, name=None, notes=())
    points = replace(wire(3, kind="shield", diameter_m=None), evidence=Evidence("1,204 points", 1204))
    structures = (
        Structure(1, RANDOM.normal(0, 50, 3), 31.5, 0.4, "two wires end here", "strain", "12A", 12.5),
        Structure(2, RANDOM.normal(0, 50, 3), 28.0, 0.1, "its body"),
    )
    lines = (
        Line(
            1,
            structures,
            (Span(1, (1, 2), (wire(1), both)), Span(2, (2, None), (points,))),
            "A to B",
            2,
            110.0,
        ),
        Line(2, (), (Span(3, (None, None), (wire(4),)),)),
    )
    n = 7
    gaps = np.where(np.arange(n) % 3 == 0, np.nan, RANDOM.uniform(3, 9, n))
    profile = Profile(
        2, np.linspace(0, 60, n), RANDOM.normal(0, 50, (n, 3)), RANDOM.uniform(0, 1, n), gaps, gaps + 1,
        {"ground": gaps + 2, "vegetation": np.full(n, np.nan)},
    )  # fmt: skip
    places: dict[Group, tuple[Place, ...]] = {
        "ground": (), "vegetation": (place(2, "vegetation", 2.1), place(2, "vegetation", 4.4)),
        "structures": (place(2, "structures", 9.0),), "other": (),
    }  # fmt: skip
    vertical = replace(place(2, "ground", 7.7), measure="vertical")
    clearances = Clearances(
        (WireClearance(2, 1, "phase", places, vertical, profile), replace(
            WireClearance(4, 3, "shield", dict.fromkeys(places, ()), None, profile), wire=4)),
        Requirement(2.5, ("vegetation",), "a rule", "a page", "2026-01-01", ("Indoors it is not valid.",)),
        "at 20 degrees",
        (Crossing(2, 4, 6.125, 0.05, 17.5, 31.25, *RANDOM.normal(0, 50, (2, 3)), 6.5),),
        (Possible(place(2, "vegetation", 1.1), 2, 7), Possible(place(4, "other", 1.3), 5, 0, True),
         Possible(place(4, "other", 1.4), 5, 0, at_structure=True)),
    )  # fmt: skip
    return Survey(
        frame=FRAME,
        lines=lines,
        cloud=Cloud(RANDOM.normal(size=(9, 3)), np.array([2, 2, 5, 14, 14, 14, 13, 15, 1], np.uint8),
                    np.array([0, 0, 0, 1, 1, 2, 3, 0, 0])),
        source="run/",
        made={"input": "83 images", "preset": "pl-nerf-wire"},
        settings={"detect": {"certain_px": 3.0}, "scales": [0.7, 1.4], "path": None},
        clearances=clearances,
        coverage=(Coverage(1, 1, gaps - 5, gaps, gaps / 9, np.full(n, np.nan), gaps, 0.5),),
        findings=(note("frame", "No CRS is known."), harms("gap", "A wire is hidden.", "Fly again."),
                  Finding("noise", "stops", "Nothing is seen.", ("wire 3", "0007.jpg"), "Do.")),
        temperature_c=17.5,
        states=states(),
        rules=rules(),
        detected=(wire(1), wire(2)),
        from_images=True,
    )  # fmt: skip


def assert_same(one: Any, other: Any, where: str = "") -> None:
    """Every field, to the last bit, all the way down."""
    if is_dataclass(one):
        assert type(one) is type(other), where
        for field in fields(one):
            assert_same(getattr(one, field.name), getattr(other, field.name), f"{where}.{field.name}")
    elif isinstance(one, np.ndarray):
        assert one.shape == other.shape and one.dtype == other.dtype, where
        np.testing.assert_array_equal(one, other, where)
    elif isinstance(one, dict):
        assert list(one) == list(other), where
        for key in one:
            assert_same(one[key], other[key], f"{where}[{key}]")
    elif isinstance(one, tuple | list):
        assert type(one) is type(other) and len(one) == len(other), where
        for i, pair in enumerate(zip(one, other, strict=True)):
            assert_same(*pair, f"{where}[{i}]")
    else:
        assert type(one) is type(other) and one == other, where


def refuse(word: str) -> float:
    raise AssertionError(f"{word} is no JSON")


def test_a_survey_comes_back_as_it_was(tmp_path: Path) -> None:
    """But for what lies in other files: the cloud, the field's points of wires, and the pictures."""
    made = survey()
    write_survey_json(tmp_path / "survey.json", made)
    found = read_survey(tmp_path / "survey.json")
    assert len(found.cloud.xyz) == 0 and found.wire_points is None and found.pictures == ()
    assert_same(replace(made, cloud=found.cloud), found)
    write_survey_json(tmp_path / "again.json", replace(found, cloud=made.cloud))
    assert (tmp_path / "again.json").read_bytes() == (tmp_path / "survey.json").read_bytes()


def test_a_survey_without_anything_comes_back(tmp_path: Path) -> None:
    made = Survey(LineFrame(np.eye(3), 1.0, np.zeros(3), "unscaled"), (), Cloud.empty(), "scene/")
    write_survey_json(tmp_path / "survey.json", made)
    assert_same(replace(made, cloud=Cloud.empty()), read_survey(tmp_path / "survey.json"))


def test_the_file_is_strict_and_states_what_there_is(tmp_path: Path) -> None:
    """No NaN; lengths with deviations where both ends are held, else the reason; verdicts; counts."""
    made = survey()
    write_survey_json(tmp_path / "survey.json", made)
    content = json.loads((tmp_path / "survey.json").read_text(), parse_constant=refuse)
    assert content == json.loads(json.dumps(survey_json(made), allow_nan=False))
    assert content["format_version"] == SURVEY_VERSION and content["points"] == 9
    assert content["points_by_class"] == {"1": 1, "2": 2, "5": 1, "13": 1, "14": 3, "15": 1}
    assert content["frame"]["unit"] == "m" and content["frame"]["crs"] == "EPSG:25832"
    loose, held = content["lines"][0]["spans"][0]["wires"]
    for key in ("sag", "span_length", "p"):
        assert loose[key] is None and set(held[key]) == {"value", "sigma"}
    assert loose["no_sag_because"] == "the last end is open (not filmed)" and held["no_sag_because"] is None
    wire_ = made.lines[0].spans[0].wires[1]
    assert wire_.sag is not None and held["sag"]["value"] == wire_.sag.value
    np.testing.assert_array_equal(held["points_at_ends"], wire_.points(np.array([0.0, wire_.base.length_m])))
    (first, _) = content["clearances"]["wires"]
    near, far = first["places"]["vegetation"]
    assert (near["verdict"], far["verdict"]) == ("within its uncertainty", "clear")
    assert first["profile"]["ground_z"][0] is None and first["profile"]["ground_z"][1] > 0


def test_numbers_from_numpy_are_numbers(tmp_path: Path) -> None:
    """Whatever type a stage left in a field."""
    made = replace(survey(), settings={"n": np.int64(3), "x": np.float32(0.5), "far": float("inf")})
    write_survey_json(tmp_path / "survey.json", replace(made, temperature_c=np.float64(8.0)))
    found = read_survey(tmp_path / "survey.json")
    assert found.settings == {"n": 3, "x": 0.5, "far": None} and found.temperature_c == 8.0


def test_wires_come_back_as_they_were(tmp_path: Path) -> None:
    made = (wire(1), wire(2, kind="unknown", bundle=None, notes=()), wire(7, ends=(Open("a"), Open("b"))))
    write_wires(tmp_path / "wires.json", made, FRAME, {"detect": {"certain_px": 3.0}})
    json.loads((tmp_path / "wires.json").read_text(), parse_constant=refuse)
    found, frame = read_wires(tmp_path / "wires.json")
    assert_same(made, found)
    assert_same(FRAME, frame)
    write_wires(tmp_path / "none.json", (), FRAME, {})
    assert read_wires(tmp_path / "none.json")[0] == ()


def put(path: Path, content: Any) -> Path:
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def of_survey(spoil: Callable[[dict[str, Any]], Any]) -> Callable[[Path], Path]:
    def spoilt(here: Path) -> Path:
        data = survey_json(survey())
        spoil(data)
        return put(here / "survey.json", data)

    return spoilt


def first_wire(data: dict[str, Any]) -> dict[str, Any]:
    row: dict[str, Any] = data["lines"][0]["spans"][0]["wires"][0]
    return row


SURVEYS: dict[str, Callable[[Path], Path]] = {
    "survey_not_there": lambda here: here / "survey.json",
    "survey_that_is_no_json": lambda here: put(here / "survey.json", "{"),
    "survey_that_is_a_list": lambda here: put(here / "survey.json", []),
    "survey_of_format_1": lambda here: put(here / "survey.json", {"format_version": 1, "wires": []}),
    "survey_of_format_2": lambda here: put(here / "survey.json", {"format_version": 2, "conductors": []}),
    "survey_of_a_later_format": lambda here: put(here / "survey.json", {"format_version": 99}),
    "survey_without_lines": of_survey(lambda data: data.pop("lines")),
    "survey_without_a_covariance": of_survey(lambda data: first_wire(data).pop("covariance")),
    "survey_with_a_null_in_a_curve": of_survey(lambda data: first_wire(data)["theta"].__setitem__(2, None)),
    "survey_with_five_numbers_of_a_curve": of_survey(lambda data: first_wire(data)["theta"].pop()),
    "survey_with_a_list_for_a_text": of_survey(lambda data: data["made"].update(by=["a"])),
    "survey_of_an_unknown_unit": of_survey(lambda data: data["frame"].update(unit="ft")),
}
WIRES: dict[str, Callable[[Path], Path]] = {
    "wires_not_there": lambda here: here / "wires.json",
    "wires_of_another_format": lambda here: put(here / "wires.json", {"format_version": 99}),
    "wires_without_a_frame": lambda here: put(here / "wires.json", {"format_version": 1, "wires": []}),
    "wires_that_are_none": lambda here: put(
        here / "wires.json", {"format_version": 1, "wires": [{"id": 1}], "frame": {}}
    ),
}


@pytest.mark.parametrize("name", [*SURVEYS, *WIRES])
def test_text_of_wrong_files(name: str, tmp_path: Path, snapshot: Callable[[str, str], None]) -> None:
    path = (SURVEYS | WIRES)[name](tmp_path)
    with pytest.raises(SurveyError) as caught:
        (read_survey if name in SURVEYS else read_wires)(path)
    text = str(caught.value)
    assert "\n" not in text
    snapshot(f"line_{name}", text.replace(str(tmp_path), "<here>"))


def test_no_stored_text_is_left_over() -> None:
    stored = {path.stem for path in SNAPSHOTS.glob("line_*.txt")}
    assert stored == {f"line_{name}" for name in SURVEYS | WIRES}
