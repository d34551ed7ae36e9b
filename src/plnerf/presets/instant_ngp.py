"""Instant-NGP (Mueller et al. 2022): hash encoding, spherical harmonics, an occupancy grid, no proposals.

The hash table at the size of pl-nerf's, the L-infinity contraction in place of its cascade of cubes, 128 even
samples a ray in place of up to 1024.
"""

from dataclasses import replace

from plnerf.presets.pl_nerf import PRESET as PL_NERF
from plnerf.render.config import OccupancyGridConfig
from plnerf.train.config import LossWeights, Preset, TrainConfig

PRESET = Preset(
    model=OccupancyGridConfig(
        field=replace(PL_NERF.model.field, direction_encoding="sh", normals=False, appearance=0)
    ),
    train=TrainConfig(detail_share=0.0, normal_rays=0, loss=LossWeights(interlevel=0.0, distortion=0.0)),
    year=2022,
    rays_per_s=20_000.0,
)
