"""Densities of all intervals along rays, colours of one interval in each group.

Neighbouring intervals form groups of about the same weight, which share the colour of their heaviest one.

Letters: r rays, S intervals, E = S + 1 edges t, w the weights, L the weight budget of a group.  With
b_i = sum_{j<i} w_j, and the remaining transmittance added to the last interval as in the rendering sum,
    interval i belongs to group floor((b_i + w_i/2) / L)
so that a ray has at most 1/L + 1 groups, and fewer where intervals are heavier than L.
"""

from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from plnerf.field.networks import density_and_feature
from plnerf.field.tubes import InTubes
from plnerf.rays.rays import Rays
from plnerf.render.model import PLNeRF
from plnerf.render.ray_ops import ray_ops


class FieldSamples(NamedTuple):
    """Samples of the radiance field along rays."""

    density: Float[Tensor, "r S"]
    colours: Float[Tensor, "r S 3"]
    """Of each interval its group's."""
    normals: Float[Tensor, "r S 3"] | None
    """None where they were not asked for."""
    computed: int
    """Intervals for which the networks of colour and normals were evaluated."""


def heaviest(w: Float[Tensor, "r S"], weight_budget: float) -> Int[Tensor, "r S"]:
    """For each interval the heaviest one of its group, the first of several; itself for a budget of 0."""
    places = torch.arange(w.shape[1], device=w.device).expand(w.shape)
    if weight_budget == 0:
        return places
    missed = (1 - w.sum(-1, keepdim=True)).clamp_min(0)
    own = torch.cat([w[:, :-1], w[:, -1:] + missed], -1)
    before = nn.functional.pad(own[:, :-1].cumsum(-1), (1, 0))
    share = ((before + own / 2) / weight_budget).floor()
    group = nn.functional.pad(share.diff() != 0, (1, 0)).cumsum(-1)
    most = torch.zeros_like(w).scatter_reduce(1, group, own, "amax").gather(1, group)
    candidates = torch.where(own == most, places, w.shape[1])
    first = torch.full_like(places, w.shape[1]).scatter_reduce(1, group, candidates, "amin")
    return first.gather(1, group)


def densities(model: PLNeRF, field: nn.Module, rays: Rays, t: Float[Tensor, "r E"]) -> Float[Tensor, "r E-1"]:
    """Densities by a proposal field of the model."""
    config, ops = model.config, ray_ops(model.backend)
    density: Tensor = field(ops.frustum_features(rays, t, config.stretch, config.contraction, 0)[0])
    return density


def sample_field(
    model: PLNeRF,
    rays: Rays,
    t: Float[Tensor, "r E"],
    appearance: Float[Tensor, "r A"],
    in_tubes: InTubes | None,
    *,
    weight_budget: float,
    normals: bool,
) -> FieldSamples:
    """Densities by the radiance field and its tubes, colours and normals of groups of so much weight."""
    config, field, ops = model.config, model.field, ray_ops(model.backend)
    unit, _ = ops.frustum_features(rays, t, config.stretch, config.contraction, 0)
    raw = field.raw(unit, model.frustum_sizes(rays, t, unit))
    if model.tubes is not None and in_tubes is not None:
        raw = model.tubes.replace(raw, in_tubes)
    density, feature = density_and_feature(raw)
    chosen = heaviest(ops.weights_from_density(density, t), weight_budget)
    itself = chosen == torch.arange(chosen.shape[1], device=chosen.device)
    ray, place = itself.nonzero(as_tuple=True)
    # Every interval that is evaluated, as a ray of its own.
    alone = Rays(rays.origins[ray], rays.directions[ray], rays.radius[ray], rays.camera[ray])
    edges = torch.stack([t[ray, place], t[ray, place + 1]], -1)
    _, ipe = ops.frustum_features(alone, edges, config.stretch, config.contraction, field.octaves)
    feature = feature[ray, place][:, None]
    # Where in this list the interval is that each one takes its colour from.
    listed = (itself.flatten().cumsum(0) - 1).view(itself.shape).gather(1, chosen)
    colours = field.colour(feature, ipe, alone.directions, appearance[ray])[:, 0][listed]
    found = field.predicted_normals(feature)[:, 0][listed] if normals else None
    return FieldSamples(density, colours, found, len(ray))
