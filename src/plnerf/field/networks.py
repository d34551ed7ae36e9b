"""The small networks of a field, initialised from an explicit generator."""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import torch
from jaxtyping import Float
from torch import Generator, Tensor, nn

from plnerf.ops.backends import Backend
from plnerf.ops.dispatch import ray_mlp


def mlp(widths: Sequence[int], generator: Generator, last: float = 1.0) -> nn.Sequential:
    """Fully connected layers of the given widths, ReLU between them, He-uniform weights and zero biases.

    last: factor of the last layer's weights; the less, the nearer to zero a new network's output is.
    """
    layers: list[nn.Module] = []
    for k, (inputs, outputs) in enumerate(pairwise(widths), 2):
        linear = nn.Linear(inputs, outputs, device="meta")  # draws nothing from torch's own generator
        bound = math.sqrt(6 / inputs) * (last if k == len(widths) else 1.0)
        weights = torch.rand(outputs, inputs, generator=generator) * 2 * bound - bound
        linear.weight, linear.bias = nn.Parameter(weights), nn.Parameter(torch.zeros(outputs))
        layers += [linear, nn.ReLU()]
    return nn.Sequential(*layers[:-1])


def run_on_rays(
    network: nn.Sequential,
    x: Float[Tensor, "r S I"],
    const: Float[Tensor, "r S J"],
    shared: Float[Tensor, "r K"],
    backend: Backend,
) -> Float[Tensor, "r S O"]:
    """A network of `mlp` on inputs of I + J + K numbers: x, const (no gradient), and what a ray shares.

    What all samples of a ray share goes through its columns of the first layer once a ray.
    """
    first, *rest = (layer for layer in network if isinstance(layer, nn.Linear))
    own = x.shape[-1] + const.shape[-1]
    base = nn.functional.linear(shared, first.weight[:, own:], first.bias)
    weights = [first.weight[:, :own]]
    for layer in rest:
        weights += [layer.weight, layer.bias]
    return ray_mlp(x, const, base, weights, backend)


class _DensityActivation(torch.autograd.Function):
    """exp(x), its exponent bounded by 15 where float32 or the gradient would overflow.  Instant-NGP's exp."""

    @staticmethod
    def forward(ctx: Any, x: Tensor) -> Tensor:
        ctx.save_for_backward(x)
        return x.clamp(max=15).exp()

    @staticmethod
    def backward(ctx: Any, *g_outputs: Tensor) -> Tensor:
        (x,) = ctx.saved_tensors
        # Not zero beyond the bound: a cell that became too dense must find its way back.
        g_x: Tensor = g_outputs[0] * x.clamp(max=15).exp()
        return g_x


def density_and_feature(raw: Float[Tensor, "*n O"]) -> tuple[Float[Tensor, "*n"], Float[Tensor, "*n G"]]:
    """Density in 1/length, and the feature vector, of what a density network puts out: O = 1 + G numbers."""
    log_density, feature = raw.split([1, raw.shape[-1] - 1], -1)
    return density_activation(log_density[..., 0]), feature


def density_activation(x: Float[Tensor, "*n"]) -> Float[Tensor, "*n"]:
    """Density in 1/length of a network's raw output, exp(x): about 1 per scene unit in a new field.

    An emptier start (nerfacto: 0.01) leaves the density without a gradient for many steps, since it is
    proportional to the density itself: on the fox scene at 1/8 size, 280 steps reached 10 dB with it and
    20 dB so.
    """
    density: Tensor = _DensityActivation.apply(x)
    return density
