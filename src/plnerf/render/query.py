"""The field of a system at points, rather than along rays of cameras.

A point is a short interval on a ray of its own, so that every system encodes it as it encodes
samples.  Letters: n points; scene frame.
"""

from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from plnerf.errors import ConfigError
from plnerf.field.guides import Windows
from plnerf.field.networks import density_and_feature
from plnerf.rays.rays import Rays
from plnerf.render.mlp_nerf import MLPNeRF
from plnerf.render.model import PLNeRF
from plnerf.render.normals import UNSTRETCHED
from plnerf.render.occupancy_grid import OccupancyGridNeRF
from plnerf.render.ray_ops import ray_ops
from plnerf.render.system import RadianceSystem

BACK, LENGTH = 1.0, 1e-5
"""A point's ray begins so far before it, and its interval is so long; scene units."""


class FieldValues(NamedTuple):
    """A field at n points."""

    density: Float[Tensor, " n"]
    """In 1/length of the scene frame."""
    feature: Float[Tensor, "n G"]
    """What the density network hands on to the colour network."""
    colour: Float[Tensor, "n 3"]
    """In [0, 1], as seen along the points' directions."""


def query(
    system: RadianceSystem,
    points: Float[Tensor, "n 3"],
    directions: Float[Tensor, "n 3"],
    appearance: Float[Tensor, " A"],
) -> FieldValues:
    """The field at points seen along unit directions; in the tubes around wires, the tubes' own."""
    nothing = torch.zeros(len(points), device=points.device)
    rays = Rays(points - BACK * directions, directions, nothing, nothing.long())
    t = torch.tensor([BACK, BACK + LENGTH], device=points.device).expand(len(points), 2)
    vectors = appearance.expand(len(points), -1)
    if isinstance(system, PLNeRF):
        density, feature, colour = _pl_nerf(system, rays, t, vectors)
    elif isinstance(system, OccupancyGridNeRF):
        ops = ray_ops(system.backend)
        unit, ipe = ops.frustum_features(rays, t, UNSTRETCHED, True, system.field.octaves)
        density, feature = system.field.density(unit)
        colour = system.field.colour(feature, ipe, directions, vectors)
    elif isinstance(system, MLPNeRF):
        density, feature = system.field.density(system.field.encode(rays, t))
        colour = system.field.colour(feature, directions, vectors)
    else:
        raise ConfigError(f"The field of a {type(system).__name__} cannot be queried at points.")
    return FieldValues(density[:, 0], feature[:, 0], colour[:, 0])


def _pl_nerf(
    model: PLNeRF, rays: Rays, t: Float[Tensor, "n 2"], appearance: Float[Tensor, "n A"]
) -> tuple[Float[Tensor, "n 1"], Float[Tensor, "n 1 G"], Float[Tensor, "n 1 3"]]:
    config, field, ops = model.config, model.field, ray_ops(model.backend)
    unit, ipe = ops.frustum_features(rays, t, config.stretch, config.contraction, field.octaves)
    raw = field.raw(unit, model.frustum_sizes(rays, t, unit))
    if model.tubes is not None and model.guides is not None:
        every = torch.arange(len(model.guides), device=t.device).expand(len(rays), -1)
        hit = torch.ones(len(rays), dtype=torch.bool, device=t.device)
        at = model.tubes.locate(rays, t, Windows(every.float(), every.float(), every, hit))
        raw = model.tubes.replace(raw, at)
    density, feature = density_and_feature(raw)
    return density, feature, field.colour(feature, ipe, rays.directions, appearance)
