"""Everything a survey can be given by mistake ends in a clear statement, and no wire is invented for it.

What `plnerf survey` says is stored in tests/snapshots/survey_*.txt; ``pytest --update-snapshots`` writes it
anew.  Status 1: nothing was written; status 3: a report was, which says that there is no conductor, and why.
"""

import re
import shutil
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.conftest import ROOT, SNAPSHOTS
from tests.support.drawn import FRAME, hanging, uncertain
from tests.support.lidar_clouds import Line, line
from tests.support.tiny_run import Recorder, tiny_config
from tests.survey.lidar.test_las import write_las

from plnerf.cli.main import main
from plnerf.line.files import read_survey, write_wires
from plnerf.survey.thresholds import DEFAULT_TABLE
from plnerf.train.guidance import WIRES
from plnerf.train.loop import train

Spoil = Callable[[Path], list[str]]
REFUSED: dict[str, Spoil] = {}
"""Status 1."""
RD = np.array([230_000.0, 570_000.0, 0.0])
POINTS = 100 * np.random.default_rng(3).random((500, 3))
"""Without a wire."""
TABLE = ROOT / "src" / "plnerf" / "data" / "clearances" / DEFAULT_TABLE


@pytest.fixture(scope="module")
def made() -> Line:
    return line(np.array([[0.0, 0.0], [110.0, 20.0]]))


def refused(spoil: Spoil) -> Spoil:
    """A case makes what is wrong in a folder of its own and returns the arguments."""
    REFUSED[spoil.__name__] = spoil
    return spoil


def cloud(folder: Path, xyz: np.ndarray | None = None, crs: str | None = "EPSG:28992") -> str:
    """A cloud that could be surveyed."""
    return str(write_las(folder / "line.laz", POINTS + RD if xyz is None else xyz, crs))


def table(folder: Path, old: str, new: str) -> list[str]:
    """Arguments with a table of one's own, changed in one place."""
    text = TABLE.read_text()
    assert old in text
    (folder / "own.toml").write_text(text.replace(old, new, 1))
    return [cloud(folder), "--voltage-kv", "345", "--thresholds", str(folder / "own.toml")]


@refused
def absent(folder: Path) -> list[str]:
    return [str(folder / "line.laz")]


@refused
def empty(folder: Path) -> list[str]:
    return [cloud(folder, np.empty((0, 3)))]


@refused
def degrees_by_their_values(folder: Path) -> list[str]:
    xyz = np.array([7.1, 50.7, 60.0]) + POINTS * [1e-5, 1e-5, 0.4]
    return [cloud(folder, xyz, None)]


@refused
def degrees_by_their_crs(folder: Path) -> list[str]:
    return [cloud(folder, POINTS / 100, "EPSG:4326")]


@refused
def all_at_one_place(folder: Path) -> list[str]:
    return [cloud(folder, np.repeat(RD[None] + 5.0, 500, 0))]


@refused
def no_las_at_all(folder: Path) -> list[str]:
    (folder / "line.laz").write_text("points of the flight in May")
    return [str(folder / "line.laz")]


@refused
def laz_cut_off(folder: Path) -> list[str]:
    path = Path(cloud(folder))
    path.write_bytes(path.read_bytes()[:-900])
    return [str(path)]


@refused
def las_cut_off_between_two_points(folder: Path) -> list[str]:
    path = write_las(folder / "line.las", POINTS)
    path.write_bytes(path.read_bytes()[: -100 * 36])
    return [str(path)]


@refused
def las_whose_header_was_overwritten(folder: Path) -> list[str]:
    path = write_las(folder / "line.las", POINTS)
    data = bytearray(path.read_bytes())
    data[247:255] = (10**12).to_bytes(8, "little")  # how many points there are
    path.write_bytes(data)
    return [str(path)]


@refused
def folder_that_is_no_run(folder: Path) -> list[str]:
    return [str(folder)]


@refused
def run_that_is_not_there(folder: Path) -> list[str]:
    return [str(folder / "run")]


@refused
def table_without_voltage(folder: Path) -> list[str]:
    return [cloud(folder), "--thresholds", str(TABLE)]


@refused
def table_that_is_not_there(folder: Path) -> list[str]:
    return [cloud(folder), "--voltage-kv", "345", "--thresholds", str(folder / "own.toml")]


@refused
def table_that_is_no_toml(folder: Path) -> list[str]:
    return table(folder, "unit =", "unit in")


@refused
def table_with_a_typo_in_a_key(folder: Path) -> list[str]:
    return table(folder, "applies_to", "aplies_to")


@refused
def table_with_a_typo_in_a_row(folder: Path) -> list[str]:
    return table(folder, "nominal_kv", "nominal_vk")


@refused
def table_with_too_few_distances(folder: Path) -> list[str]:
    return [*table(folder, "altitude_up_to = [", "altitude_up_to = [1.0, ")]


@refused
def voltage_that_the_table_lacks(folder: Path) -> list[str]:
    return [cloud(folder), "--voltage-kv", "380"]


@refused
def negative_clearance(folder: Path) -> list[str]:
    return [cloud(folder), "--clearance-m", "-3"]


@refused
def output_that_is_a_file(folder: Path) -> list[str]:
    (folder / "report").write_text("mine")
    return [cloud(folder), "-o", str(folder / "report")]


@refused
def output_in_a_file(folder: Path) -> list[str]:
    (folder / "report").write_text("mine")
    return [cloud(folder), "-o", str(folder / "report" / "survey")]


def plnerf_survey(
    arguments: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], folder: Path
) -> tuple[int, str]:
    """Its status, and all it says without the bar of its progress."""
    monkeypatch.setattr(sys, "argv", ["plnerf", "survey", *arguments])
    status = 0
    try:
        main()
    except SystemExit as stop:
        assert isinstance(stop.code, int)
        status = stop.code
    said = capsys.readouterr()
    lines = [row for row in (said.out + said.err).splitlines() if row.strip() and "━" not in row]
    text = "\n".join(lines)
    assert "Traceback" not in text
    return status, text.replace(str(TABLE.parent), "PACKAGE").replace(str(folder), "FOLDER")


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_surveyed_is_told_and_nothing_is_written(
    name: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    snapshot: Callable[[str, str], None],
) -> None:
    arguments = REFUSED[name](tmp_path)
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    status, text = plnerf_survey(arguments, monkeypatch, capsys, tmp_path)
    assert status == 1 and "\n" not in text
    snapshot(f"survey_{name}", text)
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before


def test_no_stored_text_is_left_over() -> None:
    stored = {path.stem for path in SNAPSHOTS.glob("survey_*.txt")}
    assert stored == {f"survey_{name}" for name in [*REFUSED, *SAID]}


SAID = ("no_wires", "no_ground", "no_crs", "run_that_looked_for_none", "run_without_a_certain_wire")
"""What is surveyed, and what is said of it."""


def findings(folder: Path) -> str:
    return "\n".join(finding.text for finding in read_survey(folder / "survey.json").findings)


@pytest.mark.slow
def test_a_cloud_without_wires_has_status_3_and_a_report_that_says_so(
    made: Line,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    snapshot: Callable[[str, str], None],
) -> None:
    """Also in the folder of an earlier survey, whose conductors must not stay there."""
    plain = np.isin(made.truth, (2, 5))
    out = tmp_path / "out"
    arguments = [cloud(tmp_path, made.xyz + RD), "-o", str(out), "--clearance-m", "3"]
    assert plnerf_survey(arguments, monkeypatch, capsys, tmp_path)[0] == 0
    assert (out / "conductors.csv").exists()
    arguments[0] = cloud(tmp_path, made.xyz[plain] + RD)
    status, text = plnerf_survey(arguments, monkeypatch, capsys, tmp_path)
    snapshot("survey_no_wires", text)
    assert status == 3 and read_survey(out / "survey.json").wires == ()
    assert "No wires were found" in (out / "report.html").read_text()
    assert {path.name for path in out.iterdir()} == {
        "report.html", "survey.json", "cloud.laz", "cloud.ply", "conductors.dxf",
    }  # fmt: skip


def test_a_cloud_of_ground_alone_has_status_3(
    made: Line, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    arguments = [cloud(tmp_path, made.xyz[made.truth == 2] + RD), "-o", str(out)]
    status, text = plnerf_survey(arguments, monkeypatch, capsys, tmp_path)
    assert status == 3 and "shows nothing more than 4 m above the ground" in text
    assert (out / "report.html").exists() and read_survey(out / "survey.json").wires == ()


@pytest.mark.slow
def test_a_cloud_without_ground_is_surveyed_and_says_so(
    made: Line,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    snapshot: Callable[[str, str], None],
) -> None:
    hanging_ones = made.xyz[np.isin(made.truth, (13, 14))] + RD
    status, _ = plnerf_survey([cloud(tmp_path, hanging_ones)], monkeypatch, capsys, tmp_path)
    survey = read_survey(tmp_path / "line-survey" / "survey.json")
    assert status == 0 and 0 < len(survey.wires) <= len(made.wires) and survey.clearances is not None
    assert not [place for place in survey.clearances.all_places() if place.to == "ground"]
    snapshot("survey_no_ground", findings(tmp_path / "line-survey"))


@pytest.mark.slow
def test_repeated_points_and_no_crs_change_nothing(
    made: Line,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    snapshot: Callable[[str, str], None],
) -> None:
    found = []
    for times in (1, 4):
        path = cloud(tmp_path, np.tile(made.xyz + RD, (times, 1)), None)
        assert plnerf_survey([path], monkeypatch, capsys, tmp_path)[0] == 0
        survey = read_survey(tmp_path / "line-survey" / "survey.json")
        found.append([(w.theta.tolist(), w.covariance.tolist(), w.kind) for w in survey.wires])
    assert found[0] == found[1] and len(found[0]) == len(made.wires)
    said = findings(tmp_path / "line-survey")
    snapshot("survey_no_crs", re.sub(r"\d{2,}", "N", said))


@pytest.fixture(scope="module")
def trained(built_tiny_scene: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("errors") / "run"
    return train(tiny_config(built_tiny_scene, steps=3), folder, Recorder())


def test_a_run_that_never_saw_a_wire_has_status_3_and_a_report_that_says_so(
    trained: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    snapshot: Callable[[str, str], None],
) -> None:
    """Its preset detects none: they are detected for the survey."""
    run = shutil.copytree(trained, tmp_path / "run")
    status, text = plnerf_survey([str(run)], monkeypatch, capsys, tmp_path)
    snapshot("survey_run_that_looked_for_none", re.sub(r"[\d,]+ points", "N points", text))
    assert status == 3 and read_survey(run / "survey" / "survey.json").wires == ()
    assert (run / "survey" / "report.html").exists()


def test_a_run_without_a_certain_wire_has_status_3(
    tmp_path: Path,
    built_tiny_scene: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    snapshot: Callable[[str, str], None],
) -> None:
    """What the views do not fix is no wire of the survey."""
    run = tmp_path / "run"
    run.mkdir()
    write_wires(run / WIRES, [uncertain(hanging(0.1, 0.2))], FRAME, {})
    config = tiny_config(built_tiny_scene, steps=3)
    train(replace(config, train=replace(config.train, find_wires=True)), run, Recorder())
    status, text = plnerf_survey([str(run)], monkeypatch, capsys, tmp_path)
    snapshot("survey_run_without_a_certain_wire", re.sub(r"[\d,]+ points", "N points", text))
    assert status == 3 and read_survey(run / "survey" / "survey.json").wires == ()
