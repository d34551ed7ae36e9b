"""pl-nerf, and all that was measured to keep wires whole (docs/wires.md) and to learn sooner.

Conductors are found as curves in the images first; along them pixels are drawn, samples are laid and a field
of their own is read.  More samples and cells across the line than along it, since a span is ten times longer
than it is wide.  Directions by spherical harmonics and one hidden layer of colours: a step takes less
time and teaches no less (docs/performance.md).
"""

from dataclasses import replace

from plnerf.field.config import TubeConfig
from plnerf.presets.pl_nerf import PRESET as PL_NERF
from plnerf.render.config import SamplerConfig
from plnerf.train.config import LossWeights, Preset, TrainConfig

PRESET = Preset(
    model=replace(
        PL_NERF.model,
        field=replace(PL_NERF.model.field, direction_encoding="sh", colour_layers=1),
        sampler=SamplerConfig(proposals=(64, 48), final=40),
        tubes=TubeConfig(),
        stretch=(1.0, 3.0, 2.0),
    ),
    train=TrainConfig(
        find_wires=True,
        curve_share=0.1,
        detail_share=0.1,
        detail_part=0.05,
        normal_rays=16,
        loss=LossWeights(distortion=0.0003),
    ),
    year=2026,
    rays_per_s=6_730.0,
)
