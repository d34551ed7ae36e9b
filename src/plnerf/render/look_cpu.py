"""Twins of `look.py` for a CPU: its fused kernels on the parts of a model.  Letters as there."""

from jaxtyping import Float
from torch import Tensor, nn

from plnerf.field.density import DensityField
from plnerf.field.hashgrid import HashGrid
from plnerf.ops import cpu_volume
from plnerf.ops.cpu_blocks import grid_of, network_of
from plnerf.ops.cpu_colours import Field, colours_along_rays
from plnerf.ops.cpu_sight import densities_along_rays
from plnerf.rays.rays import Rays
from plnerf.render.look import Looked
from plnerf.render.model import PLNeRF


def densities(model: PLNeRF, field: nn.Module, rays: Rays, t: Float[Tensor, "r E"]) -> Float[Tensor, "r E-1"]:
    """Densities by a proposal field of the model."""
    assert isinstance(field, DensityField)
    return _densities(model, field.grid, _layers(field.network), rays, t)


def look(
    model: PLNeRF,
    rays: Rays,
    t: Float[Tensor, "r E"],
    appearance: Float[Tensor, "r A"],
    light: float,
    normals: bool,
) -> Looked:
    """Densities by the radiance field, colours and normals of groups of so much light."""
    config, field = model.config, model.field
    *hidden, (weight, bias) = _layers(field.density_network)
    density = _densities(model, field.grid, [*hidden, (weight[:1], bias[:1])], rays, t)
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
        rays.origins, rays.directions, rays.radius, t, w, light, config.stretch, config.contraction,
        field.octaves, parts, base, normals,
    )  # fmt: skip
    return Looked(density, found.colours, found.normals if normals else None, found.computed)


def _densities(
    model: PLNeRF, grid: HashGrid, layers: list[tuple[Tensor, Tensor]], rays: Rays, t: Tensor
) -> Tensor:
    return densities_along_rays(
        rays.origins, rays.directions, rays.radius, t, model.config.stretch, model.config.contraction,
        grid_of(grid.table, grid.shape), network_of(layers),
    )  # fmt: skip


def _layers(network: nn.Sequential) -> list[tuple[Tensor, Tensor]]:
    return [(layer.weight, layer.bias) for layer in network if isinstance(layer, nn.Linear)]
