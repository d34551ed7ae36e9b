"""Memory that a system takes at least, estimated from its settings before anything is allocated.

From below: parameters, and what every interval of a ray holds whatever computes it.  It is there to refuse
what cannot work, not to predict what is used.
"""

from plnerf.field.config import DensityConfig, RadianceConfig, TubeConfig, VanillaConfig
from plnerf.render.config import (
    CoarseFineConfig,
    DeepProposalsConfig,
    ModelConfig,
    OccupancyGridConfig,
    SystemConfig,
)

FLOAT = 4
"""Bytes of a number in float32."""
PER_INTERVAL = 4
"""Numbers that every interval of a ray has: its edge, density, weight and their gradient, at least."""
COPIES_IN_TRAINING = 4
"""Of every parameter: itself, its gradient and two moments."""


def parameter_bytes(config: SystemConfig, images: int, *, guided: bool = False) -> float:
    """Of all parameters of a system that is trained on so many images, at least.

    guided: it knows curves, around which it may have tubes.
    """
    per_image = 6 + config.field.appearance
    return FLOAT * (images * per_image + _parameters(config, guided))


def ray_bytes(config: SystemConfig, rays: int) -> float:
    """Of rendering so many rays at once, at least."""
    return FLOAT * PER_INTERVAL * float(rays) * (sum(config.sampler.proposals) + config.sampler.final)


def _parameters(config: SystemConfig, guided: bool) -> float:
    if isinstance(config, ModelConfig):
        tubes = _of_field(config.tubes) if guided and config.tubes is not None else 0.0
        return _of_field(config.field) + sum(map(_of_field, config.proposals)) + tubes
    if isinstance(config, OccupancyGridConfig):
        return _of_field(config.field) + float(config.occupancy.cells) ** 3
    if isinstance(config, CoarseFineConfig):
        return config.networks * _of_field(config.field)
    assert isinstance(config, DeepProposalsConfig)
    return _of_field(config.field) + _of_field(config.proposal)


def _of_field(field: RadianceConfig | DensityConfig | TubeConfig | VanillaConfig) -> float:
    if isinstance(field, VanillaConfig):
        return float(field.width) ** 2 * (field.depth - 1)
    table = float(field.grid.rows) * field.grid.features
    first = float(field.hidden) * field.grid.width
    if isinstance(field, RadianceConfig):
        inside = float(field.hidden) ** 2 * (field.colour_layers - 1)
        return table + first + inside + float(field.hidden) * field.feature
    return table + first
