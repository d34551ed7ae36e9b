"""What the suite `ops` measures: each op beside its plain-torch truth, with the least work it must do.

An op is added as one more `OpCase` in `op_cases`.  Work is counted from the equations and the case's own
points, not measured: what is in order counts once per array; what is at random counts the lines of 64 bytes
that a point needs of a level (neighbouring vertices often share one), reuse between points left out; a line
that is added to is read and written, and counts twice.

Letters: n points, L levels, F features, r rays, S intervals.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import torch
from jaxtyping import Float
from torch import Generator, Tensor

from plnerf.bench.ceilings import LINE_BYTES
from plnerf.ops import dispatch, reference
from plnerf.ops.dispatch import Backend
from plnerf.ops.grid import GridShape
from plnerf.rays.contraction import contract
from plnerf.rays.stepfun import even_edges
from plnerf.render.proposals import SamplerConfig, to_distance

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
    truth: Op
    twin: Op
    forward: Work
    backward: Work | None = None
    """None where the op has no backward pass."""
    table_bytes: int = 0
    """Size of the table that is looked up at random, 0 without one."""
    tolerance: float = 1e-4
    """Largest difference of twin and truth taken for rounding, relative to the truth's largest value."""


def op_cases(backend: Backend, *, small: bool = False) -> list[OpCase]:
    """All cases of a backend.  small: shapes for tests."""
    shrink = 256 if small else 1
    instant_ngp = GridShape(16, 16, 2048, 2, 10 if small else 19)
    training = GridShape(8, 16, 512, 4, 10 if small else 17)
    rays, intervals = 512 // (32 if small else 1), 24
    return [
        _hash_encode("random", random_points(65536 // shrink), instant_ngp, backend),
        _hash_encode("along rays", points_along_rays(rays, intervals), training, backend),
        _hash_position_gradient(points_along_rays(max(1, rays // 16), intervals), training, backend),
    ]


def _hash_encode(what: str, points: Float[Tensor, "n 3"], grid: GridShape, backend: Backend) -> OpCase:
    n, lines = len(points), lines_of_points(points, grid)
    moved = 4 * n * (3 + grid.width)
    # A level: place in the cell 12, weights of its corners 16, and a multiply-add per corner and feature.
    flops = n * grid.levels * (28 + 16 * grid.features)
    return OpCase(
        name=f"hash encoding, {what}",
        shape=f"{n:,} points, {_words(grid)}",
        setup=lambda generator: (points, random_table(grid, generator)),
        truth=partial(reference.hash_encode, grid=grid),
        twin=partial(dispatch.hash_encode, grid=grid, backend=backend),
        forward=Work(moved, lines, flops),
        backward=Work(moved, 2 * lines, flops),
        table_bytes=4 * grid.rows * grid.features,
    )


def _hash_position_gradient(points: Float[Tensor, "n 3"], grid: GridShape, backend: Backend) -> OpCase:
    n, lines, corners = len(points), lines_of_points(points, grid), len(points) * grid.levels * 8

    def setup(generator: Generator) -> tuple[Tensor, ...]:
        cotangent = torch.randn(n, grid.width, generator=generator)
        return points, _leaf(cotangent), random_table(grid, generator)

    return OpCase(
        name="gradient by position",
        shape=f"{n:,} points along rays, {_words(grid)}",
        setup=setup,
        truth=partial(reference.hash_position_gradient, grid=grid),
        twin=partial(dispatch.hash_position_gradient, grid=grid, backend=backend),
        # A corner: its value 2F, three products of three and their sums.
        forward=Work(4 * n * (6 + grid.width), lines, corners * (2 * grid.features + 9)),
        # And backward: the same value, its share, and a multiply-add into both gradients.
        backward=Work(4 * n * (6 + 2 * grid.width), 3 * lines, corners * (4 * grid.features + 9)),
        table_bytes=4 * grid.rows * grid.features,
    )


def random_points(n: int) -> Float[Tensor, "{n} 3"]:
    """Points spread evenly over the unit cube: the worst a cache can meet."""
    return torch.rand(n, 3, generator=torch.Generator().manual_seed(1))


def points_along_rays(rays: int, intervals: int) -> Float[Tensor, "{rays}*{intervals} 3"]:
    """Middles of even intervals along random rays from near the origin, contracted, in the unit cube.

    As a training step's points lie, but for the resampling, which draws them closer together still.
    """
    generator = torch.Generator().manual_seed(2)
    origins = torch.rand(rays, 1, 3, generator=generator) * 0.6 - 0.3
    directions = torch.nn.functional.normalize(torch.randn(rays, 1, 3, generator=generator), dim=-1)
    t = to_distance(even_edges(rays, intervals, generator, origins), SamplerConfig())
    middle = (t[:, 1:] + t[:, :-1])[..., None] / 2
    return ((contract(origins + middle * directions) + 2) / 4).reshape(-1, 3)


def random_table(grid: GridShape, generator: Generator) -> Float[Tensor, "rows F"]:
    """A table of a grid, with a zero gradient as an optimiser leaves it."""
    return _leaf(torch.randn(grid.rows, grid.features, generator=generator))


def lines_of_points(points: Float[Tensor, "n 3"], grid: GridShape) -> int:
    """Lines of the table that the cell of each point needs on each level, summed."""
    total = 0
    corners = torch.tensor([[c & 1, c >> 1 & 1, c >> 2] for c in range(8)])
    for level, cells in enumerate(grid.resolutions):
        cell = (points * cells).floor().clamp(0, cells - 1).long()
        row = reference.vertex_row(cell[:, None] + corners, level, grid)
        line = (row * (4 * grid.features) // LINE_BYTES).sort(-1).values
        total += len(points) + int((line.diff() != 0).sum())
    return total


def _leaf(value: Tensor) -> Tensor:
    value.requires_grad_()
    value.grad = torch.zeros_like(value)
    return value


def _words(grid: GridShape) -> str:
    return f"{grid.levels} levels x {grid.features}, T = 2^{math.log2(max(grid.sizes)):.0f}"
