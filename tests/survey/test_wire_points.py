"""Points on wires of a run: where its images show ridges, in the LineFrame, the same every time."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from tests.support.tiny_run import Recorder, tiny_config

from plnerf.detect.evidence import track_slope
from plnerf.errors import ConfigError
from plnerf.line.frame import LineFrame
from plnerf.scene.cameras import project
from plnerf.survey import wire_points as survey_points
from plnerf.survey.config_wires import CollinearConfig, WirePointsConfig
from plnerf.survey.wire_points import ridge_pixels, wire_points
from plnerf.train.loop import train
from plnerf.train.run import TrainedRun, open_run

CONFIG = WirePointsConfig()
ALL = replace(CONFIG, min_share=1e-9, margin=1e6)
"""Every wire pixel gives a point, however faint and wherever it lies."""


@pytest.fixture(scope="module")
def run(built_tiny_scene: Path, tmp_path_factory: pytest.TempPathFactory) -> TrainedRun:
    folder = tmp_path_factory.mktemp("survey") / "run"
    return open_run(train(tiny_config(built_tiny_scene, steps=3), folder, Recorder()))


@pytest.fixture
def all_on_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    """Three steps of training make no lines: points count as if they were on some."""
    for name in ("on_lines", "in_long_pieces"):
        monkeypatch.setattr(survey_points, name, lambda points, *_: np.full(len(points), True))


def frame_of(run: TrainedRun) -> LineFrame:
    return LineFrame.of_scene(run.scene.frames)


@pytest.mark.usefixtures("all_on_lines")
def test_a_real_run_gives_the_same_points_twice(run: TrainedRun) -> None:
    done: list[tuple[int, int]] = []
    first = wire_points(run, frame_of(run), ALL, lambda *at: done.append(at))
    again = wire_points(run, frame_of(run), ALL)
    assert len(first.xyz) > 0 and (first.xyz == again.xyz).all() and (first.solid == again.solid).all()
    count = len(run.scene.train)
    assert done == [(k + 1, count) for k in range(count)]
    assert first.tried == again.tried > 0


def test_ridge_pixels_are_centres_of_the_image_the_strongest_ones(run: TrainedRun) -> None:
    scene = run.scene
    camera, place = ridge_pixels(scene, 1, 0.0, CONFIG)
    assert 0 < len(place) <= CONFIG.max_per_view and (camera == 1).all() and len(camera) == len(place)
    corner = place - 0.5
    assert (corner == corner.round()).all() and (corner >= 0).all()
    assert (corner[:, 0] < 48).all() and (corner[:, 1] < 32).all()
    assert len(corner.unique(dim=0)) == len(corner)
    fewer = ridge_pixels(scene, 1, 0.0, replace(CONFIG, max_per_view=5))
    assert (fewer[1] == place[:5]).all()


@pytest.mark.usefixtures("all_on_lines")
def test_points_that_are_returned_are_solid_and_in_the_box(run: TrainedRun) -> None:
    frame, (low, high) = frame_of(run), run.scene.box

    def outside(xyz: np.ndarray) -> np.ndarray:
        inside = frame.to_scene(xyz)
        return np.maximum(low - inside, inside - high).max(1)

    every = wire_points(run, frame, ALL)
    margin, share = float(np.median(outside(every.xyz))), float(np.median(every.solid))
    found = wire_points(run, frame, replace(ALL, margin=margin))
    assert 0 < len(found.xyz) == len(found.view) == len(found.solid) < len(every.xyz) == found.tried
    assert (outside(found.xyz) <= margin + 1e-6).all() and set(found.view) <= set(run.scene.train)
    solid = wire_points(run, frame, replace(ALL, min_share=share)).solid
    assert len(solid) and (solid >= share).all() and (every.solid < share).any()


def test_points_of_no_line_are_dropped(run: TrainedRun) -> None:
    nowhere = replace(CONFIG.collinear, min_views=10_000)
    assert not len(wire_points(run, frame_of(run), replace(ALL, collinear=nowhere)).xyz)


@pytest.mark.usefixtures("all_on_lines")
def test_points_lie_in_front_of_their_cameras_on_the_rays_of_ridge_pixels(run: TrainedRun) -> None:
    """All that were tried: seen from their views, they are the ridge pixels again."""
    frame = frame_of(run)
    found = wire_points(run, frame, ALL)
    assert len(found.xyz) == found.tried > 100
    slope = track_slope(run.scene.cameras.centre[list(run.scene.train)].double().numpy())
    for i in run.scene.train:
        mine = torch.from_numpy(frame.to_scene(found.xyz[found.view == i])).float()
        pixel, depth = project(run.scene.cameras, mine)
        assert (depth[i] > 0).all()
        ridges = ridge_pixels(run.scene, i, slope, CONFIG)[1]
        torch.testing.assert_close(pixel[i], ridges, atol=0.02, rtol=0)


def test_settings_that_cannot_work_are_refused() -> None:
    for make in (
        lambda: WirePointsConfig(max_per_view=0), lambda: WirePointsConfig(min_share=0.0),
        lambda: WirePointsConfig(radius_px=0.0), lambda: CollinearConfig(min_views=0),
        lambda: CollinearConfig(cell=0.0),
    ):  # fmt: skip
        with pytest.raises(ConfigError, match="got"):
            make()
