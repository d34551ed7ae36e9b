"""`plnerf score`: from files to numbers; whatever is wrong with a file ends in one paragraph.

The texts are stored in tests/snapshots/score_*.txt; ``pytest --update-snapshots`` writes them anew.
"""

import json
import shutil
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.conftest import SNAPSHOTS
from tests.support.spans import on, span, wire

import plnerf
from plnerf.cli.main import main
from plnerf.errors import SurveyError
from plnerf.scene.ply import write_ply
from plnerf.score.clouds import read_points
from plnerf.score.places import find_points, find_truth
from plnerf.score.point_report import markdown, to_json
from plnerf.score.points import score_points
from plnerf.score.score import score_files
from plnerf.score.truth import read_truth

BUNDLED = Path(plnerf.__file__).parent / "data" / "span"
TRUTH = BUNDLED / "truth.json"
CLOUD = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
Spoil = Callable[[Path], Path]
CASES: dict[str, Spoil] = {}


def case(spoil: Spoil) -> Spoil:
    CASES[spoil.__name__] = spoil
    return spoil


def put(path: Path, content: str | bytes) -> Path:
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


@case
def nothing_there(here: Path) -> Path:
    return here / "wires.ply"


@case
def unknown_suffix(here: Path) -> Path:
    return put(here / "wires.e57", "")


@case
def folder_without_points(here: Path) -> Path:
    return here


@case
def ply_without_z(here: Path) -> Path:
    return put(here / "a.ply", CLOUD + "end_header\n1 2\n")


@case
def ply_cut_off(here: Path) -> Path:
    write_ply(here / "a.ply", np.ones((3, 3)))
    return put(here / "a.ply", (here / "a.ply").read_bytes()[:-5])


@case
def ply_of_lists_alone(here: Path) -> Path:
    header = "ply\nformat ascii 1.0\nelement strip 1\nproperty list int int index\nend_header\n"
    return put(here / "a.ply", header + "1 2\n")


@case
def ply_with_an_unknown_type(here: Path) -> Path:
    return put(here / "a.ply", "ply\nformat ascii 1.0\nelement vertex 1\nproperty half x\n")


@case
def ply_that_is_none(here: Path) -> Path:
    return put(here / "a.ply", "<html>404</html>")


@case
def ply_with_words(here: Path) -> Path:
    return put(here / "a.ply", CLOUD + "property float z\nend_header\n1 2 three\n")


@case
def not_a_number(here: Path) -> Path:
    np.save(here / "a.npy", np.array([[1.0, 2, 3], [4, np.nan, 6], [np.inf, 8, 9]]))
    return here / "a.npy"


@case
def array_of_two_columns(here: Path) -> Path:
    np.save(here / "a.npy", np.ones((5, 2)))
    return here / "a.npy"


@case
def array_of_objects(here: Path) -> Path:
    np.save(here / "a.npy", np.array([{}, {}]), allow_pickle=True)
    return here / "a.npy"


@case
def archive_without_points(here: Path) -> Path:
    np.savez(here / "a.npz", cloud=np.ones((2, 3)), colours=np.ones((2, 3)))
    return here / "a.npz"


@case
def table_without_z(here: Path) -> Path:
    return put(here / "a.csv", "id,x,y,height\n1,2,3,4\n")


@case
def table_of_two_columns(here: Path) -> Path:
    return put(here / "a.xyz", "1.5 2.5\n3.5 4.5\n")


@case
def table_with_decimal_commas(here: Path) -> Path:
    return put(here / "a.csv", "x;y;z\n1,5;2,5;3,5\n")


@case
def table_without_anything(here: Path) -> Path:
    return put(here / "a.csv", "")


@case
def geojson_without_heights(here: Path) -> Path:
    line = {"type": "LineString", "coordinates": [[1, 2], [3, 4]]}
    return put(here / "a.geojson", json.dumps({"type": "Feature", "geometry": line}))


@case
def geojson_of_areas(here: Path) -> Path:
    return put(here / "a.geojson", json.dumps({"type": "Polygon", "coordinates": [[[1, 2, 3]]]}))


@case
def geojson_with_a_hole_in_a_line(here: Path) -> Path:
    return put(here / "a.geojson", '{"type": "LineString", "coordinates": [[1, 2, 3], [4, NaN, 6]]}')


@case
def geojson_that_is_none(here: Path) -> Path:
    return put(here / "a.geojson", "[1, 2")


@case
def las_that_is_none(here: Path) -> Path:
    return put(here / "a.laz", b"LASF" + b"\0" * 400)


@case
def no_run_around(here: Path) -> Path:
    write_ply(here / "wires.ply", np.ones((1, 3)))
    return here / "wires.ply"


@case
def run_whose_scene_has_no_truth(here: Path) -> Path:
    write_ply(here / "wires.ply", np.ones((1, 3)))
    (here / "scene").mkdir()
    put(here / "config.json", json.dumps({"scene": str(here / "scene")}))
    return here


@case
def truth_without_wires(here: Path) -> Path:
    put(here / "truth.json", '{"conductors": []}')
    return here / "truth.json"


@case
def truth_that_is_not_there(here: Path) -> Path:
    return here / "truth.json"


@case
def truth_with_a_broken_polyline(here: Path) -> Path:
    return put(here / "truth.json", '{"conductors": [{"name": "A", "polyline": [[1, 2, 3]]}]}')


@case
def truth_seen_backwards(here: Path) -> Path:
    entry = {"polyline": [[0, 0, 9], [9, 0, 9]], "seen_m": [[5, 2]]}
    return put(here / "truth.json", json.dumps({"conductors": [entry]}))


@case
def truth_of_a_polyline_over_two_spans(here: Path) -> Path:
    line = [[0, 0, 9], [20, 0, 8], [40, 0, 9], [60, 0, 8], [80, 0, 9]]
    return put(here / "truth.json", json.dumps({"conductors": [{"name": "A", "polyline": line}]}))


@case
def truth_whose_polyline_is_not_what_it_states(here: Path) -> Path:
    entry = {"a": [0, 0, 9], "b": [40, 0, 9], "sag_m": 1, "polyline": [[0, 0, 9], [20, 0, 8.2], [40, 0, 9]]}
    return put(here / "truth.json", json.dumps({"conductors": [entry]}))


@case
def truth_of_an_unknown_kind(here: Path) -> Path:
    entry = {"kind": "rope", "polyline": [[0, 0, 9], [9, 0, 9]]}
    return put(here / "truth.json", json.dumps({"conductors": [entry]}))


@case
def truth_that_runs_backwards(here: Path) -> Path:
    entry = {"direction": [-1, 0], "polyline": [[0, 0, 9], [9, 0, 9]]}
    return put(here / "truth.json", json.dumps({"conductors": [entry]}))


@case
def truth_that_hangs_straight_down(here: Path) -> Path:
    entry = {"polyline": [[0, 0, 9], [0, 0, 4]]}
    return put(here / "truth.json", json.dumps({"conductors": [entry]}))


NO_TRUTH = ("no_run_around", "run_whose_scene_has_no_truth")


@pytest.mark.parametrize("name", CASES)
def test_text_of_wrong_files(name: str, tmp_path: Path, snapshot: Callable[[str, str], None]) -> None:
    survey = CASES[name](tmp_path)
    truth: Path | None = None if name in NO_TRUTH else TRUTH
    if name.startswith("truth_"):
        write_ply(tmp_path / "wires.ply", np.ones((1, 3)))
        survey, truth = tmp_path / "wires.ply", survey
    with pytest.raises(SurveyError) as caught:
        score_files(survey, truth=truth, out=tmp_path / "score.json")
    text = str(caught.value)
    assert "\n" not in text and not (tmp_path / "score.json").exists()
    snapshot(f"score_{name}", text.replace(str(tmp_path), "<here>"))


def test_no_stored_text_is_left_over() -> None:
    stored = {path.stem for path in SNAPSHOTS.glob("score_*.txt")}
    assert stored == {f"score_{name}" for name in CASES}


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    """A scene folder that has nothing but its truth."""
    (tmp_path / "scene").mkdir()
    shutil.copy(TRUTH, tmp_path / "scene" / "truth.json")
    return tmp_path / "scene"


def test_the_bundled_truth_scores_one_against_itself(
    scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """By the command, from a run folder: the survey's file and the scene's truth are found."""
    survey = tmp_path / "run" / "survey"
    write_ply(survey / "wires.ply", on(read_truth(TRUTH)))
    put(tmp_path / "run" / "config.json", json.dumps({"scene": str(scene)}))
    for place in (tmp_path / "run", survey, survey / "wires.ply"):
        monkeypatch.setattr(sys, "argv", ["plnerf", "score", str(place)])
        main()
        out = capsys.readouterr().out
        assert "| 5 cm | 100.0% | 100.0% | 100.0% |" in out and str(survey / "wires.score.json") in out
    content = json.loads((survey / "wires.score.json").read_text())
    assert content["overall"] == {
        f"{a}_{b}cm": 1.0 for a in ("recall", "precision", "f1") for b in (5, 10, 25)
    }
    assert content["worst"]["covered_share"] == 1 and len(content["wires"]) == 4
    assert content["truth"] == str(scene / "truth.json") and content["rules"]


def test_lines_score_as_their_points_do(tmp_path: Path) -> None:
    """The truth's polylines as GeoJSON: the vertices are 25 cm apart, the line between them is whole."""
    lines = [line["polyline"] for line in json.loads(TRUTH.read_text())["conductors"]]
    geometry = {"type": "MultiLineString", "coordinates": lines}
    put(tmp_path / "conductors.geojson", json.dumps({"type": "Feature", "geometry": geometry}))
    assert find_points(tmp_path) == tmp_path / "conductors.geojson"
    score = score_points(read_points(find_points(tmp_path)).points, read_truth(TRUTH))
    assert score.f1 == (1, 1, 1)


def test_the_scene_names_its_truth() -> None:
    assert find_truth(BUNDLED).samefile(TRUTH)
    wires = read_truth(TRUTH).wires
    assert [line.name for line in wires] == ["phase A", "phase B", "phase C", "shield"]
    assert all(abs(line.span_m.value - 40) < 1e-5 for line in wires)


def test_table_and_values_say_the_same() -> None:
    truth = span(wire(0.0, name="left"), wire(3.0, name="right"))
    score = score_points(on(span(wire(0.0))) + np.array([0.0, 0.07, 0.0]), truth)
    content = to_json(score)
    left, right = content["wires"]
    assert (left["recall_5cm"], left["recall_10cm"], right["recall_10cm"]) == (0, 1, 0)
    assert content["mean"]["recall_10cm"] == 0.5 and content["worst"]["recall_10cm"] == 0
    assert content["worst"]["longest_gap_m"] == right["longest_gap_m"] > 38
    assert content["worst"]["horizontal_rmse_m"] == pytest.approx(0.07) and right["horizontal_rmse_m"] is None
    table = markdown(score)
    assert "| left | 0.0% | 100.0% | 100.0% | 100.0% |" in table and "| right | 0.0% |" in table
    assert "| 10 cm | 50.0% | 100.0% | 66.7% |" in table
    blind = replace(truth.wires[1], evidence=replace(truth.wires[1].evidence, seen_m=()))
    content = to_json(score_points(on(span(wire(0.0))), span(truth.wires[0], blind)))
    assert content["mean"]["recall_5cm"] == 1 and "right" in content["notes"][0]
    assert json.loads(json.dumps(content, allow_nan=False)) == content
