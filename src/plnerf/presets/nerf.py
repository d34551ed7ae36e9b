"""NeRF (Mildenhall et al. 2020; paper 4.2.1): the networks as published.

For a CPU, 32 + 32 samples in place of 64 + 128, and 64 rays in place of 4096: in a minute on two cores, many
noisy steps learn more than few good ones (span at a third, 60 s: 512 rays 17.0 dB, 128 20.3, 64 20.7).
Samples reach to infinity as those of the other presets do, in place of normalised device coordinates, which
only face forward. The published learning rate and its decay to a tenth, pixels drawn uniformly, each with its
own colour from the start, and the colour as only loss.
"""

from plnerf.render.config import CoarseFineConfig, SamplerConfig
from plnerf.train.config import LossWeights, Preset, TrainConfig

PRESET = Preset(
    model=CoarseFineConfig(sampler=SamplerConfig(proposals=(32,), final=32, padding=1e-5)),
    train=TrainConfig(
        rays=64,
        detail_share=0.0,
        normal_rays=0,
        anneal_steps=1,
        mlp_lr=5e-4,
        lr_fall_from=0.0,
        lr_final_factor=0.1,
        smooth_px=1,
        loss=LossWeights(interlevel=0.0, distortion=0.0),
    ),
    year=2020,
    rays_per_s=455.0,
)
