"""How the Triton kernels of rays are called: a program for each ray, or for each block of samples."""

from typing import Any

import torch
import triton
from torch import Tensor

BLOCK = 128
"""Samples of a program, where they need not know of their ray's others."""
_WIDE = 128  # samples of a ray from which on its program is given four warps


def contiguous(*tensors: Tensor) -> tuple[Tensor, ...]:
    """Tensors of one type, float32 or float64, without gradient; TypeError for others."""
    found = {tensor.dtype for tensor in tensors}
    if len(found) != 1 or not found <= {torch.float32, torch.float64}:
        raise TypeError(f"The GPU's kernels need tensors of one type, float32 or float64, but got {found}.")
    return tuple(tensor.detach().contiguous() for tensor in tensors)


def on_each_ray(kernel: Any, *arguments: Any, rays: int, samples: int, **constants: Any) -> None:
    """Runs a kernel with a program for each ray; its BLOCK is the power of two that holds its samples."""
    block = triton.next_power_of_2(samples)
    _run(kernel, rays, arguments, {**constants, "BLOCK": block, "num_warps": 1 if block < _WIDE else 4})


def on_samples(kernel: Any, *arguments: Any, samples: int, **constants: Any) -> None:
    """Runs a kernel with a program for each BLOCK of samples."""
    _run(kernel, triton.cdiv(samples, BLOCK), arguments, {**constants, "BLOCK": BLOCK})


def _run(kernel: Any, programs: int, arguments: tuple[Any, ...], constants: dict[str, Any]) -> None:
    if programs:
        kernel[(programs,)](*arguments, **constants)
