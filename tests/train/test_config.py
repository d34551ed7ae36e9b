"""What a run may be asked for, and what is refused before it starts."""

import dataclasses
import math
from pathlib import Path
from typing import Any

import pytest
from tests.support.tiny_run import open_tiny

from plnerf.errors import ConfigError
from plnerf.presets import preset_names
from plnerf.presets._find import find_preset
from plnerf.presets.pl_nerf import PRESET as PL_NERF
from plnerf.scene.scene import load_scene
from plnerf.train.config import LossWeights, RunConfig, TrainConfig
from plnerf.train.fitted import fit_to_scene
from plnerf.train.settings import from_json, to_json

GOOD: dict[str, Any] = {
    "scene": "/s",
    "downscale": 1,
    "preset": "pl-nerf",
    "backend": "numba",
    "device": "cpu",
}


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("rays", 0),
        ("normal_rays", -1),
        ("normal_rays", 513),
        ("detail_share", 1.0),
        ("detail_share", -0.1),
        ("detail_part", 0.0),
        ("detail_part", 1.1),
        ("checkpoints", 0),
        ("validations", -1),
        ("warmup_steps", 0),
        ("anneal_steps", 0),
        ("hash_lr", -1e-3),
        ("mlp_lr", -1e-3),
        ("pose_lr", -1e-3),
        ("lr_fall_from", 1.0),
        ("lr_fall_from", -0.1),
        ("lr_final_factor", 0.0),
        ("lr_final_factor", 1.5),
        ("pose_from", 1.5),
        ("normals_from", -0.1),
        ("normals_from", 1.1),
    ],
)
def test_a_wrong_value_is_named(name: str, value: float) -> None:
    with pytest.raises(ConfigError, match=rf"\b{name}={value}\b"):
        TrainConfig(**{name: value})


def test_the_bounds_themselves_are_allowed() -> None:
    TrainConfig(rays=1, normal_rays=0, detail_share=0.0, detail_part=1.0, checkpoints=1, validations=0)
    TrainConfig(warmup_steps=1, anneal_steps=1, hash_lr=0.0, lr_final_factor=1.0, pose_from=1.0)


@pytest.mark.parametrize(
    "budget",
    [
        {},
        {"steps": 10, "seconds": 1.0},
        {"steps": 0},
        {"steps": -5},
        {"seconds": 0.0},
        {"seconds": -1.0},
        {"seconds": math.nan},
        {"seconds": math.inf},
    ],
)
def test_a_budget_is_one_positive_number(budget: dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match="budget"):
        RunConfig(**GOOD, model=PL_NERF.model, **budget)


@pytest.mark.parametrize("seed", [-1, 1 << 63])
def test_a_seed_that_no_generator_takes(seed: int) -> None:
    with pytest.raises(ConfigError, match=f"is {seed}"):
        RunConfig(**GOOD, model=PL_NERF.model, steps=1, seed=seed)


def test_a_run_cannot_be_changed_in_place() -> None:
    run = RunConfig(**GOOD, model=PL_NERF.model, steps=1)
    with pytest.raises(dataclasses.FrozenInstanceError):
        run.seed = 3  # type: ignore[misc]  # that is the test


def test_the_finest_cells_follow_the_pixels(tiny_scene: Path, tmp_path: Path) -> None:
    """A cell of the 4 wide contracted cube is as wide as a pixel at 1 scene unit, at any resolution."""
    scene = open_tiny(tiny_scene, tmp_path)
    half = load_scene(tiny_scene, store=tmp_path / "half", downscale=2)
    for one, share in ((scene, 1.0), (half, 1.0), (scene, 0.5)):
        model = fit_to_scene(PL_NERF.model, one, share)
        cell, pixel = 4 / model.field.grid.finest, 1 / float(one.cameras.focal_px.mean())
        assert cell == pytest.approx(pixel / share, rel=0.02)
        rest = dataclasses.replace(model.field.grid, finest=PL_NERF.model.field.grid.finest)
        field = dataclasses.replace(model.field, grid=rest)
        assert dataclasses.replace(model, field=field) == PL_NERF.model


def test_the_finest_cells_are_never_coarser_than_the_coarsest(tiny_scene: Path, tmp_path: Path) -> None:
    model = fit_to_scene(PL_NERF.model, open_tiny(tiny_scene, tmp_path), 1e-6)
    assert model.field.grid.finest == model.field.grid.coarsest


@pytest.mark.parametrize("blur", [(0.03,), (0.03, 0.003, 0.001)])
def test_a_blur_without_its_proposal_round_is_refused(blur: tuple[float, ...]) -> None:
    train = TrainConfig(loss=LossWeights(interlevel_blur=blur))
    with pytest.raises(ConfigError, match=f"each of the 2 proposal rounds, or none, but has {len(blur)}"):
        RunConfig(**GOOD, model=PL_NERF.model, train=train, steps=1)
    RunConfig(
        **GOOD, model=PL_NERF.model, train=TrainConfig(loss=LossWeights(interlevel_blur=(0.1, 0.0))), steps=1
    )


def test_the_kind_of_a_system_is_told_apart_and_an_unknown_one_refused() -> None:
    for preset in map(find_preset, preset_names()):
        run = RunConfig(**GOOD, model=preset.model, train=preset.train, steps=1)
        assert from_json(RunConfig, to_json(run), "x") == run
    data = to_json(RunConfig(**GOOD, model=PL_NERF.model, steps=1))
    del data["model"]["kind"]  # as runs were written before there was another kind
    assert from_json(RunConfig, data, "x").model == PL_NERF.model
    data["model"]["kind"] = "gaussians"
    with pytest.raises(ConfigError, match=r"model\.kind must be one of 'pl-nerf', .* but is 'gaussians'"):
        from_json(RunConfig, data, "x")
