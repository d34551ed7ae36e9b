"""Named settings, each a plain value that says which paper it follows and what it changes.

A preset is a start: single settings are changed with --set path.to.key=value.
"""

from dataclasses import dataclass, replace
from typing import Generic, TypeVar

from plnerf.errors import ConfigError
from plnerf.field.density import DensityConfig
from plnerf.field.radiance import RadianceConfig
from plnerf.field.tubes import TubeConfig
from plnerf.field.vanilla import VanillaConfig
from plnerf.ops.grid import GridShape
from plnerf.render.coarse_fine import CoarseFineConfig
from plnerf.render.deep_proposals import DeepProposalsConfig
from plnerf.render.model import ModelConfig
from plnerf.render.occupied import OccupiedConfig
from plnerf.render.proposals import SamplerConfig
from plnerf.render.systems import SystemConfig
from plnerf.train.config import TrainConfig
from plnerf.train.losses import LossWeights

S = TypeVar("S", bound=SystemConfig, covariant=True)


@dataclass(frozen=True)
class Preset(Generic[S]):
    """Settings of a system before they are fitted to a scene."""

    model: S
    train: TrainConfig
    cells_per_pixel: float = 1.0
    """Cells of the finest level per pixel's width at a distance of one scene unit; decides
    field.grid.finest.
    """


def _proposal(finest: int) -> DensityConfig:
    return DensityConfig(GridShape(levels=5, coarsest=16, finest=finest, features=2, log2_table=15))


_HASHED = ModelConfig(
    field=RadianceConfig(GridShape(levels=8, coarsest=16, finest=512, features=4, log2_table=17)),
    proposals=(_proposal(64), _proposal(128)),
    sampler=SamplerConfig(proposals=(64, 32), final=24),
)

PL_NERF = Preset(
    # Sensors 2023, 23(23), 9537, section 4.2.2, sized for a CPU: eight levels of four features in a table
    # that stays in cache, instead of Instant-NGP's sixteen of two in 2^19 entries; 24 final samples
    # instead of nerfacto's 48.
    model=_HASHED,
    train=TrainConfig(),
)

NERFACTO = Preset(
    # nerfacto (Tancik et al. 2023) at the sizes of pl-nerf, so that a comparison at equal time compares
    # methods and not table sizes: spherical harmonics in place of the frustum's IPE, no normals, pixels
    # drawn uniformly.
    model=replace(_HASHED, field=replace(_HASHED.field, direction_encoding="sh", normals=False)),
    train=TrainConfig(detail_share=0.0, normal_rays=0),
)

PL_NERF_WIRE = Preset(
    # pl-nerf, and all that was measured to keep wires whole (docs/wires.md): conductors are found as curves
    # in the images first; along them pixels are drawn, samples are laid and a field of their own is read.
    # More samples and cells across the line than along it, since a span is ten times longer than it is wide.
    model=replace(
        _HASHED,
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

_DEEP = TrainConfig(
    # NeRF 2020's learning rate and its tenth at the end, pixels drawn uniformly, and the colour as only loss.
    detail_share=0.0,
    normal_rays=0,
    anneal_steps=1,
    network_rate=5e-4,
    final_rate=0.1,
    loss=LossWeights(interlevel=0.0, distortion=0.0),
)

NERF = Preset(
    # NeRF (Mildenhall et al. 2020; seed 4.2.1): networks as published; 32 + 32 samples in place of 64 + 128
    # and 512 rays in place of 4096, for a CPU.  Samples reach to infinity as those of the other presets do,
    # in place of normalised device coordinates, which only face forward.
    model=CoarseFineConfig(sampler=SamplerConfig(proposals=(32,), final=32, padding=1e-5)),
    train=_DEEP,
)

MIP_NERF = Preset(
    # Mip-NeRF (Barron et al. 2021): IPE of cones in place of points, one network for both looks; sizes as
    # those of `nerf`.
    model=CoarseFineConfig(
        field=VanillaConfig(encoding="ipe", octaves=16),
        sampler=SamplerConfig(proposals=(32,), final=32, padding=0.01),
        networks=1,
    ),
    train=replace(_DEEP, loss=replace(_DEEP.loss, coarse=0.1)),
)

MIP_NERF_360 = Preset(
    # Mip-NeRF 360 (Barron et al. 2022): contraction into a ball, one proposal network, distortion loss; the
    # large network is NeRF's 8 x 256 in place of 8 x 1024, for a CPU, and encodes along the axes only.
    model=DeepProposalsConfig(),
    train=replace(_DEEP, anneal_steps=300, loss=LossWeights(distortion=0.01)),
)

INSTANT_NGP = Preset(
    # Instant-NGP (Mueller et al. 2022): hash encoding, spherical harmonics, an occupancy grid in place of
    # proposals; the hash table at the size of pl-nerf's, the L-infinity contraction in place of its cascade
    # of cubes, 128 even samples a ray in place of up to 1024.
    model=OccupiedConfig(field=replace(_HASHED.field, direction_encoding="sh", normals=False, appearance=0)),
    train=TrainConfig(detail_share=0.0, normal_rays=0, loss=LossWeights(interlevel=0.0, distortion=0.0)),
)

PRESETS: dict[str, Preset[SystemConfig]] = {
    "nerf": NERF,
    "mip-nerf": MIP_NERF,
    "instant-ngp": INSTANT_NGP,
    "mip-nerf-360": MIP_NERF_360,
    "nerfacto": NERFACTO,
    "pl-nerf": PL_NERF,
    "pl-nerf-wire": PL_NERF_WIRE,
}


def find_preset(name: str) -> Preset[SystemConfig]:
    """The preset of a name.  Raises ConfigError naming the ones there are."""
    if name not in PRESETS:
        raise ConfigError(f"There is no preset {name!r}. Presets: {', '.join(PRESETS)}.")
    return PRESETS[name]
