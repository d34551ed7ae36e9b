"""Which images are matched with which: neighbours in time, neighbours in place, and some far ones.

Matching all pairs grows with the square of the images.  A progressive sequence needs its neighbours; where a
flight comes back, images that are near in place (GPS) or, without it, all pairs among a few of them close
the loop.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree

from plnerf.errors import ConfigError

Pair = tuple[int, int]


@dataclass(frozen=True)
class PairConfig:
    """How many pairs are matched."""

    exhaustive_to: int = 40
    """Up to so many images, all pairs."""
    neighbours: int = 8
    """Following images that each is matched with; beyond, those 16, 32, 64, ... further on."""
    near: int = 12
    """Nearest images in place, where positions are known."""
    landmarks: int = 30
    """Images, evenly chosen, of which all pairs are matched, where positions are not known."""

    def __post_init__(self) -> None:
        if min(self.exhaustive_to, self.near, self.landmarks) < 0 or self.neighbours < 1:
            raise ConfigError(
                "Pairs need neighbours of 1 or more, and exhaustive_to, near and landmarks of 0 or more, "
                f"but got {self}."
            )


def choose_pairs(
    count: int, config: PairConfig, positions: Float[np.ndarray, "{count} 3"] | None = None
) -> list[Pair]:
    """Pairs (i, j), i < j, each once and in order, of `count` images in the order they were taken.

    positions: in metres, NaN where unknown.
    """
    if count <= config.exhaustive_to:
        return [(i, j) for i in range(count) for j in range(i + 1, count)]
    chosen = set(_neighbours(count, config.neighbours))
    known = np.zeros(count, bool) if positions is None else np.isfinite(positions).all(1)
    if positions is not None and known.sum() >= 2:
        chosen |= _near(positions, np.nonzero(known)[0], config.near)
    if known.mean() < 0.5:
        some = np.unique(np.linspace(0, count - 1, min(count, config.landmarks)).round().astype(int))
        chosen |= {(int(a), int(b)) for k, a in enumerate(some) for b in some[k + 1 :]}
    return sorted(chosen)


def _neighbours(count: int, neighbours: int) -> Sequence[Pair]:
    steps = [*range(1, neighbours + 1)]
    step = 16
    while step < count:
        steps.append(step)
        step *= 2
    return [(i, i + step) for step in steps for i in range(count - step)]


def _near(positions: Float[np.ndarray, "n 3"], known: np.ndarray, near: int) -> set[Pair]:
    _, found = KDTree(positions[known]).query(positions[known], k=min(near + 1, len(known)))
    return {
        (min(int(known[i]), int(known[j])), max(int(known[i]), int(known[j])))
        for i, row in enumerate(np.atleast_2d(found))
        for j in row
        if i != j
    }
