"""One op at one shape: what the suite `ops` measures, with the least work that it must do.

Work is counted from the equations and the case's own points, not measured: what is in order counts once per
array; what is at random counts the lines of 64 bytes that a point needs of a level (neighbouring vertices
often share one), reuse between points left out; a line that is added to is read and written, and counts
twice; exp, sin and the like count as one operation.
"""

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Generator, Tensor

Op = Callable[..., Tensor | tuple[Tensor, ...]]


@dataclass(frozen=True)
class Work:
    """The least that one pass must do."""

    bytes_moved: int
    """Read or written in order."""
    lines: int = 0
    """Fetched from, or written to, random places of the table."""
    flops: int = 0


@dataclass(frozen=True)
class OpCase:
    """One op at one shape."""

    name: str
    shape: str
    """The sizes, in words."""
    setup: Callable[[Generator], tuple[Tensor, ...]]
    """Inputs from a generator on the CPU; those that require a gradient have a zero one already."""
    reference: Op
    kernel: Op
    forward: Work
    backward: Work | None = None
    """None where the op has no backward pass."""
    table_bytes: int = 0
    """Size of what is looked up at random at a time, a grid's largest level; 0 without any."""
    prepare: Callable[..., None] | None = None
    """What is done to the inputs before each time, unmeasured: where an op uses them up."""
    tolerance: float = 1e-4
    """Largest difference of kernel and reference that is rounding, as a share of the largest value."""


def leaf(value: Tensor) -> Tensor:
    """The same values as a parameter, with a zero gradient as an optimiser leaves it."""
    parameter = value.detach().clone().requires_grad_()
    parameter.grad = torch.zeros_like(parameter)
    return parameter
