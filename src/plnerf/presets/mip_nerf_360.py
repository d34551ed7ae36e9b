"""Mip-NeRF 360 (Barron et al. 2022): contraction into a ball, one proposal network, distortion loss.

The large network is NeRF's 8 x 256 in place of 8 x 1024, for a CPU, and encodes along the axes only.
"""

from dataclasses import replace

from plnerf.presets.nerf import PRESET as NERF
from plnerf.render.config import DeepProposalsConfig
from plnerf.train.config import LossWeights, Preset

PRESET = Preset(
    model=DeepProposalsConfig(),
    train=replace(NERF.train, anneal_steps=300, loss=LossWeights(distortion=0.01)),
    year=2022,
    rays_per_s=985.0,
)
