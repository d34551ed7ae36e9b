"""Whether kernels compute on this device what the reference computes: run before they are chosen.

A kernel may be sound where it was tested and not here: another GPU, another version of Triton or of the
driver, no C compiler for what Triton compiles for the host.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from plnerf.ops import reference
from plnerf.ops.grid import GridShape

if TYPE_CHECKING:
    from plnerf.ops.dispatch import Kernels

POINTS = 1000
TOLERANCE = 1e-4
"""Largest difference, relative to the reference's largest value; that of sound kernels is some 1e-6."""
_GRID = GridShape(levels=4, coarsest=8, finest=128, features=2, log2_table=12)  # dense and hashed levels
_Outputs = dict[str, Tensor]


def fault_of(kernels: "Kernels", on: torch.device, points: int = POINTS) -> str | None:
    """What is wrong with a backend's kernels on a device, in words; None where they are sound.

    Compares values and gradients on some points, half of them in a row as a ray's samples are.
    """
    ours = (kernels.hash_encode, kernels.hash_position_gradient, kernels.adam_rows)
    theirs = (reference.hash_encode, reference.hash_position_gradient, reference.adam_rows)
    try:
        found, truth = _outputs(*ours, on, points), _outputs(*theirs, on, points)
    except Exception as error:  # whatever the compiler, the driver or Triton raise: the run goes on without
        first = (str(error).strip() or "no message").splitlines()[0]
        return f"they do not run: {type(error).__name__}: {first}"
    for name, value in truth.items():
        off = float((found[name] - value).abs().max() / value.abs().max())
        if not off <= TOLERANCE:  # NaN is wrong, too
            return f"their {name} is off by {off:.2g} of the largest value"
    return None


def _outputs(
    hash_encode: Callable[..., Tensor],
    position_gradient: Callable[..., Tensor],
    adam_rows: Callable[..., None],
    on: torch.device,
    points: int,
) -> _Outputs:
    generator = torch.Generator().manual_seed(0)
    spread, ends = torch.rand(points // 2, 3, generator=generator), torch.rand(2, 3, generator=generator)
    row = torch.lerp(ends[0], ends[1], torch.linspace(0, 1, points - len(spread))[:, None])
    x = torch.cat([spread, row]).to(on)
    table = torch.randn(_GRID.rows, _GRID.features, generator=generator).to(on).requires_grad_()
    cotangent = torch.randn(points, _GRID.width, generator=generator).to(on).requires_grad_()
    encoded = hash_encode(x, table, _GRID)
    (g_table,) = torch.autograd.grad(encoded, table, cotangent.detach())
    g_x = position_gradient(x, cotangent, table, _GRID)
    second, g_cotangent = torch.autograd.grad(g_x, (table, cotangent), x)
    stepped, m, v = table.detach().clone(), torch.zeros_like(g_table), torch.zeros_like(g_table)
    adam_rows(stepped, g_table.clone(), m, v, rate=0.1, betas=(0.9, 0.99), eps=1e-15, step=1)
    return {
        "hash encoding": encoded.detach(),
        "gradient of the table": g_table,
        "gradient by position": g_x.detach(),
        "second gradient of the table": second,
        "second gradient of the encoding": g_cotangent,
        "first moment of Adam": m,
        "second moment of Adam": v,
    }
