"""The shape of a multi-resolution hash grid, shared by reference and kernels.  Instant-NGP, section 3.

Letters: L levels, N_l cells along each axis of level l, F features of a vertex, T entries of a hashed level.
A level is a dense array while its (N_l + 1)^3 vertices fit into T entries, and hashed beyond.
All levels lie one after another in one table of shape (rows, F).
"""

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate
from typing import Literal

from plnerf.errors import ConfigError

Interpolation = Literal["linear", "cubic"]

# Teschner et al. 2003, as in Instant-NGP eq. 4; the first is 1 so that neighbours along x stay neighbours.
HASH_PRIMES = (1, 2654435761, 805459861)


MAX_LEVELS = 64
"""Far more than there are doublings between one cell and `MAX_CELLS`."""
MAX_CELLS = 1 << 24
"""Cells along an axis beyond which positions in float32 do not tell them apart."""


@dataclass(frozen=True)
class GridShape:
    """Levels growing geometrically from `coarsest` to `finest` cells an axis.

    The factor from level to level is b = exp((ln N_max - ln N_min)/(L - 1)).
    """

    levels: int
    """L."""
    coarsest: int
    """N_min: cells along an axis of the first level."""
    finest: int
    """N_max: cells along an axis of the last level."""
    features: int
    """F: numbers of a vertex."""
    log2_table: int
    """Logarithm of T, the entries of a hashed level, to base 2."""
    interpolation: Interpolation = "linear"
    """Between vertices: linear, or cubic Hermite weights, whose first derivative is continuous."""

    def __post_init__(self) -> None:
        if (
            not 1 <= self.levels <= MAX_LEVELS
            or self.features < 1
            or not 1 <= self.coarsest <= self.finest <= MAX_CELLS
            or not 1 <= self.log2_table <= 30
        ):
            raise ConfigError(
                f"A hash grid needs 1 <= levels <= {MAX_LEVELS}, features >= 1, 1 <= coarsest <= finest <= "
                f"{MAX_CELLS} and 1 <= log2_table <= 30, but got levels={self.levels}, "
                f"features={self.features}, coarsest={self.coarsest}, finest={self.finest}, "
                f"log2_table={self.log2_table}. "
                "Change these settings of the grid."
            )
        if self.interpolation not in {"linear", "cubic"}:
            raise ConfigError(f"interpolation must be 'linear' or 'cubic', but got {self.interpolation!r}.")

    @cached_property
    def resolutions(self) -> tuple[int, ...]:
        """N_l of every level, cells along an axis."""
        if self.levels == 1:
            return (self.coarsest,)
        growth = math.log(self.finest / self.coarsest) / (self.levels - 1)
        return tuple(round(self.coarsest * math.exp(growth * level)) for level in range(self.levels))

    @cached_property
    def sizes(self) -> tuple[int, ...]:
        """Table rows of every level."""
        return tuple(min((n + 1) ** 3, 1 << self.log2_table) for n in self.resolutions)

    @cached_property
    def dense(self) -> tuple[bool, ...]:
        """Whether a level is a plain array, each vertex with a row of its own."""
        return tuple((n + 1) ** 3 <= 1 << self.log2_table for n in self.resolutions)

    @cached_property
    def starts(self) -> tuple[int, ...]:
        """First row of every level."""
        return tuple(accumulate(self.sizes[:-1], initial=0))

    @property
    def rows(self) -> int:
        """Rows of the whole table."""
        return sum(self.sizes)

    @property
    def width(self) -> int:
        """Length of an encoded vector, L F."""
        return self.levels * self.features
