"""A conductor as a curve in the scene frame, and where rays pass near it.

y is linear and z quadratic in x: a hanging parabola in an upright plane, within millimetres of the catenary
of the same sag.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from plnerf.errors import SceneError
from plnerf.scene.files import write_text

REACH_SIGMAS, REACH_PX = 4.0, 3.0
CERTAIN_PX = 3.0
"""Curves less certain than so many pixels wide are what views do not fix, or no conductors at all."""


@dataclass(frozen=True)
class Curve:
    """y = y[0] + y[1] x, z = z[0] + z[1] x + z[2] x^2 for x in `ends`; scene units."""

    y: tuple[float, float]
    z: tuple[float, float, float]
    ends: tuple[float, float]
    sigma: float
    """Standard deviation of its place across, in the worst direction, at its least certain point."""
    reach: float
    """How far from the curve its conductor is looked for."""
    certain: bool
    """Whether the views fix its place."""

    @classmethod
    def of_fit(
        cls,
        q: Float[np.ndarray, "5"],
        covariance: Float[np.ndarray, "5 5"],
        planes: tuple[float, float],
        ends: tuple[float, float],
        footprint: float,
    ) -> "Curve":
        """From q = (y0, y1, z0, z1, b) between the first and the last plane, as `sweep.py` has it.

        footprint: width of a pixel on the conductor, in scene units.
        """
        y0, y1, z0, z1, b = (float(value) for value in q)
        start, length = planes[0], planes[1] - planes[0]
        # s = (x - start) / length in y0 + (y1 - y0) s and z0 + (z1 - z0) s - 4 b s (1 - s)
        slope_y, slope_z, bend = (y1 - y0) / length, (z1 - z0 - 4 * b) / length, 4 * b / length**2
        sigma = 0.0
        for x in np.linspace(*ends, 20):
            s = (x - start) / length
            J = np.array([[1 - s, s, 0, 0, 0], [0, 0, 1 - s, s, -4 * s * (1 - s)]])
            sigma = max(sigma, float(np.linalg.eigvalsh(J @ covariance @ J.T)[-1]) ** 0.5)
        return cls(
            (y0 - slope_y * start, slope_y),
            (z0 - slope_z * start + bend * start**2, slope_z - 2 * bend * start, bend),
            (float(ends[0]), float(ends[1])),
            sigma,
            max(REACH_SIGMAS * sigma, REACH_PX * footprint),
            sigma <= CERTAIN_PX * footprint,
        )

    def points(self, x: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 3"]:
        """Points of the curve at x."""
        return np.stack([x, self.y[0] + self.y[1] * x, self.z[0] + x * (self.z[1] + self.z[2] * x)], 1)

    def to_json(self) -> dict[str, object]:
        """Plain values."""
        return asdict(self)

    @classmethod
    def from_json(cls, data: Mapping[str, Any], where: str) -> "Curve":
        """The inverse of `to_json`.  Raises SceneError for anything else."""
        try:
            y, z, ends = (tuple(float(v) for v in data[key]) for key in ("y", "z", "ends"))
            if (len(y), len(z), len(ends)) != (2, 3, 2):
                raise ValueError(f"y, z and ends hold {len(y)}, {len(z)} and {len(ends)} numbers")
            sigma, reach, known = float(data["sigma"]), float(data["reach"]), data["certain"]
            if not isinstance(known, bool) or not np.isfinite((*y, *z, *ends, sigma, reach)).all():
                raise ValueError(f"certain is {known!r}, and all numbers must be finite")
            return cls(y, z, ends, sigma, reach, known)  # type: ignore[arg-type]  # lengths are checked
        except (KeyError, TypeError, ValueError) as error:
            raise SceneError(
                f"A curve in {where} needs y (2 numbers), z (3), ends (2), sigma, reach and certain: "
                f"{error!r}. Remove the file: the curves are found again."
            ) from error


def write_curves(path: Path, curves: Sequence[Curve]) -> None:
    """Writes curves as JSON: complete or not at all."""
    content = {"format_version": 1, "frame": "scene", "curves": [curve.to_json() for curve in curves]}
    write_text(path, json.dumps(content, indent=1) + "\n")


def read_curves(path: Path) -> tuple[Curve, ...]:
    """What `write_curves` wrote.  Raises SceneError where it is not that."""
    try:
        return tuple(Curve.from_json(curve, str(path)) for curve in json.loads(path.read_text())["curves"])
    except (OSError, KeyError, TypeError, ValueError) as error:
        raise SceneError(
            f"{path} cannot be read as curves ({error!r}). Remove it: the curves are found again."
        ) from error
