"""The systems there are: which configuration makes which."""

from torch import Generator

from plnerf.field.guides import Guides
from plnerf.ops.backends import Backend
from plnerf.render.coarse_fine import CoarseFineNeRF
from plnerf.render.config import (
    CoarseFineConfig,
    ModelConfig,
    OccupancyGridConfig,
    SystemConfig,
)
from plnerf.render.deep_proposals import DeepProposalsNeRF
from plnerf.render.model import PLNeRF
from plnerf.render.occupancy_grid import OccupancyGridNeRF
from plnerf.render.system import RadianceSystem


def build_system(
    config: SystemConfig, images: int, backend: Backend, generator: Generator, guides: Guides | None = None
) -> RadianceSystem:
    """The untrained system; curves guide the samples of those that can be guided."""
    if isinstance(config, ModelConfig):
        return PLNeRF(config, images, backend, generator, guides)
    if isinstance(config, OccupancyGridConfig):
        return OccupancyGridNeRF(config, images, backend, generator)
    if isinstance(config, CoarseFineConfig):
        return CoarseFineNeRF(config, images, backend, generator)
    return DeepProposalsNeRF(config, images, backend, generator)
