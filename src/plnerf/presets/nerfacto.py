"""nerfacto (Tancik et al. 2023): spherical harmonics in place of the frustum's IPE, pixels drawn uniformly.

At the sizes of pl-nerf, so that a comparison at equal time compares methods and not table sizes; no normals.
"""

from dataclasses import replace

from plnerf.presets.pl_nerf import PRESET as PL_NERF
from plnerf.train.config import Preset, TrainConfig

PRESET = Preset(
    model=replace(PL_NERF.model, field=replace(PL_NERF.model.field, direction_encoding="sh", normals=False)),
    train=TrainConfig(detail_share=0.0, normal_rays=0),
    year=2023,
    rays_per_s=15_600.0,
)
