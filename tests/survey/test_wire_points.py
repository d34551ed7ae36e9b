"""Points on wires of a run: where its images show ridges, in the LineFrame, the same every time."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from tests.support.tiny_run import Recorder, tiny_config

from plnerf.errors import ConfigError
from plnerf.line.frame import LineFrame
from plnerf.line.hang import hang
from plnerf.line.survey import WirePoints
from plnerf.scene.cameras import project
from plnerf.survey import wire_points as survey_points
from plnerf.survey.config_wires import CollinearConfig, WirePointsConfig
from plnerf.survey.wire_points import (
    alike,
    along_any,
    direction_of,
    ridge_pixels,
    wire_points,
)
from plnerf.train.loop import train
from plnerf.train.run import TrainedRun, open_run

CONFIG = WirePointsConfig()
ALL = replace(CONFIG, min_share=1e-9, margin=1e6)
"""Every wire pixel gives a point, however faint and wherever it lies."""
WIRES = [hang((-20.0, y, 8.0), (20.0, y, 8.0), 0.5) for y in (-6.0, 0.0, 6.0)]
ALONG = np.array([[1.0, 0.0, 0.0]])


@pytest.fixture(scope="module")
def run(built_tiny_scene: Path, tmp_path_factory: pytest.TempPathFactory) -> TrainedRun:
    folder = tmp_path_factory.mktemp("survey") / "run"
    return open_run(train(tiny_config(built_tiny_scene, steps=3), folder, Recorder()))


@pytest.fixture
def all_on_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    """Three steps of training make no lines: points count as if they were on some."""
    for name in ("on_lines", "in_long_pieces"):
        monkeypatch.setattr(survey_points, name, lambda points, *_: np.full(len(points), True))


def points_of(run: TrainedRun, config: WirePointsConfig, *progress: Any) -> WirePoints:
    """With wires along x through the middle of the box, in all images."""
    (low, high), frame = run.scene.box.astype(np.float64), frame_of(run)
    a, b = frame.from_scene(np.array([low, high]))
    middle = (a + b) / 2
    first, last = np.array([a[0], *middle[1:]]), np.array([b[0], *middle[1:]])
    return wire_points(run, frame, [hang(first, last, 0.01 * (b - a)[0])], config, *progress)


def frame_of(run: TrainedRun) -> LineFrame:
    return LineFrame.of_scene(run.scene.frames)


@pytest.mark.usefixtures("all_on_lines")
def test_a_real_run_gives_the_same_points_twice(run: TrainedRun) -> None:
    done: list[tuple[int, int]] = []
    first = points_of(run, ALL, lambda *at: done.append(at))
    again = points_of(run, ALL)
    assert len(first.xyz) > 0 and (first.xyz == again.xyz).all() and (first.solid == again.solid).all()
    count = len(run.scene.train)
    assert done == [(k + 1, count) for k in range(count)]
    assert first.tried == again.tried > 0


def test_ridge_pixels_are_centres_of_the_image_the_strongest_ones(run: TrainedRun) -> None:
    scene = run.scene
    camera, place = ridge_pixels(scene, 1, ALONG, CONFIG)
    assert 0 < len(place) <= CONFIG.max_per_view and (camera == 1).all() and len(camera) == len(place)
    corner = place - 0.5
    assert (corner == corner.round()).all() and (corner >= 0).all()
    assert (corner[:, 0] < 48).all() and (corner[:, 1] < 32).all()
    assert len(corner.unique(dim=0)) == len(corner)
    fewer = ridge_pixels(scene, 1, ALONG, replace(CONFIG, max_per_view=5))
    assert (fewer[1] == place[:5]).all()


@pytest.mark.usefixtures("all_on_lines")
def test_points_that_are_returned_are_solid_and_in_the_box(run: TrainedRun) -> None:
    frame, (low, high) = frame_of(run), run.scene.box

    def outside(xyz: np.ndarray) -> np.ndarray:
        inside = frame.to_scene(xyz)
        return np.maximum(low - inside, inside - high).max(1)

    every = points_of(run, ALL)
    margin, share = float(np.median(outside(every.xyz))), float(np.median(every.solid))
    found = points_of(run, replace(ALL, margin=margin))
    assert 0 < len(found.xyz) == len(found.view) == len(found.solid) < len(every.xyz) == found.tried
    assert (outside(found.xyz) <= margin + 1e-6).all() and set(found.view) <= set(run.scene.train)
    solid = points_of(run, replace(ALL, min_share=share)).solid
    assert len(solid) and (solid >= share).all() and (every.solid < share).any()


def test_points_of_no_line_are_dropped(run: TrainedRun) -> None:
    nowhere = replace(CONFIG.collinear, min_views=10_000)
    assert not len(points_of(run, replace(ALL, collinear=nowhere)).xyz)


@pytest.mark.usefixtures("all_on_lines")
def test_points_lie_in_front_of_their_cameras_on_the_rays_of_ridge_pixels(run: TrainedRun) -> None:
    """All that were tried: seen from their views, they are the ridge pixels again."""
    frame = frame_of(run)
    found = points_of(run, ALL)
    assert len(found.xyz) == found.tried > 100
    for i in run.scene.train:
        mine = torch.from_numpy(frame.to_scene(found.xyz[found.view == i])).float()
        pixel, depth = project(run.scene.cameras, mine)
        assert (depth[i] > 0).all()
        ridges = ridge_pixels(run.scene, i, ALONG, CONFIG)[1]
        torch.testing.assert_close(pixel[i], ridges, atol=0.02, rtol=0)


def test_without_wires_there_are_no_points(run: TrainedRun) -> None:
    behind = hang((0.0, 1e6, 8.0), (20.0, 1e6, 8.0), 0.5), hang((0.0, -1e6, 8.0), (20.0, -1e6, 8.0), 0.5)
    hidden = [one for one in behind if not wire_points(run, frame_of(run), [one], ALL).tried]
    assert hidden
    for wires in ([], hidden[:1]):
        found = wire_points(run, frame_of(run), wires, ALL)
        assert len(found.xyz) == len(found.view) == len(found.solid) == found.tried == 0


def test_pixels_of_several_directions_are_those_of_each(run: TrainedRun) -> None:
    across = np.array([[0.0, 1.0, 0.0]])
    every = replace(CONFIG, max_per_view=10_000)
    one, other, both = (
        {tuple(at) for at in ridge_pixels(run.scene, 1, some, every)[1].tolist()}
        for some in (ALONG, across, np.concatenate([ALONG, across]))
    )
    assert one and other and one != other and both == one | other
    assert not len(ridge_pixels(run.scene, 1, np.zeros((0, 3)), every)[1])


def test_wires_are_grouped_by_direction_whichever_end_comes_first() -> None:
    turned = hang((20.0, 3.0, 8.0), (-20.0, 3.0, 8.0), 0.5)
    askew, far = hang((0.0, 0.0, 8.0), (30.0, 1.5, 8.0), 0.5), hang((0.0, 0.0, 8.0), (30.0, 9.0, 8.0), 0.5)
    groups = alike([far, askew, turned, *WIRES], 4.0)
    assert [len(group) for group in groups] == [5, 1] and groups[0][0] is turned
    assert direction_of(far) == pytest.approx(np.array([30.0, 9.0, 0.0]) / np.hypot(30, 9))


@pytest.mark.parametrize("degrees", [0, 37, 90, 140, 255])
def test_points_on_a_line_of_any_azimuth_are_kept_and_others_are_not(degrees: int) -> None:
    random = np.random.default_rng(5)
    turn = np.radians(degrees)
    u = np.array([np.cos(turn), np.sin(turn), 0.1])
    line = random.uniform(-0.5, 0.5, (600, 1)) * u + random.normal(0, 0.004, (600, 3))
    ball = random.normal((0.0, 0.0, 1.0), 0.1, (600, 3))
    points, view = np.concatenate([line, ball]), np.tile(np.arange(5), 240)
    keep = along_any(points, view, 0.05, np.array([[0.0, 0.0, 1.0], u / np.linalg.norm(u)]), CONFIG)
    assert keep[:600].mean() > 0.8 and keep[600:].mean() < 0.05
    across = np.array([[-u[1], u[0], 0.0]])
    assert not along_any(points, view, 0.05, across, CONFIG).any()
    assert not along_any(points, view, 0.05, np.zeros((0, 3)), CONFIG).any()


def test_settings_that_cannot_work_are_refused() -> None:
    for make in (
        lambda: WirePointsConfig(max_per_view=0), lambda: WirePointsConfig(min_share=0.0),
        lambda: WirePointsConfig(radius_px=0.0), lambda: CollinearConfig(min_views=0),
        lambda: CollinearConfig(cell=0.0),
    ):  # fmt: skip
        with pytest.raises(ConfigError, match="got"):
            make()
