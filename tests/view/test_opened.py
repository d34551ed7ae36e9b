"""What the viewer opens: runs, scenes and surveys with all that belongs to them, and what it refuses."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from tests.support.cut_off import cut_off
from tests.support.surveys import short, unscaled
from tests.support.tiny_run import small

from plnerf.errors import ConfigError, PlnerfError, SurveyError
from plnerf.line.cloud import GROUND, HIGH_VEGETATION, TOWER
from plnerf.line.survey import Survey
from plnerf.pipeline import train_scene, write_survey
from plnerf.scene.colmap import pycolmap
from plnerf.scene.formats import read_listing
from plnerf.scene.formats_colmap import write_colmap
from plnerf.train.report import SilentReport
from plnerf.view.opened import open_source
from plnerf.view.page_text import plain
from plnerf.view.points import thinned


@pytest.fixture(scope="module")
def survey() -> Survey:
    return short(0.02)


@pytest.fixture(scope="module")
def written(survey: Survey, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("written") / "survey"
    folder.mkdir()
    write_survey(survey, folder)
    return folder


def test_a_survey_is_opened_with_its_cloud(written: Path, survey: Survey) -> None:
    for source in (written, written / "survey.json"):
        opened = open_source(source)
        assert opened.survey is not None and len(opened.survey.wires) == 5
        assert opened.points is not None and len(opened.points.xyz) == len(survey.cloud.xyz)
        assert (opened.run, opened.views, opened.notes) == (None, None, ())
    assert opened.points.label is not None and set(opened.points.label) == set(survey.cloud.label)
    middle = opened.frame.to_line(np.zeros(3))
    assert np.abs(middle[:2]).max() < 3 and 5 < middle[2] < 15  # of the wires


def test_a_survey_that_was_complete_and_not_in_its_place_is_opened(survey: Survey, tmp_path: Path) -> None:
    write_survey(survey, tmp_path)
    cut_off(tmp_path)
    opened = open_source(tmp_path)
    assert opened.survey is not None and len(opened.survey.wires) == 5 and opened.points is not None


def test_an_unscaled_survey_has_points_in_its_own_frame(tmp_path: Path) -> None:
    survey = unscaled(0.02)
    write_survey(survey, tmp_path)
    opened = open_source(tmp_path)
    assert opened.points is not None
    assert np.abs(np.sort(opened.points.xyz, 0) - np.sort(survey.cloud.xyz, 0)).max() < 1e-6


def test_a_scene_is_opened_without_pixels_being_copied(tiny_scene: Path) -> None:
    before = sorted(tiny_scene.rglob("*"))
    opened = open_source(tiny_scene)
    assert opened.views is not None and len(opened.views.names) == 12 and opened.points is None
    photo = opened.views.photo(3, 24)
    assert photo is not None and photo.shape == (16, 24, 3)
    # The ball of radius 0.5 at (0, 0, 0.5) is where the photos show it.
    ball = opened.frame.line.from_world(np.array([[0.0, 0.0, 0.5], [0.0, 0.0, -40.0]]))
    for i in range(12):
        (x, y), _ = opened.views.pixels(i, ball)
        assert 16 < x < 32 and 8 < y < 24
    behind = opened.views.cameras.centre[0].numpy() - opened.views.cameras.R_scene_camera[0].numpy()[:, 2]
    assert np.isnan(opened.views.pixels(0, behind[None])).all()
    (tiny_scene / opened.views.names[3]).unlink()
    assert opened.views.photo(3, 24) is None
    assert sorted(tiny_scene.rglob("*")) == [one for one in before if one.name != "0003.png"]


def test_a_photo_seen_from_where_it_was_taken_is_the_photo(tiny_scene: Path) -> None:
    from plnerf.view.eye import eye_of

    views = open_source(tiny_scene).views
    assert views is not None
    photo = views.photo(5, 1000)
    assert photo is not None
    seen, inside = views.seen_by(5, eye_of(views.cameras, 5, 1.5), (48, 32), photo)
    assert inside.mean() > 0.98
    assert np.abs(seen.astype(int) - photo)[1:-1, 1:-1].mean() < 2
    seen, inside = views.seen_by(5, eye_of(views.cameras, 5, 3.0), (96, 32), photo)
    assert 0.45 < inside.mean() < 0.55 and not inside[:, 0].any()  # beside the photo there is none


def with_points(scene: Path, shift: float) -> None:
    """A COLMAP model of the scene's poses, all shifted, with one red point at the ball's middle."""
    listing = read_listing(scene)
    write_colmap(listing, scene / "sparse" / "0")
    model = pycolmap.Reconstruction(scene / "sparse" / "0")
    model.add_point3D(np.array([0.0, 0.0, 0.5]), pycolmap.Track(), np.array([200, 10, 10], np.uint8))
    model.transform(pycolmap.Sim3d(1.0, pycolmap.Rotation3d(np.eye(3)), np.array([shift, 0.0, 0.0])))
    model.write_binary(scene / "sparse" / "0")


def test_a_scenes_points_are_those_of_its_model_if_it_is_in_its_world(tiny_scene: Path) -> None:
    with_points(tiny_scene, 0.0)
    opened = open_source(tiny_scene)
    assert opened.points is not None and opened.points.rgb is not None
    assert np.allclose(opened.frame.line.to_world(opened.points.xyz), [[0.0, 0.0, 0.5]])
    assert opened.points.rgb.tolist() == [[200, 10, 10]] and opened.points.colourings[0] == "photos"
    with_points(tiny_scene, 0.5)
    assert open_source(tiny_scene).points is None
    (tiny_scene / "sparse" / "0" / "points3D.bin").write_bytes(b"\x09")
    opened = open_source(tiny_scene)
    assert opened.points is None and "COLMAP model are not shown" in opened.notes[0]


def test_a_run_is_opened_with_photos_and_survey(tiny_scene: Path, written: Path, tmp_path: Path) -> None:
    run = train_scene(tiny_scene, tmp_path / "run", steps=1, device="cpu", report=SilentReport(), **small())
    opened = open_source(run)
    assert opened.run is not None and opened.views is not None and opened.survey is None
    assert opened.views.photo(0, 100) is not None and opened.notes == ()
    shutil.copytree(written, run / "survey")
    both = open_source(run)
    assert both.run is not None and both.survey is not None and both.views is not None
    assert both.frame.line.same_as(both.survey.frame)
    # Its cameras stand at the same places of the world, now in the survey's frame.
    places = [one.frame.line.to_world(one.views.cameras.centre.numpy()) for one in (opened, both)]  # type: ignore[union-attr]
    assert np.abs(places[0] - places[1]).max() < 1e-5
    of_survey = open_source(run / "survey")
    assert of_survey.run is not None and of_survey.survey is not None
    # What is not there any more, or cannot be read, is named, and the rest is shown.
    shutil.rmtree(tiny_scene)
    (run / "survey" / "survey.json").write_text("{}")
    rest = open_source(run)
    assert rest.run is not None and rest.views is not None and rest.views.photo(0, 100) is None
    said = " ".join(rest.notes)
    assert "The photos are not shown" in said and "survey is not shown" in said
    with pytest.raises(SurveyError):
        open_source(run / "survey")


def test_what_a_survey_names_is_not_followed(
    written: Path, tiny_scene: Path, built_tiny_scene: Path, tmp_path: Path
) -> None:
    copied = tmp_path / "a" / "b"
    shutil.copytree(written, copied)
    content = json.loads((copied / "survey.json").read_text())
    content["source"] = str(tiny_scene)
    (copied / "survey.json").write_text(json.dumps(content))
    assert open_source(copied).views is None
    shutil.copy(tiny_scene / "transforms.json", tmp_path / "a")  # not as its own survey
    assert open_source(copied).views is None
    assert open_source(copied, tiny_scene).views is not None  # unless somebody says so
    with pytest.raises(ConfigError, match="neither a run folder nor a scene"):
        open_source(copied, tmp_path)


@pytest.mark.parametrize("what", ["nothing there", "empty folder", "las file"])
def test_what_is_none_of_these_is_refused(
    what: str, tmp_path: Path, snapshot: Callable[[str, str], None]
) -> None:
    source = tmp_path / "given.las" if what == "las file" else tmp_path / "given"
    if what == "empty folder":
        source.mkdir()
    if what == "las file":
        source.write_bytes(b"LASF")
    with pytest.raises(PlnerfError) as caught:
        open_source(source)
    snapshot(f"view_{what.replace(' ', '_')}", str(caught.value).replace(str(tmp_path), "DIR"))


def test_many_points_are_thinned_and_thin_things_stay() -> None:
    xyz = np.random.default_rng(0).normal(size=(10_000, 3))
    xyz[7] = np.nan
    label = np.full(10_000, GROUND, np.uint8)
    label[:300] = TOWER
    few = thinned(xyz, label, None, most=1000)
    assert len(few.xyz) == 1000 and few.total == 10_000 and np.isfinite(few.xyz).all()
    assert few.label is not None and (few.label == TOWER).sum() == 299
    assert few.colourings == ("class", "height")
    green = few.colours("class")[few.label == TOWER][0]
    assert (green == [0x3A, 0x3A, 0x3A]).all() and few.colours("height").shape == (1000, 3)
    other = thinned(xyz, label * 0 + HIGH_VEGETATION, most=1000)
    assert not (few.colours("class") == other.colours("class")).all()


def test_texts_of_others_are_written_as_they_are() -> None:
    assert plain("a_b<c>") == "a&#95;b&#60;c&#62;" and plain("größe 1, 2.") == "größe 1, 2."
