"""The PL-NeRF field (paper 4.2.2, fig. 18): position by hash encoding, direction by IPE, two networks.

    density network:  hash(x), damped by the frustum's size      -> density, feature
    colour network:   feature, direction encoding, appearance    -> colour
    normal network:   feature                                    -> unit normal    (Ref-NeRF, section 4)

A bare direction has no frustum to integrate over, so the `direction_encoding`
    ipe   is the IPE of the contracted frustum beside the positional encoding of the view direction (paper)
    sh    is the spherical harmonics of the view direction (nerfacto)
    both  is the IPE of the frustum beside the spherical harmonics
"""

import torch
from jaxtyping import Float
from torch import Generator, Tensor, nn

from plnerf.errors import ConfigError
from plnerf.field.config import RadianceConfig
from plnerf.field.encodings import positional_encoding, spherical_harmonics
from plnerf.field.hashgrid import HashGrid
from plnerf.field.networks import density_and_feature, mlp, run_on_rays
from plnerf.ops.backends import Backend

FIRST_COLOURS = 0.1
"""Factor of the last layer of a new colour network: all is nearly grey.  With 1, 600 steps of the fox end 0.1
dB lower, in the mean of four seeds (docs/performance.md)."""


class RadianceField(nn.Module):
    """Positions, frustums and directions to density, colour and normals."""

    def __init__(self, config: RadianceConfig, backend: Backend, generator: Generator) -> None:
        super().__init__()
        self.config = config
        self.grid = HashGrid(config.grid, backend, generator)
        self.density_network = mlp([config.grid.width, config.hidden, 1 + config.feature], generator)
        direction = 6 * config.direction_octaves if config.direction_encoding == "ipe" else 16
        inputs = config.feature + 6 * self.octaves + direction + config.appearance
        layers = [inputs, *[config.hidden] * config.colour_layers, 3]
        self.colour_network = mlp(layers, generator, last=FIRST_COLOURS)
        self.normal_network = mlp([config.feature, 32, 3], generator) if config.normals else None

    def density(
        self, unit: Float[Tensor, "r S 3"], size: Float[Tensor, "r S"] | None = None
    ) -> tuple[Float[Tensor, "r S"], Float[Tensor, "r S G"]]:
        """Density in 1/length of the scene frame, and the feature vector.

        size: of the sampled balls, see `HashGrid.damping`; None for points.
        """
        return density_and_feature(self.raw(unit, size))

    def raw(
        self, unit: Float[Tensor, "r S 3"], size: Float[Tensor, "r S"] | None = None
    ) -> Float[Tensor, "r S O"]:
        """The logarithm of the density, not yet bounded, and the feature vector; O = 1 + G."""
        return self._run(self.density_network, self.grid(unit, size), unit[..., :0], unit[:, 0, :0])

    def log_density_gradient(
        self, unit: Float[Tensor, "*n 3"], size: Float[Tensor, "*n"] | None = None
    ) -> Float[Tensor, "*n 3"]:
        """Gradient of the log density by position in the unit cube: through the network, then the hash grid.

        Where gradients are recorded, differentiable by all weights, so that the losses on normals can shape
        the density.  (The network is piecewise linear: its gradient by the encoding does not depend on the
        encoding.)
        """
        graph = torch.is_grad_enabled()
        with torch.no_grad():
            encoded = self.grid(unit)
        with torch.enable_grad():
            encoded.requires_grad_()
            damped = encoded if size is None else self.grid.damped(encoded, size)
            raw = self.density_network(damped)[..., 0]
            (g_encoded,) = torch.autograd.grad(raw.sum(), encoded, create_graph=graph)
        return self.grid.position_gradient(unit, g_encoded)

    def colour(
        self,
        feature: Float[Tensor, "r S G"],
        ipe: Float[Tensor, "r S e"],
        directions: Float[Tensor, "r 3"],
        appearance: Float[Tensor, "r A"],
    ) -> Float[Tensor, "r S 3"]:
        """Colour in [0, 1] of frustums, of which `ipe` (of `octaves` octaves), seen along unit directions."""
        shared = self.shared(directions, appearance)
        return torch.sigmoid(self._run(self.colour_network, feature, ipe, shared))

    def shared(
        self, directions: Float[Tensor, "r 3"], appearance: Float[Tensor, "r A"]
    ) -> Float[Tensor, "r K"]:
        """What the colour network takes in that all samples of a ray share: encoded direction, appearance."""
        if self.config.direction_encoding == "ipe":
            view = positional_encoding(directions, self.config.direction_octaves)
        else:
            view = spherical_harmonics(directions)
        return torch.cat([view, appearance], -1)

    @property
    def octaves(self) -> int:
        """Octaves of the frustums' IPE that the colour network takes in."""
        return self.config.ipe_octaves if self.config.direction_encoding != "sh" else 0

    def predicted_normals(self, feature: Float[Tensor, "r S G"]) -> Float[Tensor, "r S 3"]:
        """Unit normals in the scene frame, as the network predicts them; ConfigError without normals."""
        if self.normal_network is None:
            raise ConfigError(
                "This field was built with normals=False: it predicts none. Train with field.normals=true."
            )
        out = self._run(self.normal_network, feature, feature[..., :0], feature[:, 0, :0])
        return nn.functional.normalize(out, dim=-1)

    def _run(self, network: nn.Sequential, x: Tensor, const: Tensor, shared: Tensor) -> Tensor:
        return run_on_rays(network, x, const, shared, self.grid.backend)
