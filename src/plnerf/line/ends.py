"""What holds a wire at its ends, what it was seen by, and a figure with its uncertainty."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

TWO_SIDED_95 = 1.959964
"""Standard deviations that 95 % of normal errors lie within."""


@dataclass(frozen=True)
class Quantity:
    """A figure and its standard deviation: metres (or units of an unscaled survey), an angle in degrees."""

    value: float
    sigma: float

    @property
    def half_95(self) -> float:
        """Half the width of its 95 % interval."""
        return TWO_SIDED_95 * self.sigma


@dataclass(frozen=True, eq=False)
class Attached:
    """An end that a structure holds."""

    structure: int
    """Id of the structure."""
    point: Float[np.ndarray, "3"]
    """The attachment, LineFrame."""
    sigma_m: float
    """Standard deviation of its place along the wire."""
    string_m: float | None = None
    """Length of the tension string that leads from there to the structure; 0: none; None: not known."""


@dataclass(frozen=True)
class Open:
    """An end of what is known of a wire, not of the wire."""

    reason: str
    """Such as "not filmed", "hidden", "the cloud ends"; reads on after "the first end is open"."""


End = Attached | Open


@dataclass(frozen=True)
class Evidence:
    """What a wire rests on."""

    source: str
    """In words: "1,204 points", "83 images"."""
    count: int
    """Points, or images that show it."""
    coverage: float = 1.0
    """Share of its length with evidence."""
    longest_gap_m: float = 0.0
    """Longest stretch without."""
    residual_across_m: float = 0.0
    """Root mean square of the points' horizontal distances from it."""
    residual_up_m: float = 0.0
    certain: bool = True
    """Whether what was seen fixes its place."""
    reach_m: float | None = None
    """Within what distance of the curve the wire lies: its own uncertainty, and pixels; None: of points."""
    seen_m: tuple[tuple[float, float], ...] | None = None
    """Stretches of s where it was seen; None: all of it."""

    def moved(self, by_m: float, length_m: float) -> "Evidence":
        """The same counted from another base, on which what was seen lies further on by so much."""
        if self.seen_m is None:
            return self
        cut = [(max(low + by_m, 0.0), min(high + by_m, length_m)) for low, high in self.seen_m]
        return replace(self, seen_m=tuple((low, high) for low, high in cut if high > low))
