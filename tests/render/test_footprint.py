"""Estimates of memory lie below what is used, and near enough to it to refuse what cannot work."""

from dataclasses import replace

import pytest
import torch
from tests.support.oracle import tiny_config

from plnerf.field.config import RadianceConfig, TubeConfig
from plnerf.ops.grid import GridShape
from plnerf.render.config import (
    CoarseFineConfig,
    DeepProposalsConfig,
    OccupancyGridConfig,
    SamplerConfig,
    SystemConfig,
)
from plnerf.render.footprint import parameter_bytes, ray_bytes
from plnerf.render.systems import build_system

IMAGES = 50
GRID = GridShape(levels=6, coarsest=16, finest=512, features=2, log2_table=14)
SYSTEMS: dict[str, SystemConfig] = {
    "pl-nerf": replace(tiny_config(), field=RadianceConfig(GRID, hidden=128, colour_layers=3)),
    "wide": replace(tiny_config(), field=RadianceConfig(replace(GRID, log2_table=4), hidden=512)),
    "without-curves": replace(tiny_config(), tubes=TubeConfig()),
    "nerf": CoarseFineConfig(),
    "mip-nerf-360": DeepProposalsConfig(),
    "instant-ngp": OccupancyGridConfig(RadianceConfig(GRID)),
}


@pytest.mark.parametrize("name", SYSTEMS)
def test_parameters_are_estimated_from_below(name: str) -> None:
    config = SYSTEMS[name]
    system = build_system(config, IMAGES, "torch", torch.Generator())
    kept = [*system.parameters(), *system.buffers()]
    real = sum(value.numel() * value.element_size() for value in kept)
    assert real / 2 < parameter_bytes(config, IMAGES) <= real


def test_tubes_count_where_there_are_curves() -> None:
    config = replace(tiny_config(), tubes=TubeConfig())
    grid = TubeConfig().grid
    more = parameter_bytes(config, IMAGES, guided=True) - parameter_bytes(config, IMAGES)
    assert more == pytest.approx(4 * grid.rows * grid.features, rel=0.01)


def test_intervals_of_all_rounds_count() -> None:
    config = replace(DeepProposalsConfig(), sampler=SamplerConfig(proposals=(40, 20), final=10))
    assert ray_bytes(config, 1000) == 4 * 4 * 1000 * 70
