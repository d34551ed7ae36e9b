"""Numba kernel of `reference.adam_rows`: one pass over a table and its moments.

A step of training touches a third of the rows, and memory is what it waits for: of the others only the
gradient is read, and the gradient is emptied on the way.  Letters as in `reference.adam_rows`.
"""

from functools import cache
from typing import Any, no_type_check

import torch
from jaxtyping import Float
from numpy import uint64
from torch import Tensor

from plnerf.ops import cpu_arrays
from plnerf.ops.cpu_arrays import FAST, flat
from plnerf.ops.cpu_vectors import (
    add_scaled,
    choose,
    load_row,
    product,
    quotient,
    scaled,
    spread,
    square_root,
    store_row,
    touched,
)
from plnerf.ops.kernel_cache import njit, prange

_LANES = 16  # numbers taken at once: a line of the cache and a register, where these are 64 bytes


@njit(inline="always")
@no_type_check
def _step(param, grad, m, v, numbers, first, features, lanes):
    """The rows of `features` numbers that make up the `lanes` numbers from `first` on."""
    rate, beta1, rest1, beta2, rest2, root_correction, eps = numbers
    at = uint64(first)
    g = load_row(grad, at, lanes)
    rows = touched(g, features)
    if rows:
        old_m, old_v, old = load_row(m, at, lanes), load_row(v, at, lanes), load_row(param, at, lanes)
        new_m = add_scaled(scaled(beta1, old_m), rest1, g)
        new_v = add_scaled(scaled(beta2, old_v), rest2, product(g, g))
        length = add_scaled(spread(eps, lanes), root_correction, square_root(new_v))
        store_row(m, at, choose(rows, new_m, old_m))
        store_row(v, at, choose(rows, new_v, old_v))
        store_row(param, at, choose(rows, add_scaled(old, -rate, quotient(new_m, length)), old))
        store_row(grad, at, spread(param.dtype.type(0), lanes))


@cache
@no_type_check
def _kernel(features: int) -> Any:
    """The kernel for a fixed number of features: the length of its vectors."""
    lanes = features * max(1, _LANES // features)

    @njit(parallel=True, cache=True, fastmath=FAST)
    def step_rows(param, grad, m, v, numbers, parts):
        vectors = param.size // lanes
        for part in prange(parts):
            for vector in range(vectors * part // parts, vectors * (part + 1) // parts):
                _step(param, grad, m, v, numbers, vector * lanes, features, lanes)
        for first in range(vectors * lanes, param.size, features):
            _step(param, grad, m, v, numbers, first, features, features)

    return step_rows


@torch.no_grad()
def adam_rows(
    param: Float[Tensor, "rows F"],
    grad: Float[Tensor, "rows F"],
    m: Float[Tensor, "rows F"],
    v: Float[Tensor, "rows F"],
    *,
    rate: float | Float[Tensor, ""],
    betas: tuple[float, float],
    eps: float,
    step: int | Float[Tensor, ""],
) -> None:
    """Kernel of `reference.adam_rows`, for contiguous tensors of one type.  Raises ValueError for others."""
    tensors = (param, grad, m, v)
    if len({value.dtype for value in tensors}) > 1 or not all(value.is_contiguous() for value in tensors):
        raise ValueError("adam_rows works in place: it needs contiguous tensors of one type.")
    real = flat(param).dtype.type
    steps = float(step)
    numbers = (
        float(rate) / (1 - betas[0] ** steps), betas[0], 1 - betas[0], betas[1], 1 - betas[1],
        (1 - betas[1] ** steps) ** -0.5, eps,
    )  # fmt: skip
    _kernel(param.shape[1])(
        flat(param), flat(grad), flat(m), flat(v), tuple(map(real, numbers)), cpu_arrays.num_threads()
    )
