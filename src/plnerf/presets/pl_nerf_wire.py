"""pl-nerf, and all that was measured to keep wires whole (docs/wires.md).

Conductors are found as curves in the images first; along them pixels are drawn, samples are laid and a field
of their own is read.  More samples and cells across the line than along it, since a span is ten times longer
than it is wide.
"""

from dataclasses import replace

from plnerf.field.config import TubeConfig
from plnerf.presets.pl_nerf import PRESET as PL_NERF
from plnerf.render.config import SamplerConfig
from plnerf.train.config import LossWeights, Preset, TrainConfig

PRESET = Preset(
    model=replace(
        PL_NERF.model,
        sampler=SamplerConfig(proposals=(64, 48), final=40),
        tubes=TubeConfig(),
        stretch=(1.0, 3.0, 2.0),
    ),
    train=TrainConfig(
        find_wires=True,
        curve_share=0.3,
        detail_share=0.3,
        detail_part=0.05,
        normal_rays=16,
        hash_lr=0.01,
        mlp_lr=0.01,
        loss=LossWeights(distortion=0.0003),
    ),
    year=2026,
    rays_per_s=6_730.0,
)
