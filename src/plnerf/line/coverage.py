"""How much of the ground and the air around a span was seen, stretch by stretch along it: values.

Letters: k stretches; stations as in `stations.py`; metres.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float


@dataclass(frozen=True, eq=False)
class Coverage:
    """Of one span, from its first end to its last."""

    line: int
    span: int
    """Ids."""
    from_m: Float[np.ndarray, " k"]
    """Stations along the line."""
    to_m: Float[np.ndarray, " k"]
    ground: Float[np.ndarray, " k"]
    """Share of the area below and beside the wires with points on the ground or on what stands on it."""
    air: Float[np.ndarray, " k"]
    """Share of the space from there up to the wires that enough images see; NaN where no images do."""
    images: Float[np.ndarray, " k"]
    """Median number of images that see a place of that space; NaN likewise."""
    least: float
    """A stretch of which a smaller share was seen counts as not seen."""

    @property
    def no_ground(self) -> Bool[np.ndarray, " k"]:
        """Where what is below the wires was not seen."""
        unseen: Bool[np.ndarray, " k"] = self.ground < self.least
        return unseen

    @property
    def no_air(self) -> Bool[np.ndarray, " k"]:
        """Where the space around the wires was not seen."""
        unseen: Bool[np.ndarray, " k"] = self.air < self.least  # False of NaN
        return unseen

    @property
    def silent(self) -> tuple[tuple[float, float], ...]:
        """Stations from and to which either was not seen, neighbours joined."""
        found: list[tuple[float, float]] = []
        for k in np.flatnonzero(self.no_ground | self.no_air):
            begin, end = float(self.from_m[k]), float(self.to_m[k])
            if found and abs(found[-1][1] - begin) < 1e-9:
                found[-1] = (found[-1][0], end)
            else:
                found.append((begin, end))
        return tuple(found)

    @property
    def silent_m(self) -> float:
        """The length of these together."""
        return sum((end - begin for begin, end in self.silent), 0.0)

    @property
    def length_m(self) -> float:
        """Length that was examined, from the first station to the last."""
        return float(self.to_m[-1] - self.from_m[0])
