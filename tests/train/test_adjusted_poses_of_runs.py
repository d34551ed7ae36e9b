"""A run keeps the poses that were adjusted before its training: reopened and resumed, it has the same."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch
from tests.support.flown_plane import write_flight
from tests.support.tiny_run import tiny_config

from plnerf.capture.poses_config import PosesConfig, TieConfig
from plnerf.errors import SceneError
from plnerf.scene.scene import load_scene
from plnerf.train.guidance import run_wires
from plnerf.train.loop import train
from plnerf.train.protocol import protocol
from plnerf.train.report import SilentReport
from plnerf.train.run import open_run, write_run
from plnerf.train.scene_record import SceneRecord, read_record

FEW = PosesConfig(groups=2, group_size=4, ties=TieConfig(features=400, partners=6))


def test_poses_of_a_run_are_adjusted_once_and_stay(tmp_path: Path) -> None:
    write_flight(tmp_path / "s", off_m=0.05, off_deg=0.15)
    run = tmp_path / "run"
    config = replace(tiny_config(tmp_path / "s", "train.find_wires=true", steps=2), poses=FEW)
    train(config, run, SilentReport())
    record = read_record(run)
    given = load_scene(tmp_path / "s").cameras
    assert record.stated_centre is not None
    assert torch.allclose(record.stated_centre, given.centre, atol=1e-6)
    assert not torch.allclose(record.cameras.centre, given.centre, atol=1e-4)
    opened = open_run(run)
    assert torch.equal(opened.scene.cameras.centre, record.cameras.centre)
    assert torch.equal(opened.scene.cameras.R_scene_camera, record.cameras.R_scene_camera)
    assert "adjusted to tie points" in protocol(opened, 1.0, None)["held_out_poses"]
    again, _, _ = run_wires(config, load_scene(tmp_path / "s", store=run / "pixels"), run, trained=True)
    assert torch.equal(again.cameras.centre, record.cameras.centre)
    write_run(run, config, again)  # as training does when it goes on
    assert torch.equal(read_record(run).stated_centre, record.stated_centre)


def test_a_scene_whose_stated_poses_changed_is_refused(tmp_path: Path) -> None:
    write_flight(tmp_path / "s", off_m=0.05, off_deg=0.15)
    run = tmp_path / "run"
    config = replace(tiny_config(tmp_path / "s", "train.find_wires=true", steps=1), poses=FEW)
    train(config, run, SilentReport())
    (tmp_path / "other").mkdir()
    write_flight(tmp_path / "other" / "s", off_m=0.05, off_deg=0.15, seed=5)
    text = (tmp_path / "other" / "s" / "transforms.json").read_text()
    (tmp_path / "s" / "transforms.json").write_text(text)
    with pytest.raises(SceneError, match="has changed since the run"):
        _ = open_run(run).scene


def test_other_frames_keep_what_the_scene_states(tmp_path: Path) -> None:
    write_flight(tmp_path / "s")
    scene = load_scene(tmp_path / "s")
    moved = scene.with_poses(scene.cameras.R_scene_camera, scene.cameras.centre + 0.01)
    twice = moved.with_poses(scene.cameras.R_scene_camera, scene.cameras.centre + 0.02)
    assert torch.equal(twice.stated_centre, scene.cameras.centre)
    frames = replace(scene.frames, scale=2 * scene.frames.scale, shift_world=scene.frames.shift_world + 1.0)
    other = moved.in_frames(frames, scene.box)
    stated = frames.to_world(other.stated_centre.numpy())
    assert abs(stated - scene.frames.to_world(scene.cameras.centre.numpy())).max() < 1e-4
    assert SceneRecord.of(other).restored(scene).cameras.centre.equal(other.cameras.centre)
