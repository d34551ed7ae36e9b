"""The field of NeRF 2020 (paper 4.2.1, fig. 17), Mip-NeRF and Mip-NeRF 360: a deep network and no table.

    encoding(x) -> `depth` layers, the encoding joined again in between -> density, feature
    feature, encoding(d), appearance -> one layer -> colour
    feature -> one layer -> unit normal    (Ref-NeRF, section 4)

The encoding is that of a point (NeRF 2020), of a frustum (Mip-NeRF) or of a frustum contracted into a ball
(Mip-NeRF 360, whose further directions of encoding, beside the axes, are left out).
"""

from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Generator, Tensor, nn

from plnerf.errors import ConfigError
from plnerf.field.config import VanillaConfig
from plnerf.field.encodings import integrated_positional_encoding, positional_encoding
from plnerf.field.networks import mlp
from plnerf.rays.ball import contract_ball, contract_frustums_ball
from plnerf.rays.frustums import ray_frustums
from plnerf.rays.rays import Rays


class DeepDensity(nn.Module):
    """Intervals of rays to density, through plain torch: the first part of the field, or a proposal."""

    def __init__(self, config: VanillaConfig, generator: Generator) -> None:
        super().__init__()
        self.config = config
        encoded, width = 6 * config.octaves, config.width
        before = config.skip or config.depth
        self.first = mlp([encoded, *[width] * before], generator)
        self.second = (
            mlp([width + encoded, *[width] * (config.depth - before)], generator) if config.skip else None
        )
        self.density_layer = mlp([width, 1], generator)

    def encode(
        self, rays: Rays, t: Float[Tensor, "r E"], moved: Float[Tensor, "r E-1 3"] | None = None
    ) -> Float[Tensor, "r E-1 e"]:
        """The encoded position of each interval, the network's input; e = 6 octaves.  Scene units, no pi.

        moved: offsets of the intervals, for gradients by position.
        """
        if self.config.encoding == "ipe":
            frustums = ray_frustums(rays, t)
            if moved is not None:
                frustums = replace(frustums, mean=frustums.mean + moved)
            if self.config.contraction:
                mean, variance = contract_frustums_ball(frustums)
            else:
                mean, variance = frustums.mean, frustums.covariance().diagonal(dim1=-2, dim2=-1)
            return integrated_positional_encoding(mean, variance, self.config.octaves)
        points = rays.origins[:, None] + t[:, :-1, None] * rays.directions[:, None]
        points = points if moved is None else points + moved
        points = contract_ball(points) if self.config.contraction else points
        return positional_encoding(points, self.config.octaves)

    def density(self, encoded: Float[Tensor, "r S e"]) -> tuple[Float[Tensor, "r S"], Float[Tensor, "r S G"]]:
        """Density in 1/length of the scene frame, and the last layer it comes from.

        log(1 + exp(x - 1)) as in Mip-NeRF: where NeRF 2020's ReLU is zero it has no gradient, and now and
        then a whole field stays empty.
        """
        hidden = self.first(encoded).relu()
        if self.second is not None:
            hidden = self.second(torch.cat([hidden, encoded], -1)).relu()
        return nn.functional.softplus(self.density_layer(hidden)[..., 0] - 1), hidden


class VanillaField(DeepDensity):
    """Intervals of rays to density, colour and normals."""

    def __init__(self, config: VanillaConfig, generator: Generator) -> None:
        super().__init__(config, generator)
        width = config.width
        self.feature_layer = mlp([width, width], generator)
        inputs = width + 6 * config.direction_octaves + config.appearance
        self.colour_network = mlp([inputs, config.colour_width, 3], generator)
        self.normal_network = mlp([width, config.colour_width, 3], generator) if config.normals else None

    def density(self, encoded: Float[Tensor, "r S e"]) -> tuple[Float[Tensor, "r S"], Float[Tensor, "r S G"]]:
        """Density in 1/length of the scene frame, and the feature vector."""
        density, hidden = super().density(encoded)
        return density, self.feature_layer(hidden)

    def colour(
        self,
        feature: Float[Tensor, "r S G"],
        directions: Float[Tensor, "r 3"],
        appearance: Float[Tensor, "r A"],
    ) -> Float[Tensor, "r S 3"]:
        """Colour in [0, 1], seen along unit directions."""
        view = positional_encoding(directions, self.config.direction_octaves)
        shared = torch.cat([view, appearance], -1)[:, None].expand(-1, feature.shape[1], -1)
        return torch.sigmoid(self.colour_network(torch.cat([feature, shared], -1)))

    def predicted_normals(self, feature: Float[Tensor, "r S G"]) -> Float[Tensor, "r S 3"]:
        """Unit normals in the scene frame, as the network predicts them; ConfigError without normals."""
        if self.normal_network is None:
            raise ConfigError(
                "This field was built with normals=False: it predicts none. Train with field.normals=true."
            )
        return nn.functional.normalize(self.normal_network(feature), dim=-1)


def density_normals(field: VanillaField, rays: Rays, t: Float[Tensor, "q E"]) -> Float[Tensor, "q E-1 3"]:
    """Normals as the density says, n = -grad sigma / |grad sigma|.  Ref-NeRF eq. 3."""
    graph = torch.is_grad_enabled()
    with torch.enable_grad():
        # Every interval gets an origin of its own, by which its density is differentiated.
        moved = torch.zeros(len(t), t.shape[1] - 1, 3, device=t.device, requires_grad=True)
        density, _ = field.density(field.encode(rays, t, moved))
        # The logarithm has a gradient of the same direction, without the density's range.
        log_density = density.clamp_min(torch.finfo(density.dtype).tiny).log()
        (gradient,) = torch.autograd.grad(log_density.sum(), moved, create_graph=graph)
    return -gradient / (gradient.square().sum(-1, keepdim=True) + 1e-6).sqrt()
