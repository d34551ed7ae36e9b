"""`field_samples.py` by fused kernels for a CPU, on the parts of a model.  Letters as there."""

import torch
from jaxtyping import Float
from torch import Tensor, nn

from plnerf.field.density import DensityField
from plnerf.field.hashgrid import HashGrid
from plnerf.field.tubes import InTubes
from plnerf.ops import cpu_volume
from plnerf.ops.cpu_blocks import grid_of, network_of
from plnerf.ops.cpu_colours import Field, Replaced, colours_along_rays
from plnerf.ops.cpu_sight import densities_along_rays
from plnerf.rays.rays import Rays
from plnerf.render.field_samples import FieldSamples
from plnerf.render.model import PLNeRF


def densities(model: PLNeRF, field: nn.Module, rays: Rays, t: Float[Tensor, "r E"]) -> Float[Tensor, "r E-1"]:
    """Densities by a proposal field of the model."""
    assert isinstance(field, DensityField)
    return _densities(model, field.grid, _layers(field.network), rays, t)


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
    config, field = model.config, model.field
    *hidden, (weight, bias) = _layers(field.density_network)
    density = _densities(model, field.grid, [*hidden, (weight[:1], bias[:1])], rays, t)
    replaced = None
    if model.tubes is not None and in_tubes is not None:
        own_density, own_feature = model.tubes(in_tubes)
        density.view(-1).index_copy_(0, in_tubes.index, own_density)
        row = torch.full(density.shape, -1)
        row.view(-1)[in_tubes.index] = torch.arange(len(in_tubes.index))
        replaced = Replaced(row, own_feature)
    w = cpu_volume.weights_from_density(density, t)
    (weight, bias), *rest = _layers(field.colour_network)
    own = config.field.feature + 6 * field.octaves
    base = nn.functional.linear(field.shared(rays.directions, appearance), weight[:, own:], bias)
    parts = Field(
        grid_of(field.grid.table, field.grid.shape),
        network_of(_layers(field.density_network)),
        network_of([(weight[:, :own], bias), *rest]),
        network_of(_layers(field.normal_network or field.density_network)),  # unused without normals
    )
    found = colours_along_rays(
        rays.origins, rays.directions, rays.radius, t, w, weight_budget, config.stretch, config.contraction,
        field.octaves, parts, base, normals, replaced,
    )  # fmt: skip
    return FieldSamples(density, found.colours, found.normals if normals else None, found.computed)


def _densities(
    model: PLNeRF, grid: HashGrid, layers: list[tuple[Tensor, Tensor]], rays: Rays, t: Tensor
) -> Tensor:
    return densities_along_rays(
        rays.origins, rays.directions, rays.radius, t, model.config.stretch, model.config.contraction,
        grid_of(grid.table, grid.shape), network_of(layers),
    )  # fmt: skip


def _layers(network: nn.Sequential) -> list[tuple[Tensor, Tensor]]:
    return [(layer.weight, layer.bias) for layer in network if isinstance(layer, nn.Linear)]
