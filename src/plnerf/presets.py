"""Named settings, each a plain value that says which paper it follows and what it changes.

A preset is a start: single settings are changed with --set path.to.key=value.
"""

from dataclasses import dataclass, replace

from plnerf.errors import ConfigError
from plnerf.field.density import DensityConfig
from plnerf.field.radiance import RadianceConfig
from plnerf.field.tubes import TubeConfig
from plnerf.ops.grid import GridShape
from plnerf.render.model import ModelConfig
from plnerf.render.proposals import SamplerConfig
from plnerf.train.config import TrainConfig
from plnerf.train.losses import LossWeights


@dataclass(frozen=True)
class Preset:
    """Settings of a system before they are fitted to a scene."""

    model: ModelConfig
    train: TrainConfig
    cells_per_pixel: float = 1.0
    """Cells of the finest level per pixel's width at a distance of one scene unit; decides
    field.grid.finest.
    """


def _proposal(finest: int) -> DensityConfig:
    return DensityConfig(GridShape(levels=5, coarsest=16, finest=finest, features=2, log2_table=15))


PL_NERF = Preset(
    # Sensors 2023, 23(23), 9537, section 4.2.2, sized for a CPU: eight levels of four features in a table
    # that stays in cache, instead of Instant-NGP's sixteen of two in 2^19 entries; 24 final samples
    # instead of nerfacto's 48.
    model=ModelConfig(
        field=RadianceConfig(GridShape(levels=8, coarsest=16, finest=512, features=4, log2_table=17)),
        proposals=(_proposal(64), _proposal(128)),
        sampler=SamplerConfig(proposals=(64, 32), final=24),
    ),
    train=TrainConfig(),
)

NERFACTO = Preset(
    # nerfacto (Tancik et al. 2023) at the sizes of pl-nerf, so that a comparison at equal time compares
    # methods and not table sizes: spherical harmonics in place of the frustum's IPE, no normals, pixels
    # drawn uniformly.
    model=replace(PL_NERF.model, field=replace(PL_NERF.model.field, direction_encoding="sh", normals=False)),
    train=TrainConfig(detail_share=0.0, normal_rays=0),
)

PL_NERF_WIRE = Preset(
    # pl-nerf, and all that was measured to keep wires whole (docs/wires.md): conductors are found as curves
    # in the images first; along them pixels are drawn, samples are laid and a field of their own is read.
    # More samples and cells across the line than along it, since a span is ten times longer than it is wide.
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
        table_rate=0.01,
        network_rate=0.01,
        loss=LossWeights(distortion=0.0003),
    ),
)

PRESETS = {"pl-nerf": PL_NERF, "pl-nerf-wire": PL_NERF_WIRE, "nerfacto": NERFACTO}


def find_preset(name: str) -> Preset:
    """The preset of a name.  Raises ConfigError naming the ones there are."""
    if name not in PRESETS:
        raise ConfigError(f"There is no preset {name!r}. Presets: {', '.join(PRESETS)}.")
    return PRESETS[name]
