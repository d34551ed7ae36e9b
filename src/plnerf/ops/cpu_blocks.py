"""Hash encoding and small networks on a block of points, for use inside of Numba kernels that render.

Letters: B = `BLOCK` points of a block; F features, H units.  Numbers of a block lie as structure of arrays,
(rows, B) flat, so that vectors run over points: a layer then is one product of matrices without any padding,
and a row of what one function writes is a row of what the next one reads.  A block is a few tens of kilobytes
and stays in the processor's caches from its points' positions to their colours.

Nothing here keeps what a gradient would need.  What Numba compiles is marked no_type_check: a wrapper that
checks annotations cannot be compiled.
"""

from collections.abc import Sequence
from typing import NamedTuple, no_type_check

import numpy as np
from jaxtyping import Float
from torch import Tensor

from plnerf.ops.cpu_arrays import FAST, array, flat
from plnerf.ops.cpu_cells import BLOCK, fill_corners
from plnerf.ops.cpu_products import add_products
from plnerf.ops.cpu_vectors import add_scaled, load_record, scaled
from plnerf.ops.grid import GridShape
from plnerf.ops.kernel_cache import INNER, njit
from plnerf.ops.layout import grid_layout

_FLAGS = INNER | {"fastmath": FAST, "error_model": "numpy", "cache": True}


class Grid(NamedTuple):
    """A hash grid to a kernel; see `grid_layout`."""

    table: np.ndarray
    """Its rows, each one record of F numbers: the array's type says how many."""
    layout: np.ndarray
    cubic: bool


class Network(NamedTuple):
    """A network of ReLU layers to a kernel: all weights (O, I), then all biases, one after the other."""

    weights: np.ndarray
    biases: np.ndarray
    sizes: np.ndarray
    """Of the inputs and of every layer's outputs."""


def grid_of(table: Float[Tensor, "rows F"], shape: GridShape) -> Grid:
    """A grid as the kernels take it; nothing is copied."""
    numbers = flat(table)
    row = np.dtype([(f"f{f}", numbers.dtype) for f in range(shape.features)])
    return Grid(numbers.view(row), grid_layout(shape), shape.interpolation == "cubic")


def network_of(layers: Sequence[tuple[Tensor, Tensor]]) -> Network:
    """A network of (weight, bias) as the kernels take it."""
    pairs = [(array(weight), array(bias)) for weight, bias in layers]
    sizes = [pairs[0][0].shape[1], *(len(bias) for _, bias in pairs)]
    weights = np.concatenate([weight.reshape(-1) for weight, _ in pairs])
    return Network(weights, np.concatenate([bias for _, bias in pairs]), np.array(sizes))


@njit(**_FLAGS)
@no_type_check
def encode(x, first, count, grid, rows, shares, to):
    """Writes the encodings (L F, B) of the points first .. first + count - 1 <= first + B of x, flat (n 3).

    rows and shares are scratch, uint32 and real, 8 B long.
    """
    for level in range(grid.layout.shape[0]):
        n, start, dense, mask = grid.layout[level]
        of_level = grid.table[start:]
        fill_corners(x, first, count, n, dense, mask, grid.cubic, rows, shares)
        for p in range(count):
            first_row = np.uint64(rows[np.uint64(p)])
            total = scaled(shares[np.uint64(p)], load_record(of_level, first_row))
            for c in range(1, 8):
                corner = np.uint64(c * BLOCK + p)
                row = np.uint64(rows[corner])
                total = add_scaled(total, shares[corner], load_record(of_level, row))
            for f in range(len(total)):
                to[np.uint64((level * len(total) + f) * BLOCK + p)] = total[f]


@njit(**_FLAGS)
@no_type_check
def spread_biases(biases, first, outputs, y):
    """y (O, B): the biases from place `first` on, the same at all points."""
    for o in range(outputs):
        y[o * BLOCK : (o + 1) * BLOCK] = biases[first + o]


@njit(**_FLAGS)
@no_type_check
def add_layer(weights, first, outputs, x, x_first, inputs, y):
    """y (O, B) += w (O, I) x (I, B): w begins at place `first` of the weights, x at `x_first`."""
    tiles = outputs // 8 * 8
    for o in range(0, tiles, 8):
        for p in range(0, BLOCK, 32):
            add_products(
                y, o * BLOCK + p, BLOCK, weights, first + o * inputs, inputs, 1, x, x_first + p, BLOCK,
                inputs, 8, 32,
            )  # fmt: skip
    for o in range(tiles, outputs):
        for p in range(0, BLOCK, 64):
            add_products(
                y, o * BLOCK + p, BLOCK, weights, first + o * inputs, inputs, 1, x, x_first + p, BLOCK,
                inputs, 1, 64,
            )  # fmt: skip


@njit(**_FLAGS)
@no_type_check
def rectify(y, size):
    """ReLU on the first `size` numbers."""
    zero = y.dtype.type(0)
    for i in range(size):
        y[i] = max(y[i], zero)


@njit(**_FLAGS)
@no_type_check
def finish_network(network, layer, y, other):
    """All layers from number `layer` >= 1 on, from what the one before it put out into y, not yet rectified.

    Returns the array, of y and `other`, that holds what comes out; both have room for the widest layer.
    """
    w, b = 0, 0
    for before in range(layer):
        w += network.sizes[before] * network.sizes[before + 1]
        b += network.sizes[before + 1]
    for at in range(layer, len(network.sizes) - 1):
        inputs, outputs = network.sizes[at], network.sizes[at + 1]
        rectify(y, inputs * BLOCK)
        spread_biases(network.biases, b, outputs, other)
        add_layer(network.weights, w, outputs, y, 0, inputs, other)
        w, b = w + inputs * outputs, b + outputs
        y, other = other, y
    return y


@njit(**_FLAGS)
@no_type_check
def run_network(network, x, x_first, y, other):
    """The network on x (I, B), which begins at place `x_first`; see `finish_network` for the rest."""
    spread_biases(network.biases, 0, network.sizes[1], y)
    add_layer(network.weights, 0, network.sizes[1], x, x_first, network.sizes[0], y)
    return finish_network(network, 1, y, other)
