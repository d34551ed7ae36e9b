"""Mip-NeRF (Barron et al. 2021): IPE of cones in place of points, one network for both passes.

Sizes and training are those of `nerf`.
"""

from dataclasses import replace

from plnerf.field.config import VanillaConfig
from plnerf.presets.nerf import PRESET as NERF
from plnerf.render.config import CoarseFineConfig, SamplerConfig
from plnerf.train.config import Preset

PRESET = Preset(
    model=CoarseFineConfig(
        field=VanillaConfig(encoding="ipe", octaves=16),
        sampler=SamplerConfig(proposals=(32,), final=32, padding=0.01),
        networks=1,
    ),
    train=replace(NERF.train, loss=replace(NERF.train.loss, coarse=0.1)),
    year=2021,
    rays_per_s=449.0,
)
