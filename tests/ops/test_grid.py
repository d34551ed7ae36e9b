"""The layout of a grid's table: levels grow evenly, dense levels are bijections, nothing overlaps."""

import copy
import dataclasses
import math

import numpy as np
import pytest
import torch

from plnerf.errors import ConfigError
from plnerf.ops.grid import GridShape
from plnerf.ops.reference import vertex_row

SHAPES = [
    GridShape(8, 4, 512, 2, 12),
    GridShape(5, 3, 3, 1, 6),
    GridShape(1, 7, 7, 4, 10),
    GridShape(16, 16, 2048, 2, 19),
]


@pytest.mark.parametrize("grid", SHAPES, ids=str)
def test_levels_grow_evenly_from_coarsest_to_finest(grid: GridShape) -> None:
    n = grid.resolutions
    assert (n[0], n[-1], len(n)) == (grid.coarsest, grid.finest, grid.levels)
    growth = math.exp(math.log(grid.finest / grid.coarsest) / max(grid.levels - 1, 1))
    for level, cells in enumerate(n):
        assert abs(cells - grid.coarsest * growth**level) <= 0.5 + 1e-9


@pytest.mark.parametrize("grid", SHAPES, ids=str)
def test_levels_fill_the_table_without_overlap(grid: GridShape) -> None:
    entries = 2**grid.log2_table
    end = 0
    for n, start, size, dense in zip(grid.resolutions, grid.starts, grid.sizes, grid.dense, strict=True):
        assert start == end
        assert dense == ((n + 1) ** 3 <= entries)
        assert size == ((n + 1) ** 3 if dense else entries)
        end = start + size
    assert end == grid.rows
    assert grid.width == grid.levels * grid.features


def test_every_vertex_of_a_dense_level_has_a_row_of_its_own() -> None:
    grid = GridShape(8, 4, 512, 2, 12)
    for level in [level for level in range(grid.levels) if grid.dense[level]]:
        vertex = torch.cartesian_prod(*[torch.arange(grid.resolutions[level] + 1)] * 3)
        rows = vertex_row(vertex, level, grid).sort().values
        start, size = grid.starts[level], grid.sizes[level]
        assert torch.equal(rows, torch.arange(start, start + size))


def test_hashed_rows_stay_in_their_level_and_spread_over_it() -> None:
    grid = GridShape(8, 4, 512, 2, 12)
    generator = torch.Generator().manual_seed(0)
    for level in [level for level in range(grid.levels) if not grid.dense[level]]:
        n, start, size = grid.resolutions[level], grid.starts[level], grid.sizes[level]
        vertex = torch.randint(n + 1, (64 * size, 3), generator=generator)
        counts = np.bincount((vertex_row(vertex, level, grid) - start).numpy(), minlength=size)
        assert len(counts) == size  # none beyond the level
        if n >= 64:  # a coarser level has too few vertices to reach every row
            # 64 a row on average: if the spread is even, 6 standard deviations are 48.
            assert 64 - 48 < counts.min() <= counts.max() < 64 + 48


def test_neighbours_along_x_are_neighbours_in_the_table() -> None:
    """The first hash factor is 1, for the sake of the cache."""
    grid = GridShape(1, 512, 512, 2, 12)
    vertex = torch.tensor([[4, 77, 130], [5, 77, 130]])
    a, b = vertex_row(vertex, 0, grid).tolist()
    assert abs(a - b) == 1


@pytest.mark.parametrize(
    "change",
    [
        {"levels": 0},
        {"levels": 65},
        {"features": 0},
        {"finest": 1 << 25},
        {"coarsest": 0},
        {"coarsest": 600},
        {"log2_table": 0},
        {"log2_table": 31},
    ],
    ids=str,
)
def test_a_grid_that_cannot_be_is_refused(change: dict[str, int]) -> None:
    with pytest.raises(ConfigError, match="A hash grid needs 1 <= levels <= 64") as caught:
        dataclasses.replace(SHAPES[0], **change)
    (name, value), *_ = change.items()
    assert f"{name}={value}" in str(caught.value)


def test_an_unknown_interpolation_is_refused() -> None:
    grid = copy.copy(SHAPES[0])
    object.__setattr__(
        grid, "interpolation", "quintic"
    )  # the tests' own type checks would stop the constructor
    with pytest.raises(ConfigError, match="interpolation must be 'linear' or 'cubic', but got 'quintic'"):
        grid.__post_init__()
