"""PL-NeRF: Sensors 2023, 23(23), 9537, section 4.2.2, sized for a CPU.

Eight levels of four features in a table that stays in cache, instead of Instant-NGP's sixteen of two in 2^19
entries; 24 final samples instead of nerfacto's 48.
"""

from plnerf.field.config import DensityConfig, RadianceConfig
from plnerf.ops.grid import GridShape
from plnerf.render.config import ModelConfig, SamplerConfig
from plnerf.train.config import Preset, TrainConfig


def _proposal(finest: int) -> DensityConfig:
    return DensityConfig(GridShape(levels=5, coarsest=16, finest=finest, features=2, log2_table=15))


PRESET = Preset(
    model=ModelConfig(
        field=RadianceConfig(GridShape(levels=8, coarsest=16, finest=512, features=4, log2_table=17)),
        proposals=(_proposal(64), _proposal(128)),
        sampler=SamplerConfig(proposals=(64, 32), final=24),
    ),
    train=TrainConfig(),
    year=2023,
    rays_per_s=12_200.0,
)
