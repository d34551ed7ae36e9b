"""The systems there are: which configuration makes which."""

from torch import Generator

from plnerf.field.guides import Guides
from plnerf.ops.dispatch import Backend
from plnerf.render.coarse_fine import CoarseFineConfig, CoarseFineNeRF
from plnerf.render.deep_proposals import DeepProposalsConfig, DeepProposalsNeRF
from plnerf.render.model import ModelConfig, PLNeRF
from plnerf.render.occupied import OccupiedConfig, OccupiedNeRF
from plnerf.render.system import RadianceSystem

SystemConfig = ModelConfig | CoarseFineConfig | DeepProposalsConfig | OccupiedConfig
"""Told apart in a run's config.json by their `kind`."""


def build_system(
    config: SystemConfig, images: int, backend: Backend, generator: Generator, guides: Guides | None = None
) -> RadianceSystem:
    """The untrained system; curves guide the samples of those that can be guided."""
    if isinstance(config, ModelConfig):
        return PLNeRF(config, images, backend, generator, guides)
    if isinstance(config, OccupiedConfig):
        return OccupiedNeRF(config, images, backend, generator)
    if isinstance(config, CoarseFineConfig):
        return CoarseFineNeRF(config, images, backend, generator)
    return DeepProposalsNeRF(config, images, backend, generator)
