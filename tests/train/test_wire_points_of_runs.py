"""The survey of a run: points where its pictures say, in the world's frame, as files that can be scored."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
import torch
from tests.support.drawn import hanging
from tests.support.tiny_run import Recorder, tiny_config

from plnerf.detect.curves import Curve, write_curves
from plnerf.detect.evidence import track_slope
from plnerf.errors import PlnerfError
from plnerf.scene.cameras import project
from plnerf.score.clouds import read_cloud
from plnerf.survey import wire_points as survey_points
from plnerf.survey.wire_files import survey_wires
from plnerf.survey.wire_points import MOST_PER_VIEW, WirePoints, ridge_pixels, wire_points
from plnerf.train.guidance import CURVES
from plnerf.train.loop import train
from plnerf.train.run import TrainedRun, open_run


@pytest.fixture(scope="module")
def run(built_tiny_scene: Path, tmp_path_factory: pytest.TempPathFactory) -> TrainedRun:
    folder = tmp_path_factory.mktemp("survey") / "run"
    return open_run(train(tiny_config(built_tiny_scene, steps=3), folder, Recorder()))


def test_files_are_whole_and_in_the_worlds_frame(
    run: TrainedRun, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With points as if they had been found: three steps of training make no lines."""
    points = np.random.default_rng(0).normal(size=(50, 3)) * 1e6 + 0.123456789  # as large as map coordinates
    view, solid = np.arange(50) % 12, np.linspace(0.5, 1, 50)
    found = WirePoints(points, view, solid, tried=99)
    monkeypatch.setattr("plnerf.survey.wire_files.wire_points", lambda run, progress=None: found)
    path = survey_wires(run, tmp_path / "deep" / "survey")
    assert path == tmp_path / "deep" / "survey" / "wires.json"
    assert {file.name for file in path.parent.iterdir()} == {"wires.json", "wires.ply"}
    np.testing.assert_array_equal(read_cloud(path.parent / "wires.ply").points, points)
    summary = json.loads(path.read_text())
    assert (summary["points"], summary["wire_pixels_tried"], summary["frame"]) == (50, 99, "world")
    assert (summary["preset"], summary["step"], summary["unit"]) == ("pl-nerf", 3, "m")
    assert summary["conductors_found_in_images"] == []


def test_a_real_run_is_surveyed_twice_to_the_same_points(run: TrainedRun, tmp_path: Path) -> None:
    done: list[tuple[int, int]] = []
    first = json.loads(survey_wires(run, tmp_path / "a", lambda *at: done.append(at)).read_text())
    again = json.loads(survey_wires(run, tmp_path / "a").read_text())  # over the one before
    assert first.keys() == again.keys() and first["points"] == again["points"]
    count = len(run.scene.train)
    assert done == [(k + 1, count) for k in range(count)]
    assert first["wire_pixels_tried"] > 0


def test_curves_that_guided_a_run_are_told_in_world_units(run: TrainedRun, tmp_path: Path) -> None:
    curve = hanging(0.1, 0.2)
    unsure = Curve(curve.y, curve.z, curve.ends, 0.05, 0.2, False)
    path = run.folder / CURVES
    write_curves(path, [curve, unsure])
    try:
        told = json.loads(survey_wires(run, tmp_path / "s").read_text())["conductors_found_in_images"]
    finally:
        path.unlink()
    assert [row["certain"] for row in told] == [True, False]
    for row, one in zip(told, (curve, unsure), strict=True):
        ends = run.scene.frames.to_scene(np.array(row["ends"]))
        np.testing.assert_allclose(ends, one.points(np.array(one.ends)), atol=1e-3)
        assert row["sigma"] == pytest.approx(one.sigma / run.scene.frames.scale, abs=1e-4)


def test_a_file_is_not_written_over(run: TrainedRun, tmp_path: Path) -> None:
    (tmp_path / "out").write_text("mine")
    with pytest.raises(PlnerfError, match=r"is to be a folder, but .* is a file") as caught:
        survey_wires(run, tmp_path / "out")
    assert str(tmp_path / "out") in str(caught.value)
    assert (tmp_path / "out").read_text() == "mine"


def test_ridge_pixels_are_centres_of_the_image_the_strongest_ones(
    run: TrainedRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = run.scene
    camera, place = ridge_pixels(scene, 1, 0.0)
    assert 0 < len(place) <= MOST_PER_VIEW and (camera == 1).all() and len(camera) == len(place)
    corner = place - 0.5
    assert (corner == corner.round()).all() and (corner >= 0).all()
    assert (corner[:, 0] < 48).all() and (corner[:, 1] < 32).all()
    assert len(corner.unique(dim=0)) == len(corner)
    monkeypatch.setattr(survey_points, "MOST_PER_VIEW", 5)
    assert (ridge_pixels(scene, 1, 0.0)[1] == place[:5]).all()


def test_points_that_are_handed_out_are_solid_and_in_the_box(run: TrainedRun) -> None:
    found = wire_points(run)
    assert len(found.points) == len(found.view) == len(found.solid) <= found.tried
    inside = run.scene.frames.to_scene(found.points)
    low, high = run.scene.box
    assert ((inside > low - 0.11) & (inside < high + 0.11)).all() and (
        found.solid >= survey_points.LEAST_SHARE
    ).all()
    assert set(found.view) <= set(run.scene.train)


def test_points_lie_in_front_of_their_cameras_on_the_rays_of_ridge_pixels(
    run: TrainedRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All that were tried: seen from their views, they are the ridge pixels again."""
    monkeypatch.setattr(survey_points, "LEAST_SHARE", 1e-9)
    monkeypatch.setattr(survey_points, "on_lines", lambda points, view, radius: np.full(len(points), True))
    monkeypatch.setattr(survey_points, "in_long_pieces", lambda points, radius: np.full(len(points), True))
    whole = dataclasses.replace(run.scene, box=np.array([[-1e6] * 3, [1e6] * 3]))
    found = wire_points(dataclasses.replace(run, scene=whole))
    assert len(found.points) == found.tried > 100
    slope = track_slope(run.scene.cameras.centre[list(run.scene.train)].double().numpy())
    for i in run.scene.train:
        mine = torch.from_numpy(run.scene.frames.to_scene(found.points[found.view == i])).float()
        pixel, depth = project(run.scene.cameras, mine)
        assert (depth[i] > 0).all()
        torch.testing.assert_close(pixel[i], ridge_pixels(run.scene, i, slope)[1], atol=0.02, rtol=0)
