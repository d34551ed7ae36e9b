"""The occupancy grid: what is empty is passed over, the picture stays, what was never met is looked at."""

from dataclasses import replace

import pytest
import torch
from tests.render.test_coarse_fine import some_rays
from torch import Tensor

from plnerf.errors import ConfigError
from plnerf.field.config import OccupancyConfig, RadianceConfig
from plnerf.field.occupancy import OccupancyGrid
from plnerf.ops.grid import GridShape
from plnerf.render.config import OccupancyGridConfig, SamplerConfig
from plnerf.render.occupancy_grid import OccupancyGridNeRF

FIELD = RadianceConfig(
    GridShape(3, 4, 16, 2, 12), hidden=16, direction_encoding="sh", appearance=2, normals=False
)
CONFIG = OccupancyGridConfig(
    FIELD, SamplerConfig(proposals=(), final=64, near=0.05, far=50.0), OccupancyConfig(cells=16, samples=4096)
)

MIDDLE = torch.tensor([0.3, 0.5, 0.7])


def ball(unit: Tensor) -> Tensor:
    """Density 100 in a ball of radius 0.2 off the middle of the cube, nothing elsewhere."""
    return 100.0 * ((unit - MIDDLE).norm(dim=-1) < 0.2)


def a_system() -> OccupancyGridNeRF:
    """A field that is empty at most places, and a grid that knows it well."""
    system = OccupancyGridNeRF(CONFIG, 3, "torch", torch.Generator().manual_seed(0))
    with torch.no_grad():
        system.field.grid.table *= 3e4
        system.field.density_network[-1].bias[0] = -4.0
    generator = torch.Generator().manual_seed(1)
    for step in range(0, 16 * 200, 16):
        system.update(step, generator)
    return system


def test_the_grid_learns_where_something_is() -> None:
    grid, generator = OccupancyGrid(CONFIG.occupancy), torch.Generator().manual_seed(0)
    unit = torch.rand(2000, 1, 3, generator=generator)
    unit = torch.cat([unit, unit], 1)  # the second is a ray's last, which is always looked at
    t = torch.tensor([0.0, 0.1, 0.2]).expand(2000, -1)
    assert grid.full(unit, t).all()  # nothing is known yet
    for _ in range(100):
        grid.update(ball, generator)
    full = grid.full(unit, t)
    away = (unit[:, 0] - MIDDLE).norm(dim=-1)
    cell = 3**0.5 / CONFIG.occupancy.cells
    assert full[away < 0.2 - cell, 0].all() and not full[away > 0.2 + cell, 0].any()
    assert full[:, 1].all()


def test_what_goes_away_is_forgotten_and_what_comes_is_seen_at_once() -> None:
    grid, generator = OccupancyGrid(OccupancyConfig(cells=4, samples=2000)), torch.Generator().manual_seed(0)
    unit, t = torch.full((1, 2, 3), 0.5), torch.tensor([[0.0, 1.0, 2.0]])
    grid.update(lambda unit: torch.ones(len(unit)), generator)
    assert grid.full(unit, t)[0, 0]
    for _ in range(200):
        grid.update(lambda unit: torch.zeros(len(unit)), generator)
    assert not grid.full(unit, t)[0, 0]
    grid.update(lambda unit: torch.ones(len(unit)), generator)
    assert grid.full(unit, t)[0, 0]


def test_a_field_that_is_empty_everywhere_can_be_sampled_again() -> None:
    grid, generator = OccupancyGrid(OccupancyConfig(cells=4, samples=2000)), torch.Generator().manual_seed(0)
    for _ in range(3):
        grid.update(lambda unit: torch.zeros(len(unit)), generator)
    assert grid.met.all() and not grid.density.any()


def test_the_picture_stays_while_much_is_passed_over() -> None:
    """No colour changes by more than the light that intervals below `least` could have."""
    system, rays = a_system(), some_rays(300)
    appearance = torch.zeros(300, 2)
    with torch.inference_mode():
        skipping = system(rays, appearance=appearance)
        system.skips = False
        whole = system(rays, appearance=appearance)
    passed_over = (skipping.histograms[0].w == 0) & (whole.histograms[0].w > 0)
    assert 0.2 < passed_over.float().mean() < 0.99
    bound = CONFIG.occupancy.least * passed_over.sum(1)
    change = (skipping.colour - whole.colour).abs().amax(1)
    assert (change <= bound + 1e-5).float().mean() > 0.99  # a cell's densest place may not have been met
    assert change.mean() < 0.02


def test_every_parameter_is_trained_but_for_the_poses() -> None:
    system, rays = a_system(), some_rays(100)
    out = system(rays, appearance=system.appearance[rays.camera], generator=torch.Generator().manual_seed(1))
    out.colour.square().sum().backward()
    for key, value in system.named_parameters():
        if not key.startswith("poses"):
            assert value.grad is not None and value.grad.abs().max() > 0, key


def test_the_grid_is_part_of_the_checkpoint() -> None:
    assert {"occupancy.density", "occupancy.met"} <= set(a_system().state_dict())


def test_wrong_settings_are_told() -> None:
    with pytest.raises(ConfigError, match="no proposal rounds"):
        OccupancyGridConfig(FIELD, SamplerConfig())
    with pytest.raises(ConfigError, match="least > 0"):
        OccupancyConfig(least=0.0)
    with pytest.raises(ConfigError, match="it predicts none"):
        a_system()(some_rays(2), appearance=torch.zeros(2, 2), normals=True)


def test_normals_are_those_of_what_is_seen() -> None:
    """With the normal network of its field; an interval that was passed over has none, and no weight."""
    config = replace(CONFIG, field=replace(FIELD, normals=True))
    system, rays = OccupancyGridNeRF(config, 3, "torch", torch.Generator().manual_seed(0)), some_rays(50)
    assert system.predicts_normals and not a_system().predicts_normals
    system.update(0, torch.Generator().manual_seed(1))
    with torch.no_grad():
        system.occupancy.density *= torch.rand(len(system.occupancy.density)) < 0.5
    out = system(rays, appearance=torch.zeros(50, 2), normals=True, normal_rays=20)
    samples = out.normal_samples
    assert samples is not None and out.normals is not None
    assert samples.predicted.shape == samples.from_density.shape == (20, 64, 3)
    passed_over = samples.predicted.norm(dim=-1) == 0
    assert 0.1 < passed_over.float().mean() < 0.9
    assert not samples.weights[passed_over].any()
    assert torch.allclose(samples.predicted.norm(dim=-1)[~passed_over], torch.ones(()))
    expected = (samples.weights[..., None] * samples.predicted).sum(1)
    assert torch.allclose(out.normals[:20], expected, atol=1e-5)
    (samples.weights[..., None] * (samples.predicted - samples.from_density)).square().sum().backward()
    for key in ("grid.table", "normal_network.0.weight"):
        gradient = system.field.get_parameter(key).grad
        assert gradient is not None and gradient.abs().max() > 0, key
