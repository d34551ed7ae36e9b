"""What is exported of a run and of a survey, from the command line's call on: pairs that do not go together,
runs without weights, and a small run from end to end."""

import json
import shutil
import sys
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from tests.support.cut_off import cut_off
from tests.support.surveys import short
from tests.support.tiny_run import small

from plnerf.cli.main import main
from plnerf.errors import CheckpointError, ConfigError
from plnerf.export.run_formats import run_wires
from plnerf.export.splat_config import SplatConfig
from plnerf.exporting import export_source
from plnerf.line.frame import LineFrame
from plnerf.line.line import Line
from plnerf.pipeline import train_scene, write_survey
from plnerf.scene.ply import read_ply
from plnerf.train.run import open_run

FEW = SplatConfig(count=400, degree=1, steps=6, views=4)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory, built_tiny_scene: Path) -> Path:
    """A run of a few steps, in a folder with a blank in its name."""
    return train_scene(built_tiny_scene, tmp_path_factory.mktemp("exported") / "a run", steps=12, **small())


@pytest.fixture
def own_run(run: Path, tmp_path: Path) -> Path:
    """A copy of the run, to be changed."""
    return Path(shutil.copytree(run, tmp_path / "own run"))


@pytest.fixture
def survey(tmp_path: Path) -> Path:
    write_survey(short(0.05), tmp_path / "surveyed")
    return tmp_path / "surveyed"


def test_a_run_is_exported_with_everything_in_place(run: Path, tmp_path: Path) -> None:
    stages: list[str] = []
    out = tmp_path / "out"
    done = export_source(run, (), out, splats=FEW, progress=lambda stage, done, of: stages.append(stage))
    written = list(done.files.values())
    assert [path.name for path in written] == [
        "splats.ply",
        "splats.glb",
        "splats.splat",
        "splats.json",
        "handout.html",
    ]
    assert {path.name for path in out.iterdir() if not path.name.startswith(".")} == {
        path.name for path in written
    }
    assert list(dict.fromkeys(stages)) == ["render", "fit", "compare", "page"]
    about = json.loads((out / "splats.json").read_text())
    rows = read_ply(out / "splats.ply")["vertex"]
    assert about["gaussians"] == len(rows) <= FEW.count and about["settings"]["count"] == FEW.count
    assert (out / "splats.splat").stat().st_size == 32 * len(rows)
    assert 5 < about["agreement"]["field_db"] < 60 and 5 < about["agreement"]["photos_db"] < 60
    frame = open_run(run).record.frames
    places = (
        np.stack([rows[axis] for axis in "xyz"], 1).astype(float) + np.array(about["T_world_local"])[:3, 3]
    )
    in_scene = frame.to_scene(places)  # where the cameras are, not a frame away
    assert np.abs(np.median(in_scene, axis=0)).max() < 3
    page = (out / "handout.html").read_text()
    assert "was not surveyed" in page and page.count("data:image/jpeg") >= 2 * 2


def test_splats_are_replaced_together_and_the_page_stays(run: Path, tmp_path: Path) -> None:
    export_source(run, ("html", "glb", "splat"), tmp_path, splats=FEW)
    export_source(run, ("ply",), tmp_path, splats=FEW)
    assert {path.name for path in tmp_path.glob("[a-z]*")} == {"splats.ply", "splats.json", "handout.html"}
    assert json.loads((tmp_path / "splats.json").read_text())["files"] == {"ply": "splats.ply"}


def test_where_the_photos_are_gone_the_field_is_exported_all_the_same(own_run: Path, tmp_path: Path) -> None:
    settings = json.loads((own_run / "config.json").read_text())
    (own_run / "config.json").write_text(json.dumps(settings | {"scene": str(tmp_path / "gone")}))
    export_source(own_run, ("ply", "html"), splats=FEW)
    about = json.loads((own_run / "export" / "splats.json").read_text())["agreement"]
    assert about["photos_db"] is None and "gone" in about["why_no_photos"] and about["field_db"] > 5
    assert "No photos are shown" in (own_run / "export" / "handout.html").read_text()


def test_wires_of_the_runs_survey_are_those_that_are_drawn(own_run: Path) -> None:
    frame = LineFrame.of_scene(open_run(own_run).record.frames)
    none, source = run_wires(open_run(own_run), frame)
    assert none == () and source.startswith("detected before training")
    survey = short(0.05)
    moved = type(survey)(frame, survey.lines, survey.cloud, str(own_run))
    write_survey(moved, own_run / "survey")
    found, source = run_wires(open_run(own_run), frame)
    assert source == "the survey of the run" and isinstance(survey.lines[0], Line)
    np.testing.assert_allclose([one.theta for one in found], [one.theta for one in survey.wires], atol=1e-9)


def test_formats_of_the_other_kind_are_refused_with_what_to_do(
    run: Path, survey: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(
        ConfigError, match=r"is a run, with the formats ply, glb, splat, html, but gpkg, copc was"
    ):
        export_source(run, ("ply", "gpkg", "copc"), tmp_path)
    with pytest.raises(
        ConfigError, match=r"is a survey, with the formats gpkg, kml, copc, pls-cadd, but glb was"
    ):
        export_source(survey, ("glb",), tmp_path)
    with pytest.raises(ConfigError, match=r"codes of PLS-CADD, a format of surveys, but .* is a run"):
        export_source(run, ("ply",), tmp_path, codes=tmp_path / "codes.toml")
    with pytest.raises(ConfigError, match="neither a run, which has a"):
        export_source(tmp_path, ("ply",))
    assert not list(tmp_path.glob("splats*"))


def test_a_survey_is_exported_as_before(survey: Path, tmp_path: Path) -> None:
    (path,) = export_source(survey, ("pls-cadd",), tmp_path / "out").files.values()
    assert path.is_file()
    (again,) = export_source(survey / "survey.json", ("pls-cadd",)).files.values()
    assert again.parent == survey


def test_a_run_without_weights_is_refused(run: Path, tmp_path: Path) -> None:
    (tmp_path / "config.json").write_text((run / "config.json").read_text())
    with pytest.raises(CheckpointError, match="no complete checkpoint yet"):
        export_source(tmp_path, ("ply",))
    assert not (tmp_path / "export").exists()


class Addresses(HTMLParser):
    """Whatever a page would ask a server for."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []
        self.tags: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.found += [
            value or "" for name, value in attrs if name in {"src", "href", "poster", "srcset", "data"}
        ]


def test_the_page_of_a_surveyed_run_asks_no_server_for_anything(own_run: Path, tmp_path: Path) -> None:
    frame = LineFrame.of_scene(open_run(own_run).record.frames)
    survey = short(0.05)
    write_survey(type(survey)(frame, survey.lines, survey.cloud, "a <run>"), own_run / "survey")
    (own_run / "renders").mkdir(exist_ok=True)
    (own_run / "renders" / "path-rgb.mp4").write_bytes(b"a film")
    export_source(own_run, ("html",), tmp_path)
    text = (tmp_path / "handout.html").read_text()
    page = Addresses()
    page.feed(text)
    assert page.found and all(one.startswith(("data:", "#")) for one in page.found), page.found
    assert "default-src 'none'" in text and "://" not in text.replace("</", "")
    assert {"video", "canvas", "input"} <= set(page.tags) and page.tags.count("img") == 2 * 2
    data = json.loads(text.split('id="view-data">')[1].split("</script>")[0])
    assert len(data["wires"]) == len(survey.wires) and data["count"] > 100
    assert "was not surveyed" not in text and "No flight" not in text


def test_results_whose_exchange_was_cut_off_are_in_the_export(own_run: Path, tmp_path: Path) -> None:
    frame, survey = LineFrame.of_scene(open_run(own_run).record.frames), short(0.05)
    write_survey(type(survey)(frame, survey.lines, survey.cloud, "a run"), own_run / "survey")
    (own_run / "renders").mkdir(exist_ok=True)
    (own_run / "renders" / "path-rgb.mp4").write_bytes(b"a film")
    for name in ("survey", "renders"):
        cut_off(own_run / name)
    surveyed = shutil.copytree(own_run / "survey", tmp_path / "surveyed")
    export_source(own_run, ("html", "ply"), tmp_path, splats=FEW)
    text = (tmp_path / "handout.html").read_text()
    assert "was not surveyed" not in text and "No flight" not in text
    wires_from = json.loads((tmp_path / "splats.json").read_text())["wires_from"]
    assert wires_from == "the survey of the run"
    assert list(export_source(surveyed, ("pls-cadd",)).files)


def test_a_film_too_large_for_a_page_is_left_out(
    own_run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (own_run / "renders").mkdir(exist_ok=True)
    (own_run / "renders" / "path-rgb.mp4").write_bytes(b"a film")
    monkeypatch.setattr("plnerf.report.handout.MOST_VIDEO", 3)
    export_source(own_run, ("html",), tmp_path)
    page = Addresses()
    page.feed((tmp_path / "handout.html").read_text())
    assert "video" not in page.tags and "too large for a page" in (tmp_path / "handout.html").read_text()


def test_a_fit_that_does_not_fit_into_memory_is_refused_before_anything_is_rendered(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("plnerf.export.run_formats.target_views", None)
    with pytest.raises(
        ConfigError, match=r"A fit of 90,000,000,000 Gaussians .* needs at least .* --splats.count"
    ):
        export_source(run, ("ply",), tmp_path, splats=SplatConfig(count=90_000_000_000))


def test_the_command_ends_with_a_line_that_helps_and_status_1(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(
        sys, "argv", ["plnerf", "export", str(run), "--format", "gpkg", "-o", str(tmp_path)]
    )  # fmt: skip
    with pytest.raises(SystemExit) as end:
        main()
    err = capsys.readouterr().err
    assert end.value.code == 1 and err.startswith("ConfigError: ") and "Traceback" not in err
    assert "but gpkg was asked for. Survey it, plnerf survey" in err
