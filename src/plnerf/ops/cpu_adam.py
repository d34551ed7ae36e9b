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
from plnerf.ops.kernel_cache import inlined, njit
from plnerf.ops.threads import share

_LANES = 16  # numbers taken at once: a line of the cache and a register, where these are 64 bytes


@inlined(fastmath=FAST)
@no_type_check
def _step(param, grad, m, v, numbers, begin, end, features, lanes):  # noqa: PLR0913 (a kernel's arrays, one by one)
    """The numbers begin .. end - 1, rows of `features` numbers, `lanes` numbers at once.

    The loop is in here: an array that is handed over in a loop is counted as a reference, time and again.
    """
    rate, beta1, rest1, beta2, rest2, root_correction, eps = numbers
    for first in range(begin, end, lanes):
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


def _lanes(features: int) -> int:
    """Numbers of a vector: of as many whole rows as fit."""
    return features * max(1, _LANES // features)


@cache
@no_type_check
def _kernel(features: int) -> Any:
    """The kernel for a fixed number of features: the length of its vectors."""
    lanes = _lanes(features)

    @njit(cache=True, fastmath=FAST)
    def step_rows(param, grad, m, v, numbers, start, stop):
        whole = param.size // lanes * lanes
        _step(param, grad, m, v, numbers, start * lanes, min(stop * lanes, whole), features, lanes)
        if stop * lanes > whole:  # the last rows, fewer than make a vector
            _step(param, grad, m, v, numbers, whole, param.size, features, features)

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
    lanes = _lanes(param.shape[1])
    share(
        _kernel(param.shape[1]), flat(param), flat(grad), flat(m), flat(v), tuple(map(real, numbers)),
        of=-(-param.numel() // lanes),
    )  # fmt: skip
