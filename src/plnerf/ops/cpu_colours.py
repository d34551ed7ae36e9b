"""Colours and normals of the intervals along rays, the networks evaluated once for a share of a ray's weight.

The reference is `render/field_samples.py`.  Letters: r rays, S intervals, E = S + 1 edges t, w their weights;
B points of a block, see `cpu_blocks.py`; K octaves, H units; n intervals in tubes.  A ray's intervals form
groups, of which the heaviest interval is evaluated.  These, of one ray after the other, fill the blocks that
go through the networks; a point's numbers do not depend on the block it is in.

What Numba compiles is marked no_type_check: a wrapper that checks annotations cannot be compiled.
"""

import math
from typing import NamedTuple, no_type_check

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from plnerf.ops.cpu_arrays import FAST, array
from plnerf.ops.cpu_blocks import Grid, Network, add_layer, encode, finish_network, run_network
from plnerf.ops.cpu_cells import BLOCK
from plnerf.ops.cpu_math import exp_and_expm1_neg, sin_cos
from plnerf.ops.cpu_rays import gaussian
from plnerf.ops.kernel_cache import INNER, njit
from plnerf.ops.launch import arrays
from plnerf.ops.threads import share

_FLAGS = {"fastmath": FAST, "error_model": "numpy", "cache": True}
_INNER = _FLAGS | INNER


class Field(NamedTuple):
    """A radiance field to the kernel."""

    grid: Grid
    density: Network
    """Its outputs are the log density and the feature vector."""
    colour: Network
    """On the feature vector and the IPE; what the intervals of a ray share is in `base` already."""
    normal: Network
    """On the feature vector."""


class Replaced(NamedTuple):
    """Feature vectors that another field gives to some intervals, in place of the radiance field's."""

    row: Int[Tensor, "r S"]
    """Of each interval its row in `feature`; below 0 where the radiance field's own stays."""
    feature: Float[Tensor, "n G"]


class Colours(NamedTuple):
    """Colours and normals of intervals."""

    colours: Float[Tensor, "r S 3"]
    normals: Float[Tensor, "q S 3"]
    """Of no rays, q = 0, where none were asked for."""
    computed: int
    """Intervals for which the networks were evaluated."""


@njit(**_INNER)
@no_type_check
def _group(w, weight_budget, at, end):
    """The groups of a ray's intervals: their heaviest and one past their last; returns their number.

    As `field_samples.heaviest`.
    """
    S, real = w.size, w.dtype.type
    total, before, half, zero = real(0), real(0), real(0.5), real(0)
    for i in range(S):
        total += w[i]
    missed = max(real(1) - total, zero)
    last, group, heaviest = -1, np.int64(-1), zero
    for i in range(S):
        own = w[i] + missed if i == S - 1 else w[i]
        here = np.int64((before + half * own) / weight_budget) if weight_budget > zero else i
        before += own
        if here != group:
            last, group, heaviest = last + 1, here, own
            at[last] = i
        elif own > heaviest:
            at[last], heaviest = i, own
        end[last] = i + 1
    return last + 1


@njit(**_INNER)
@no_type_check
def _encode_frustums(mean, variance, octaves, to, first):
    """IPE (6 K, B) of means and variances (3, B), from place `first` of `to` on, as `cpu_rays` has it."""
    real = mean.dtype.type
    zero, half, one, two = real(0), real(0.5), real(1), real(2)
    size = 3 * BLOCK
    for k in range(0, octaves, 2):
        scale = real(2.0**k)
        fineness = half * scale * scale
        double = min(k + 1, octaves - 1)  # of an odd number of octaves the last is written twice
        sines, cosines = to[first + k * size :], to[first + (octaves + k) * size :]
        sines2, cosines2 = to[first + double * size :], to[first + (octaves + double) * size :]
        for j in range(size):
            sine, cosine = sin_cos(mean[j] * scale)
            fade, _ = exp_and_expm1_neg(max(variance[j], zero) * fineness)
            fade2 = fade * fade
            sines2[j] = two * sine * cosine * (fade2 * fade2)
            cosines2[j] = (one - two * sine * sine) * (fade2 * fade2)
            sines[j], cosines[j] = sine * fade, cosine * fade


@njit(**_INNER)
@no_type_check
def _spread_base(base, ray_of, count, units, y):
    """y (H, B): the row of `base` of each point's ray; the points of a ray are neighbours."""
    start = 0
    for p in range(1, count + 1):
        if p == count or ray_of[p] != ray_of[start]:
            stop = p if p < count else BLOCK
            for o in range(units):
                y[o * BLOCK + start : o * BLOCK + stop] = base[ray_of[start], o]
            start = p


@njit(**_INNER)
@no_type_check
def _write(values, ray_of, first, end, count, to):
    """Of each point p the values (3, B) to all intervals of its group."""
    for p in range(count):
        for i in range(first[p], end[p]):
            for c in range(3):
                to[ray_of[p], i, c] = values[c * BLOCK + p]


@njit(**_INNER)
@no_type_check
def _replace(replacing, row, count, x):
    """Into the feature vectors of x (1 + G, B), after the log density, those of other fields."""
    for p in range(count):
        if row[p] >= 0:
            for k in range(replacing.shape[1]):
                x[(k + 1) * BLOCK + p] = replacing[row[p], k]


@njit(**_INNER)
@no_type_check
def _sigmoid(y):
    one = y.dtype.type(1)
    for i in range(3 * BLOCK):
        exp_neg, _ = exp_and_expm1_neg(abs(y[i]))
        y[i] = (one if y[i] > 0 else exp_neg) / (one + exp_neg)


@njit(**_INNER)
@no_type_check
def _normalise(y):
    # The bound on the length is torch's.
    real = y.dtype.type
    for p in range(BLOCK):
        a, b, c = y[p], y[BLOCK + p], y[2 * BLOCK + p]
        length = max(real(math.sqrt(a * a + b * b + c * c)), real(1e-12))
        y[p], y[BLOCK + p], y[2 * BLOCK + p] = a / length, b / length, c / length


@njit(cache=True, fastmath=FAST, error_model="numpy")
@no_type_check
def _colours(  # noqa: PLR0913 (a kernel's arrays, one by one)
    origins, directions, radius, t, w, weight_budget, stretch, contraction, octaves, grid, density, colour,
    normal, base, replaced, replacing, colours, normals, computed, start, stop,
):  # fmt: skip
    S, real = w.shape[1], t.dtype.type
    A0, A1, A2 = real(stretch[0]), real(stretch[1]), real(stretch[2])
    tiny, two, quarter = real(np.finfo(t.dtype).tiny), real(2), real(0.25)
    outputs, inputs, units = density.sizes[-1], colour.sizes[0], colour.sizes[1]
    widest = max(density.sizes.max(), colour.sizes.max(), normal.sizes.max()) * BLOCK
    at, ends = np.empty(S, np.int64), np.empty(S, np.int64)
    places = np.empty((4, BLOCK), np.int64)
    ray_of, first, end, row = places[0], places[1], places[2], places[3]
    mean, variance = np.zeros((3, BLOCK), t.dtype), np.zeros((3, BLOCK), t.dtype)
    unit = np.empty(3 * BLOCK, t.dtype)
    rows, shares = np.empty(8 * BLOCK, np.uint32), np.empty(8 * BLOCK, t.dtype)
    encoded = np.zeros(density.sizes[0] * BLOCK, t.dtype)
    x = np.empty((1 + inputs) * BLOCK, t.dtype)  # log density, feature vector, IPE
    hidden, other = np.empty(widest, t.dtype), np.empty(widest, t.dtype)
    filled = 0
    for ray in range(start, stop):
        o0, o1, o2 = origins[ray, 0] * A0, origins[ray, 1] * A1, origins[ray, 2] * A2
        d0, d1, d2 = directions[ray, 0] * A0, directions[ray, 1] * A1, directions[ray, 2] * A2
        groups = _group(w[ray], real(weight_budget), at, ends)
        computed[ray] = groups
        for g in range(groups):
            i, p = at[g], filled
            ray_of[p], first[p], end[p] = ray, ends[g - 1] if g > 0 else 0, ends[g]
            row[p] = replaced[ray, i] if replaced.size else -1
            m0, m1, m2, v0, v1, v2 = gaussian(
                o0, o1, o2, d0, d1, d2, radius[ray], t[ray, i], t[ray, i + 1], A0, A1, A2,
                contraction, tiny, real,
            )  # fmt: skip
            mean[0, p], mean[1, p], mean[2, p] = m0, m1, m2
            variance[0, p], variance[1, p], variance[2, p] = v0, v1, v2
            for axis in range(3):
                unit[3 * p + axis] = (mean[axis, p] + two) * quarter
            filled += 1
            if filled < BLOCK and (ray < stop - 1 or g < groups - 1):
                continue
            encode(unit, 0, filled, grid, rows, shares, encoded)
            y = run_network(density, encoded, 0, hidden, other)
            x[: outputs * BLOCK] = y[: outputs * BLOCK]
            if replaced.size:
                _replace(replacing, row, filled, x)
            _encode_frustums(mean.reshape(-1), variance.reshape(-1), octaves, x, outputs * BLOCK)
            _spread_base(base, ray_of, filled, units, hidden)
            add_layer(colour.weights, 0, units, x, BLOCK, inputs, hidden)
            y = finish_network(colour, 1, hidden, other)
            _sigmoid(y)
            _write(y, ray_of, first, end, filled, colours)
            if normals.size:
                y = run_network(normal, x, BLOCK, hidden, other)
                _normalise(y)
                _write(y, ray_of, first, end, filled, normals)
            filled = 0


def colours_along_rays(  # noqa: PLR0913 (rays, what they saw, and the field)
    origins: Float[Tensor, "r 3"],
    directions: Float[Tensor, "r 3"],
    radius: Float[Tensor, " r"],
    t: Float[Tensor, "r E"],
    w: Float[Tensor, "r S"],
    weight_budget: float,
    stretch: tuple[float, float, float],
    contraction: bool,
    octaves: int,
    field: Field,
    base: Float[Tensor, "r H"],
    normals: bool,
    replaced: Replaced | None = None,
) -> Colours:
    """Colours and, if asked for, unit normals of the intervals; weight_budget: see `render.pruning.Pruning`.

    base: what goes into the colour network's first layer from all that the intervals of a ray share, its bias
    among it.
    """
    if replaced is None:
        replaced = Replaced(torch.empty(0, 0, dtype=torch.int64), t.new_empty(0, 0))
    colours = t.new_empty(*w.shape, 3)
    found = t.new_empty(len(w) if normals else 0, w.shape[1], 3)
    o, d, r, edges, weights, shared, replacing, out, out_normals = arrays(
        origins, directions, radius, t, w, base, replaced.feature, colours, found
    )
    computed = np.zeros(len(w), np.int64)
    share(
        _colours, o, d, r, edges, weights, weight_budget, stretch, contraction, octaves, *field, shared,
        array(replaced.row), replacing, out, out_normals, computed, of=len(w),
    )  # fmt: skip
    return Colours(colours, found, int(computed.sum()))
