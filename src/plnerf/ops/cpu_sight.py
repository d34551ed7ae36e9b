"""Densities along rays by a small field, in one pass without gradients.

Between the edges along the rays and their densities lie the intervals' positions, their hash encodings and
two layers of a network.  As ops of their own these cost more in arrays that are written and read again than
in arithmetic; here a few rays at a time go from edges to densities in a thread's own scratch.

Letters: r rays, S intervals, E = S + 1 edges t; B points of a block, see `cpu_blocks.py`.  No ray's numbers
depend on another's.  What Numba compiles is marked no_type_check: a wrapper that checks annotations cannot be
compiled.
"""

import math
from typing import no_type_check

import numpy as np
from jaxtyping import Float
from torch import Tensor

from plnerf.ops.cpu_arrays import FAST
from plnerf.ops.cpu_blocks import Grid, Network, encode, run_network
from plnerf.ops.cpu_cells import BLOCK
from plnerf.ops.cpu_math import exp_and_expm1_neg
from plnerf.ops.cpu_rays import fill_features
from plnerf.ops.kernel_cache import njit
from plnerf.ops.launch import arrays
from plnerf.ops.threads import share

_PACKET = 16
"""Rays at once: their intervals fill whole blocks where a ray has a multiple of 8."""
_BOUND = 15.0  # of the exponent, as in `field.networks.density_activation`
_DENSEST = math.exp(_BOUND)


@njit(cache=True, fastmath=FAST, error_model="numpy")
@no_type_check
def _densities(  # noqa: PLR0913 (a kernel's arrays, one by one)
    origins, directions, radius, t, stretch, contraction, grid, network, sigma, start, stop
):
    S, real = t.shape[1] - 1, t.dtype.type
    widest = network.sizes.max() * BLOCK
    bound, densest = real(_BOUND), real(_DENSEST)
    unit, none = np.empty((_PACKET, 3 * S), t.dtype), np.empty((_PACKET, S, 0), t.dtype)
    points = unit.reshape(-1)
    rows, shares = np.empty(8 * BLOCK, np.uint32), np.empty(8 * BLOCK, t.dtype)
    encoded = np.zeros(network.sizes[0] * BLOCK, t.dtype)
    hidden, other = np.empty(widest, t.dtype), np.empty(widest, t.dtype)
    for first in range(start, stop, _PACKET):
        count = min(_PACKET, stop - first)
        fill_features(
            origins[first:], directions[first:], radius[first:], t[first:], stretch, contraction, 0,
            unit, none, 0, count,
        )  # fmt: skip
        for begin in range(0, count * S, BLOCK):
            size = min(BLOCK, count * S - begin)
            encode(points, begin, size, grid, rows, shares, encoded)
            raw = run_network(network, encoded, 0, hidden, other)
            for p in range(size):
                exp_neg, _ = exp_and_expm1_neg(bound - min(raw[p], bound))
                sigma[first * S + begin + p] = densest * exp_neg


def densities_along_rays(
    origins: Float[Tensor, "r 3"],
    directions: Float[Tensor, "r 3"],
    radius: Float[Tensor, " r"],
    t: Float[Tensor, "r E"],
    stretch: tuple[float, float, float],
    contraction: bool,
    grid: Grid,
    network: Network,
) -> Float[Tensor, "r S"]:
    """Densities exp(network(hash encoding)) of the intervals between the edges t.

    The references are `render.ray_ops.frustum_features` without octaves, `reference.hash_mlp` and
    `field.networks.density_activation`.  The network may have any number of layers and one output.
    """
    sigma = t.new_empty(t.shape[0], t.shape[1] - 1)
    o, d, r, edges, out = arrays(origins, directions, radius, t, sigma.view(-1))
    share(_densities, o, d, r, edges, stretch, contraction, grid, network, out, of=len(t))
    return sigma
