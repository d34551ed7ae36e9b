"""What training makes of detected wires: which pixels, which guides, and what the detection costs."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
import torch
from tests.support.drawn import uncertain
from tests.support.tiny_run import open_tiny, tiny_config

from plnerf.detect.config import ChainConfig, DetectConfig
from plnerf.errors import ConfigError
from plnerf.line.base import Base
from plnerf.line.ends import Evidence, Open
from plnerf.line.files import read_wires, write_wires
from plnerf.line.frame import LineFrame
from plnerf.line.wire import Wire
from plnerf.scene.cameras import project
from plnerf.scene.scene import Scene
from plnerf.train.config import RunConfig
from plnerf.train.guidance import (
    OLD_WIRES,
    WIRES,
    favoured_pixels,
    guides_for,
    run_wires,
    wire_pixels,
)
from plnerf.train.loop import billable_seconds, train
from plnerf.train.report import SilentReport
from plnerf.train.run import open_run
from plnerf.train.settings import to_json

REACH, HALF = 0.04, 0.4
"""Scene units."""
THETA = np.array([0.01, 0.09, -0.238, -0.198, 0.032])
"""y is 0.05 + 0.1 x and z is -0.25 + 0.05 x + 0.2 x^2 for x from -0.4 to 0.4."""


def on_curve(x: np.ndarray, up: float = 0.0) -> torch.Tensor:
    """Points of the curve in the scene frame."""
    return torch.from_numpy(np.stack([x, 0.05 + 0.1 * x, up - 0.25 + x * (0.05 + 0.2 * x)], 1)).float()


def wire_of(scene: Scene, up: float = 0.0) -> Wire:
    """The curve as a certain wire in the scene's LineFrame."""
    unit = LineFrame.of_scene(scene.frames).from_scene(np.ones(1))[0]
    theta = unit * np.append(THETA + np.array([0, 0, up, up, 0]), 0.0)
    base = Base(unit * np.array([-HALF, 0.0]), unit * np.array([HALF, 0.0]))
    evidence = Evidence("a drawing", 1, reach_m=float(unit * REACH))
    return Wire(1, base, theta, np.zeros((6, 6)), (Open("drawn"), Open("drawn")), evidence)


@pytest.fixture
def scene(tiny_scene: Path, tmp_path: Path) -> Scene:
    return open_tiny(tiny_scene, tmp_path)


@pytest.fixture
def config(tiny_scene: Path) -> RunConfig:
    return tiny_config(tiny_scene, "train.find_wires=true", "train.curve_share=0.25", steps=3)


def test_wire_pixels_are_those_near_the_wires_image_in_training_images(scene: Scene) -> None:
    """Against all pixels of all images, each by its distance from the finely projected curve."""
    chosen = set(wire_pixels(scene, [wire_of(scene)], scene.train).tolist())
    seen, depth = project(scene.cameras, on_curve(np.linspace(-HALF, HALF, 2000)))
    on_wire = 0
    for i in range(len(scene.names)):
        w, h = (int(side) for side in scene.cameras.size_px[i])
        image = seen[i][depth[i] > 1e-3].numpy()
        row, column = np.divmod(np.arange(w * h), w)
        centre = np.stack([column + 0.5, row + 0.5], 1)
        apart = (
            np.linalg.norm(centre[:, None] - image[None], axis=2).min(1) if len(image) else np.full(w * h, 99)
        )
        widest = REACH * float(scene.cameras.focal_px[i].mean() / depth[i][depth[i] > 1e-3].min())
        mine = np.array([int(scene.images.starts[i]) + k in chosen for k in range(w * h)])
        if i in scene.test:
            assert not mine.any()
            continue
        assert mine[apart < 0.7].all()
        assert not mine[apart > max(widest, 2) + 2].any()
        on_wire += int(mine.sum())
    assert on_wire == len(chosen) > 0
    assert sorted(chosen) == wire_pixels(scene, [wire_of(scene)], scene.train).tolist()


def test_a_wire_behind_all_cameras_has_no_pixels(scene: Scene) -> None:
    up = float(scene.cameras.centre[:, 2].max()) + 5.0
    ahead, depth = project(scene.cameras, on_curve(np.linspace(-HALF, HALF, 50), up))
    w, h = scene.cameras.size_px.T[..., None]
    inside = (depth > 0) & (ahead[..., 0] > -9) & (ahead[..., 0] < w + 9)
    inside &= (ahead[..., 1] > -9) & (ahead[..., 1] < h + 9)
    assert not inside.any()
    assert len(wire_pixels(scene, [wire_of(scene, up)], scene.train)) == 0


def test_only_certain_wires_guide_and_stored_ones_cost_nothing(
    scene: Scene, config: RunConfig, tmp_path: Path
) -> None:
    """Wires that lie in the folder without a scene are those of the scene as it was read: frames are fitted
    to them."""
    sure, frame = wire_of(scene), LineFrame.of_scene(scene.frames)
    write_wires(tmp_path / WIRES, [uncertain(sure), sure], frame, {})
    fitted, wires, seconds = run_wires(config, scene, tmp_path)
    assert seconds == 0.0
    (only,) = wires
    assert only.evidence.certain and only.theta[5] == 0
    guides = guides_for(wires, fitted, config)
    assert guides is not None and len(guides) == 1
    half = np.hypot(HALF, 0.04)  # of the wire, which leaves its base sideways
    assert guides.ends[0].tolist() == pytest.approx([-HALF / half, HALF / half])
    assert guides.reach[0].item() == pytest.approx(REACH / half)
    assert guides_for((), scene, config) is None
    off = dataclasses.replace(config, train=dataclasses.replace(config.train, find_wires=False))
    same, none, seconds = run_wires(off, scene, tmp_path)
    assert same is scene and (none, seconds) == ((), 0.0)


def test_the_file_of_wires_holds_all_of_them_and_the_settings(
    scene: Scene, config: RunConfig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With wires as if they had been detected, by the settings of the run."""
    sure, asked = wire_of(scene), list[DetectConfig]()

    def detect(scene: Scene, config: DetectConfig) -> tuple[Wire, ...]:
        asked.append(config)
        return (uncertain(sure), sure)

    monkeypatch.setattr("plnerf.train.guidance.detect_wires", detect)
    coarse = dataclasses.replace(config, detect=DetectConfig(chains=ChainConfig(least_px=20.0)))
    _, wires, seconds = run_wires(coarse, scene, tmp_path / "run")
    assert asked == [coarse.detect] and len(wires) == 1 and seconds > 0
    data = json.loads((tmp_path / "run" / WIRES).read_text())
    assert data["settings"] == to_json(coarse.detect) and data["settings"]["chains"]["least_px"] == 20.0
    assert [row["evidence"]["certain"] for row in data["wires"]] == [False, True]
    assert {path.name for path in (tmp_path / "run").iterdir()} == {WIRES, "scene.json"}
    _, again, seconds = run_wires(coarse, scene, tmp_path / "run")
    assert len(asked) == 1 and seconds == 0.0 and (again[0].theta == wires[0].theta).all()


def detecting(monkeypatch: pytest.MonkeyPatch, *wires: Wire) -> None:
    """Wires as if they had been detected."""
    monkeypatch.setattr("plnerf.train.guidance.detect_wires", lambda *_: wires)


def test_frames_are_fitted_to_the_wires_and_come_back_to_the_last_bit(
    scene: Scene, config: RunConfig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The wire runs along x from -1 to 1, at the same places of the world, before the same pixels."""
    sure = wire_of(scene)
    detecting(monkeypatch, uncertain(wire_of(scene, 3.0)), sure)
    fitted, (wire,), _ = run_wires(config, scene, tmp_path)
    old, new = LineFrame.of_scene(scene.frames), LineFrame.of_scene(fitted.frames)
    s = np.linspace(0, 1, 30)
    there = new.to_scene(wire.points(s * wire.base.length_m))
    np.testing.assert_allclose(there[[0, -1], 0], [-1, 1], atol=1e-9)
    np.testing.assert_allclose(there[[0, -1], 1], 0, atol=1e-9)
    world = old.to_world(sure.points(s * sure.base.length_m))
    np.testing.assert_allclose(new.to_world(wire.points(s * wire.base.length_m)), world, atol=1e-9)
    np.testing.assert_allclose(fitted.frames.to_world(there), world, atol=1e-9)
    before, after = (
        project(one.cameras, torch.from_numpy(one.frames.to_scene(world)).float())[0]
        for one in (scene, fitted)
    )
    assert (before - after).abs().max() < 1e-3
    assert (fitted.box[0] < there.min(0)).all() and (fitted.box[1] > there.max(0)).all()
    for trained in (False, True):
        same, (again,), seconds = run_wires(config, scene, tmp_path, trained=trained)
        assert seconds == 0 and same.frames.to_json() == fitted.frames.to_json()
        assert np.array_equal(same.box, fitted.box)
        assert torch.equal(same.cameras.centre, fitted.cameras.centre)
        assert torch.equal(same.cameras.R_scene_camera, fitted.cameras.R_scene_camera)
        assert np.array_equal(again.theta, wire.theta) and np.array_equal(again.base.a, wire.base.a)
        assert np.array_equal(again.covariance, wire.covariance) and again.evidence == wire.evidence


def test_a_scene_without_a_certain_wire_keeps_its_frames(
    scene: Scene, config: RunConfig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    detecting(monkeypatch, uncertain(wire_of(scene)))
    fitted, wires, _ = run_wires(config, scene, tmp_path)
    assert wires == () and fitted.frames.to_json() == scene.frames.to_json()
    assert np.array_equal(fitted.box, scene.box) and fitted.cameras is scene.cameras
    ((kept,), _) = read_wires(tmp_path / WIRES)
    assert np.array_equal(kept.theta, wire_of(scene).theta)


def test_a_run_with_wires_is_trained_resumed_and_opened_in_its_own_frames(
    scene: Scene, config: RunConfig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Interrupted and resumed, the weights are those of an uninterrupted run to the bit."""
    detecting(monkeypatch, wire_of(scene))
    whole = open_run(train(config, tmp_path / "whole", SilentReport()))
    train(dataclasses.replace(config, steps=2), tmp_path / "cut", SilentReport())
    cut = open_run(train(config, tmp_path / "cut", SilentReport()))
    assert cut.step == whole.step == 3 and cut.record.frames.to_json() == whole.record.frames.to_json()
    assert cut.record.frames.to_json() != scene.frames.to_json()
    seen, world = cut.scene.cameras, scene.cameras
    for i in (0, 5):
        pose, other = (
            one.frames.pose_to_world(c.R_scene_camera[i].double().numpy(), c.centre[i].double().numpy())
            for one, c in ((cut.scene, seen), (scene, world))
        )
        np.testing.assert_allclose(pose, other, atol=1e-5)
    assert torch.equal(cut.scene.cameras.centre, cut.record.cameras.centre)
    assert cut.wires is not None and np.array_equal(cut.wires[0].theta, whole.wires[0].theta)
    (cut.folder / WIRES).unlink()
    for use in (lambda: open_run(cut.folder), lambda: train(config, cut.folder, SilentReport())):
        with pytest.raises(ConfigError, match=r"wires\.json is not there: .* train again"):
            use()


def test_a_run_of_an_earlier_version_is_refused(scene: Scene, config: RunConfig, tmp_path: Path) -> None:
    (tmp_path / OLD_WIRES).write_text("{}")
    with pytest.raises(ConfigError, match=r"earlier version .* Train again into another folder") as caught:
        run_wires(config, scene, tmp_path)
    assert str(tmp_path) in str(caught.value) and "\n" not in str(caught.value)
    off = dataclasses.replace(config, train=dataclasses.replace(config.train, find_wires=False))
    assert run_wires(off, scene, tmp_path) == (scene, (), 0.0)


def test_wire_pixels_have_their_share_of_the_draws(scene: Scene, config: RunConfig) -> None:
    wires = [wire_of(scene)]
    assert [pool.share for pool in favoured_pixels(config, scene, wires)][-1] == 0.25
    without = favoured_pixels(config, scene, ())
    assert len(without) == len(favoured_pixels(config, scene, wires)) - 1


def test_a_long_search_leaves_a_tenth_of_the_budget(config: RunConfig) -> None:
    by_time = dataclasses.replace(config, steps=None, seconds=20.0)
    assert billable_seconds(7.0, by_time) == 7.0
    with pytest.warns(UserWarning, match=r"took 50\.0 s of a budget of 20 s"):
        assert billable_seconds(50.0, by_time) == 18.0
    assert billable_seconds(50.0, config) == 50.0  # a budget in steps is not used up by time
