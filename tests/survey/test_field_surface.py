"""The surfaces that a run's field shows."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from tests.support.tiny_run import Recorder, tiny_config

from plnerf.errors import ConfigError
from plnerf.line.frame import LineFrame
from plnerf.line.hang import hang
from plnerf.survey.config_ground import FieldConfig
from plnerf.survey.field_surface import field_surface, half_width
from plnerf.train.loop import train
from plnerf.train.run import TrainedRun, open_run

CONFIG = FieldConfig(rays=3000)


@pytest.fixture(scope="module")
def run(built_tiny_scene: Path, tmp_path_factory: pytest.TempPathFactory) -> TrainedRun:
    folder = tmp_path_factory.mktemp("survey") / "run"
    return open_run(train(tiny_config(built_tiny_scene, steps=3), folder, Recorder()))


def test_a_surface_is_the_same_twice_and_in_the_line_frame(run: TrainedRun) -> None:
    frame = LineFrame.of_scene(run.scene.frames)
    some = replace(CONFIG, min_accumulation=0.0, max_relative_sigma=9.0, max_isolation=1e3)
    one, other = (field_surface(run, frame, [], some) for _ in range(2))
    assert 0 < len(one.xyz) <= 3000 and (one.xyz == other.xyz).all()
    assert (one.sigma_m > 0).all() and np.isfinite(one.xyz).all() and one.rgb.dtype == np.uint8
    assert np.abs(np.linalg.norm(one.sight, axis=1) - 1).max() < 1e-6
    # Lengths and places are those of the scene in metres: in a frame of half the unit, twice as much.
    halved = replace(frame, scene_per_unit=frame.to_scene(np.ones(1))[0] / 2)
    twice = field_surface(run, halved, [], some)
    np.testing.assert_allclose(twice.xyz, 2 * one.xyz, rtol=1e-12)
    np.testing.assert_allclose(twice.sigma_m, 2 * one.sigma_m, rtol=1e-12)


def test_points_that_float_alone_or_far_out_are_dropped(run: TrainedRun) -> None:
    frame = LineFrame.of_scene(run.scene.frames)
    some = replace(CONFIG, min_accumulation=0.0, max_relative_sigma=9.0, max_isolation=1e3)
    every = field_surface(run, frame, [], some)
    stricter = field_surface(run, frame, [], replace(some, max_isolation=0.5))
    assert len(stricter.xyz) < len(every.xyz)
    low, high = frame.from_scene(run.scene.box)

    def half_sides(xyz: np.ndarray) -> np.ndarray:
        return np.abs(xyz - (low + high) / 2).max(1) / ((high - low).max() / 2)

    farthest = float(np.median(half_sides(every.xyz)))
    nearer = field_surface(run, frame, [], replace(some, farthest=farthest))
    assert 0 < len(nearer.xyz) < len(every.xyz) and (half_sides(nearer.xyz) <= farthest + 1e-9).all()


def test_what_is_near_a_wire_is_no_background_however_far_from_the_cameras(run: TrainedRun) -> None:
    frame = LineFrame.of_scene(run.scene.frames)
    some = replace(CONFIG, min_accumulation=0.0, max_relative_sigma=9.0, max_isolation=1e9, farthest=0.3)
    few = field_surface(run, frame, [], some)
    low, high = frame.from_scene(run.scene.box.astype(np.float64))
    side = high - low
    wire = hang(low - 3 * side, high + 3 * side, 0.01 * float(side[0]))
    assert len(field_surface(run, frame, [wire], some).xyz) > len(few.xyz)
    unsure = replace(wire, evidence=replace(wire.evidence, certain=False))
    assert len(field_surface(run, frame, [unsure], some).xyz) == len(few.xyz)


def test_of_many_images_each_gives_as_many_pixels_as_of_some(run: TrainedRun) -> None:
    frame, count = LineFrame.of_scene(run.scene.frames), len(run.scene.train)
    some = replace(CONFIG, min_accumulation=0.0, max_relative_sigma=9.0, max_isolation=1e3, farthest=1e9)
    fewer = field_surface(run, frame, [], replace(some, rays=600))
    more = field_surface(run, frame, [], replace(some, rays=600, most_sharing=2))
    assert len(fewer.xyz) <= 600 < len(more.xyz) <= 300 * count


def test_half_widths_are_those_of_normal_light() -> None:
    t = torch.linspace(0, 10, 2001)[None].double()
    for sigma in (0.1, 0.7):
        middle = (t[:, 1:] + t[:, :-1]) / 2
        w = torch.exp(-((middle - 5) ** 2) / (2 * sigma**2))
        assert half_width(t, 0.6 * w / w.sum())[0] == pytest.approx(sigma, rel=0.02)


def test_settings_that_cannot_work_are_refused() -> None:
    for wrong in ({"rays": 0}, {"neighbours": 0}, {"most_sharing": 0}):
        with pytest.raises(ConfigError, match="rays, most_sharing and neighbours of 1 or more"):
            FieldConfig(**wrong)
