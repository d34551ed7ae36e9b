"""Triton kernel of `reference.adam_rows`: one pass over a table and its moments.

Of a row without a gradient only the gradient is read; the others' is emptied on the way.
"""

import math
from typing import no_type_check

import torch
import triton
import triton.language as tl
from jaxtyping import Float
from torch import Tensor

BLOCK = 1024  # numbers of a program


@triton.jit
@no_type_check
def step_rows(  # noqa: PLR0913 (a kernel's arrays, one by one)
    param, grad, m, v, rate, step, rows,
    F: tl.constexpr, F_UP: tl.constexpr, BETA1: tl.constexpr, BETA2: tl.constexpr,
    LOG_BETA1: tl.constexpr, LOG_BETA2: tl.constexpr, EPS: tl.constexpr, BLOCK: tl.constexpr,
):  # fmt: skip
    """The rows of one block; `rate` and `step` are read from the device, since a CUDA graph is replayed."""
    row = tl.program_id(0).to(tl.int64) * BLOCK + tl.arange(0, BLOCK)
    f = tl.arange(0, F_UP)
    at = row[:, None] * F + f[None, :]
    g = tl.load(grad + at, mask=(row < rows)[:, None] & (f < F)[None, :], other=0.0)
    touched = tl.sum((g != 0).to(tl.int32), axis=1) > 0
    some = touched[:, None] & (f < F)[None, :]
    # 1 - beta^step has few digits in float32.
    steps = tl.load(step).to(tl.float64)
    first = (tl.load(rate).to(tl.float64) / (1.0 - tl.exp(steps * LOG_BETA1))).to(g.dtype)
    second = tl.sqrt(1.0 - tl.exp(steps * LOG_BETA2)).to(g.dtype)
    new_m = BETA1 * tl.load(m + at, mask=some, other=0.0) + (1 - BETA1) * g
    new_v = BETA2 * tl.load(v + at, mask=some, other=0.0) + (1 - BETA2) * g * g
    moved = tl.load(param + at, mask=some, other=0.0) - first * new_m / (tl.sqrt(new_v) / second + EPS)
    tl.store(m + at, new_m, mask=some)
    tl.store(v + at, new_v, mask=some)
    tl.store(param + at, moved, mask=some)
    tl.store(grad + at, tl.zeros_like(g), mask=some)


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
    """Kernel of `reference.adam_rows`, for contiguous tensors of one type.  Raises ValueError for others.

    Where `rate` and `step` are on the device already, nothing waits for it or copies to it.
    """
    tensors = (param, grad, m, v)
    if len({value.dtype for value in tensors}) > 1 or not all(value.is_contiguous() for value in tensors):
        raise ValueError("adam_rows works in place: it needs contiguous tensors of one type.")
    rows, features = param.shape
    together = triton.next_power_of_2(features)
    block = max(1, BLOCK // together)
    numbers = [
        value if isinstance(value, Tensor) else param.new_full((), value, dtype=torch.float64)
        for value in (rate, step)
    ]
    step_rows[(triton.cdiv(rows, block),)](
        *(value.detach() for value in tensors), *numbers, rows,
        F=features, F_UP=together, BETA1=betas[0], BETA2=betas[1],
        LOG_BETA1=math.log(betas[0]), LOG_BETA2=math.log(betas[1]), EPS=eps, BLOCK=block,
    )  # fmt: skip
