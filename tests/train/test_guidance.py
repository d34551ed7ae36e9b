"""What training makes of detected wires: which pixels, which guides, and what the detection costs."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
import torch
from tests.support.drawn import uncertain
from tests.support.tiny_run import open_tiny, tiny_config

from plnerf.detect.config import DetectConfig, SweepConfig
from plnerf.errors import ConfigError
from plnerf.line.base import Base
from plnerf.line.ends import Evidence, Open
from plnerf.line.files import write_wires
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
from plnerf.train.loop import billable_seconds
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
    chosen = set(wire_pixels(scene, [wire_of(scene)]).tolist())
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
    assert sorted(chosen) == wire_pixels(scene, [wire_of(scene)]).tolist()


def test_a_wire_behind_all_cameras_has_no_pixels(scene: Scene) -> None:
    up = float(scene.cameras.centre[:, 2].max()) + 5.0
    ahead, depth = project(scene.cameras, on_curve(np.linspace(-HALF, HALF, 50), up))
    w, h = scene.cameras.size_px.T[..., None]
    inside = (depth > 0) & (ahead[..., 0] > -9) & (ahead[..., 0] < w + 9)
    inside &= (ahead[..., 1] > -9) & (ahead[..., 1] < h + 9)
    assert not inside.any()
    assert len(wire_pixels(scene, [wire_of(scene, up)])) == 0


def test_only_certain_wires_guide_and_stored_ones_cost_nothing(
    scene: Scene, config: RunConfig, tmp_path: Path
) -> None:
    sure, frame = wire_of(scene), LineFrame.of_scene(scene.frames)
    write_wires(tmp_path / WIRES, [uncertain(sure), sure], frame, {})
    wires, seconds = run_wires(config, scene, tmp_path)
    assert seconds == 0.0
    (only,) = wires
    assert only.evidence.certain and (only.theta == sure.theta).all()
    guides = guides_for(wires, scene, config)
    assert guides is not None and len(guides) == 1
    assert guides.ends[0].tolist() == pytest.approx([-HALF, HALF])
    assert guides.reach[0].item() == pytest.approx(REACH)
    assert guides_for((), scene, config) is None
    off = dataclasses.replace(config, train=dataclasses.replace(config.train, find_wires=False))
    assert run_wires(off, scene, tmp_path) == ((), 0.0)


def test_the_file_of_wires_holds_all_of_them_and_the_settings(
    scene: Scene, config: RunConfig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With wires as if they had been detected, by the settings of the run."""
    sure, asked = wire_of(scene), list[DetectConfig]()

    def detect(scene: Scene, config: DetectConfig) -> tuple[Wire, ...]:
        asked.append(config)
        return (uncertain(sure), sure)

    monkeypatch.setattr("plnerf.train.guidance.detect_wires", detect)
    coarse = dataclasses.replace(config, detect=DetectConfig(sweep=SweepConfig(cell=0.01)))
    wires, seconds = run_wires(coarse, scene, tmp_path / "run")
    assert asked == [coarse.detect] and len(wires) == 1 and seconds > 0
    data = json.loads((tmp_path / "run" / WIRES).read_text())
    assert data["settings"] == to_json(coarse.detect) and data["settings"]["sweep"]["cell"] == 0.01
    assert [row["evidence"]["certain"] for row in data["wires"]] == [False, True]
    assert [path.name for path in (tmp_path / "run").iterdir()] == [WIRES]
    again, seconds = run_wires(coarse, scene, tmp_path / "run")
    assert len(asked) == 1 and seconds == 0.0 and (again[0].theta == wires[0].theta).all()


def test_a_run_of_an_earlier_version_is_refused(scene: Scene, config: RunConfig, tmp_path: Path) -> None:
    (tmp_path / OLD_WIRES).write_text("{}")
    with pytest.raises(ConfigError, match=r"earlier version .* Train again into another folder") as caught:
        run_wires(config, scene, tmp_path)
    assert str(tmp_path) in str(caught.value) and "\n" not in str(caught.value)
    off = dataclasses.replace(config, train=dataclasses.replace(config.train, find_wires=False))
    assert run_wires(off, scene, tmp_path) == ((), 0.0)


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
