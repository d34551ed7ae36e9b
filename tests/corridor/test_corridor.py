"""A whole corridor from blocks whose wires are known: joined once, numbered once, done once."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from tests.support.corridors import KnownLine, photos_along
from tests.support.many_spans import FEET, PHASES, line_along
from tests.support.read_html import Read

from plnerf.corridor.config import CorridorConfig, CutConfig
from plnerf.corridor.corridor import survey_corridor
from plnerf.corridor.engine import InThisProcess
from plnerf.corridor.ledger import Ledger, Task
from plnerf.corridor.merge import BlockSurvey, merged
from plnerf.corridor.plan import PlannedSpan, overlap_of
from plnerf.corridor.results import CLOUDS, INDEX, MAP, STATE, Corridor, numbered_together
from plnerf.errors import ConfigError, SurveyError
from plnerf.export.gis import Feature
from plnerf.export.layers import Layer
from plnerf.findings import harms, note
from plnerf.line.cloud import Cloud
from plnerf.line.files import SURVEY_FILE, read_survey
from plnerf.line.frame import LineFrame
from plnerf.line.stations import structure_stations
from plnerf.line.survey import Survey
from plnerf.scene.las_files import open_las
from plnerf.survey.config import SurveyConfig
from plnerf.survey.config_names import NamesConfig
from plnerf.survey.part import SpanNumber

LINE = line_along([*FEET, (300.0, -130.0)], PHASES)
"""Four spans of 75 to 92 m, with bends of 1, 27 and 27 degrees."""
CONFIG = CorridorConfig(CutConfig(block_m=70.0, overlap_m=30.0))


def run(scene: Path, out: Path, work: object = None) -> Corridor:
    return survey_corridor(scene, out, CONFIG, InThisProcess(work or KnownLine(LINE)))  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return photos_along(tmp_path_factory.mktemp("corridor") / "scene", LINE)


@pytest.fixture(scope="module")
def done(scene: Path, tmp_path_factory: pytest.TempPathFactory) -> Corridor:
    return run(scene, tmp_path_factory.mktemp("corridor") / "out")


def did(out: Path) -> list[str]:
    path = out / "did.txt"
    names = path.read_text().split() if path.exists() else []
    path.unlink(missing_ok=True)
    return names


@pytest.mark.slow
def test_every_span_and_structure_comes_once(done: Corridor) -> None:
    survey = done.survey
    assert [len(line.spans) for line in survey.lines] == [4]
    assert [span.id for span in survey.spans] == [1, 2, 3, 4]
    assert [one.id for one in survey.structures] == [1, 2, 3, 4, 5]
    assert len(survey.wires) == len(list(LINE.wires))
    assert len({wire.id for wire in survey.wires}) == len(survey.wires)
    assert not done.failed


@pytest.mark.parametrize(("length_m", "reach_m"), [(40.0, 20.0), (300.0, 50.0)])
def test_a_short_span_s_block_is_not_mostly_its_neighbours(length_m: float, reach_m: float) -> None:
    axis = np.array([[0.0, 0.0, 0.0], [0.6 * length_m, 0.8 * length_m, 0.0]])
    span = PlannedSpan(SpanNumber(1, 1, (1, 2), 0.0), axis, ())
    assert overlap_of(span, CutConfig(overlap_m=50.0)) == pytest.approx(reach_m)


def test_wires_are_where_they_are(done: Corridor) -> None:
    frame = done.survey.frame
    ends = np.array([wire.points(np.array([0.0, wire.base.length_m])) for wire in LINE.wires])
    for wire in done.survey.wires:
        mine = frame.to_world(wire.points(np.array([0.0, wire.base.length_m])))
        apart = [min(np.abs(mine - one).max(), np.abs(mine[::-1] - one).max()) for one in ends]
        assert min(apart) < 1e-6


def test_structures_are_shared_and_stations_go_through(done: Corridor) -> None:
    line = done.survey.lines[0]
    truth = list(structure_stations(LINE).values())
    found = list(structure_stations(line).values())
    assert found == pytest.approx(truth) or found == pytest.approx(truth[-1] - np.array(truth)[::-1])
    for span, after in zip(line.spans, line.spans[1:], strict=False):
        assert span.structures[1] == after.structures[0]
    for span in line.spans:
        held = {end.structure for wire in span.wires for end in wire.ends}  # type: ignore[union-attr]
        assert held == set(span.structures)


def test_a_block_counts_stations_from_the_line_s_beginning(done: Corridor) -> None:
    whole = structure_stations(done.survey.lines[0])
    block = read_survey(done.folder / "spans/0003/survey" / SURVEY_FILE)
    mine = structure_stations(block.lines[0])
    assert mine[3] == pytest.approx(whole[3], abs=1.0) and mine[3] > 100


def test_clouds_divide_the_points(done: Corridor) -> None:
    index = json.loads((done.folder / CLOUDS).read_text())
    assert [one["spans"] for one in index] == [[1], [2], [3], [4]]
    points = []
    for one in index:
        with open_las(done.folder / one["file"]) as reader:
            las = reader.read()
        assert len(las.points) == one["points"] > 0
        on = np.asarray(las.wire_id)
        assert set((on[on > 0] - 1) // 100) == set(one["spans"])
        points.append(las.xyz)
    every = np.concatenate(points)
    assert len(every) == 4 * 4 * 80  # each block saw those of its neighbours, too


def test_the_page_leads_to_every_span(done: Corridor) -> None:
    page = Read((done.folder / INDEX).read_text())
    links = [value for tag, name, value in page.attributes if (tag, name) == ("a", "href")]
    assert links[:4] == [f"spans/000{number}/survey/report.html" for number in range(1, 5)]
    assert all((done.folder / link).is_file() for link in links)
    rows = page.tables[0]
    assert [row[1] for row in rows[1:]] == ["1", "2", "3", "4"] and {len(row) for row in rows} == {12}
    state = json.loads((done.folder / STATE).read_text())
    assert state["spans"] == 4 and state["tasks"] == {"done": len(state["records"])}


def test_one_geopackage_holds_all_spans(done: Corridor) -> None:
    pyogrio = pytest.importorskip("pyogrio")
    layers = {name for name, _ in pyogrio.list_layers(done.folder / MAP)}
    assert {"wires", "spans", "structures"} <= layers
    meta, _, _, values = pyogrio.raw.read(done.folder / MAP, layer="wires")
    spans = values[list(meta["fields"]).index("span")]
    assert sorted(set(spans.tolist())) == [1, 2, 3, 4] and len(spans) == 16


def test_encroachments_of_all_blocks_are_numbered_by_priority() -> None:
    def one(kind: Literal["Polygon", "LineString"], number: int, priority: int, margin_m: float) -> Feature:
        about = {
            "encroachment": number, "priority": priority, "margin_m": margin_m, "line": 1, "span": 1,
            "station_m": 5.0,
        }  # fmt: skip
        return Feature(kind, np.zeros((2, 3)), about)

    areas = tuple(one("Polygon", *numbers) for numbers in ((1, 1, -2.0), (2, 4, -0.1), (1, 2, -1.0)))
    layers = {
        "encroachments": Layer("encroachments", areas, "#c62828"),
        "encroaching_crossings": Layer("encroaching_crossings", (one("LineString", 1, 1, -3.0),), "#c62828"),
        "wires": Layer("wires", (Feature("LineString", np.zeros((2, 3)), {"id": 101}),), "#1565c0"),
    }
    found = numbered_together(layers)
    numbers = {name: [of.properties.get("encroachment") for of in layer.features]
               for name, layer in found.items()}  # fmt: skip
    assert numbers == {"encroachments": [2, 4, 3], "encroaching_crossings": [1], "wires": [None]}
    assert [of.properties["in_report"] for of in found["encroachments"].features] == [1, 2, 1]


@pytest.mark.slow
def test_names_are_matched_over_the_whole_corridor(scene: Path, tmp_path: Path) -> None:
    rows = [f"M{one.id},,{one.foot[0] + 3},{one.foot[1]},\n" for one in LINE.structures]
    rows += ["M99,,9000,9000,\n"]
    for phase, wire in zip("ABCD", LINE.spans[0].wires, strict=True):  # of the first span alone
        x, y, z = wire.points(np.array([0.0]))[0]
        rows.append(f",{phase},{x},{y},{z}\n")
    (tmp_path / "names.csv").write_text("name,phase,x,y,z\n" + "".join(rows))
    config = replace(CONFIG, survey=SurveyConfig(names=NamesConfig(tmp_path / "names.csv")))
    found = survey_corridor(scene, tmp_path / "out", config, InThisProcess(KnownLine(LINE)))
    true = {f"M{one.id}": one.foot for one in LINE.structures}
    for one in found.survey.structures:
        assert one.name is not None
        assert np.allclose(found.survey.frame.to_world(one.foot), true[one.name])
    assert [[wire.name for wire in sorted(span.wires, key=lambda wire: str(wire.name))]
            for span in found.survey.spans] == [list("ABCD")] * 4  # fmt: skip
    about = [one.what for one in found.survey.findings if one.kind == "names"]
    assert len(about) == 2 and about[0].startswith("5 of 5 structures") and about[0].endswith("M99.")
    written = read_survey(tmp_path / "out" / SURVEY_FILE)
    assert {one.name for one in written.structures} == true.keys()
    did(tmp_path / "out")
    assert survey_corridor(scene, tmp_path / "out", CONFIG, InThisProcess(KnownLine(LINE))).survey.wires
    assert did(tmp_path / "out") == []  # another list of names, or none, costs no survey


@pytest.mark.slow
def test_what_is_done_is_not_done_again(scene: Path, tmp_path: Path) -> None:
    run(scene, tmp_path)
    first = did(tmp_path)
    assert len(first) == len(set(first)) > 6
    run(scene, tmp_path)
    assert did(tmp_path) == []
    (tmp_path / "spans/0002/survey/cloud.laz").unlink()
    run(scene, tmp_path)
    assert did(tmp_path) == ["spans-0002-survey"]


@pytest.mark.slow
def test_a_block_with_other_photos_is_done_again(scene: Path, tmp_path: Path) -> None:
    own = photos_along(tmp_path / "scene", LINE)
    run(own, tmp_path / "out")
    did(tmp_path / "out")
    (own / "images/0000.jpg").write_bytes(b"another photo")
    run(own, tmp_path / "out")
    again = did(tmp_path / "out")
    assert len([one for one in again if one.startswith("find")]) == 1
    assert 1 <= len([one for one in again if one.startswith("spans")]) <= 2


def test_findings_name_their_spans_and_many_alike_are_few(tmp_path: Path) -> None:
    frame, cloud = LineFrame(np.eye(3), 1.0, np.zeros(3), "m"), Cloud.empty()
    blocks = [
        BlockSurvey(
            tmp_path / f"spans/{k:04d}/survey",
            Survey(
                frame, (), cloud, "a", findings=(note("poses", "All alike."), harms("ends", f"{k} of 9."))
            ),
            (k,),
        )
        for k in range(1, 7)
    ]
    found = merged(blocks, [], frame, "a", {}).findings
    texts = [one.what for one in found]
    assert texts == [
        "Spans 1–6: All alike.",
        "Span 1: 1 of 9. The like is stated of spans 2–6: see their reports.",
    ]
    assert found[1].where == tuple(f"span {k}" for k in range(1, 7))
    assert found[1].kind == "ends" and found[1].degree == "harms"


class Failing(KnownLine):
    """Fails on one span."""

    def __call__(self, out: Path, task: Task) -> None:
        if task.folder == "spans/0002":
            raise SurveyError("a photo is damaged")
        super().__call__(out, task)


@pytest.mark.slow
def test_a_block_that_fails_keeps_no_other_from_being_done(scene: Path, tmp_path: Path) -> None:
    found = run(scene, tmp_path, Failing(LINE))
    assert found.failed == (("spans-0002-survey", "a photo is damaged"),)
    assert [span.id for span in found.survey.spans] == [1, 3, 4]
    (lost,) = [one for one in found.survey.findings if one.kind == "corridor"]
    assert "1 of 4 spans" in lost.what and lost.where == ("span 2",)
    assert "a photo is damaged" in (tmp_path / INDEX).read_text()
    did(tmp_path)
    assert not run(scene, tmp_path).failed
    assert did(tmp_path) == ["spans-0002-survey"]


class Dying(KnownLine):
    """Its process dies at one task."""

    def __call__(self, out: Path, task: Task) -> None:
        if task.folder == "spans/0003":
            raise KeyboardInterrupt
        super().__call__(out, task)


@pytest.mark.slow
def test_what_was_finished_before_an_interruption_stays(scene: Path, tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        run(scene, tmp_path, Dying(LINE))
    first = did(tmp_path)
    assert not (tmp_path / INDEX).exists()
    run(scene, tmp_path)
    second = did(tmp_path)
    assert not set(first) & set(second)
    assert second == ["spans-0003-survey", "spans-0004-survey"]


def test_a_scene_without_scale_is_refused(scene: Path, tmp_path: Path) -> None:
    content = json.loads((scene / "transforms.json").read_text())
    content["plnerf"].pop("unit")
    content["plnerf"]["root"] = str(scene)
    (tmp_path / "transforms.json").write_text(json.dumps(content))
    with pytest.raises(ConfigError, match="has no scale"):
        run(tmp_path, tmp_path / "out")


def test_a_record_of_other_inputs_or_damaged_counts_for_nothing(tmp_path: Path) -> None:
    ledger, task = Ledger(tmp_path), Task("find", "find/0001", {"scene": "a"})
    assert ledger.record(task).state == "waiting"
    ledger.write(task, "done")
    assert ledger.done(task)
    assert not ledger.done(Task("find", "find/0001", {"scene": "b"}))
    (tmp_path / "ledger/find-0001-find.json").write_text('{"state": "done"')
    assert not ledger.done(task)


@pytest.mark.slow
def test_a_line_that_crosses_stays_in_a_block_and_comes_once(tmp_path: Path) -> None:
    low = line_along(((95.0, -115.0), (125.0, -5.0)), ((0.0, 10.0, "phase"),), after=LINE)
    both = replace(LINE, spans=(*LINE.spans, *low.spans), structures=(*LINE.structures, *low.structures))
    scene = photos_along(tmp_path / "scene", LINE)
    found = run(scene, tmp_path / "out", KnownLine(both))
    wires = [len(span.wires) for line in found.survey.lines for span in line.spans]
    assert wires == [4, 4, 4, 4, 1]
    block = read_survey(tmp_path / "out/spans/0002/survey" / SURVEY_FILE)
    assert {span.id for span in block.spans} == {2, 5}
