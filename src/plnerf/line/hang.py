"""A wire hung between two points."""

import numpy as np
from jaxtyping import Float

from plnerf.line import catenary
from plnerf.line.base import Base
from plnerf.line.ends import Attached, End, Evidence
from plnerf.line.wire import Kind, Wire

Point = tuple[float, float, float]


def hang(  # noqa: PLR0913 (a wire has that many properties)
    a: Point | Float[np.ndarray, "3"],
    b: Point | Float[np.ndarray, "3"],
    sag_m: float,
    *,
    id: int = 1,
    ends: tuple[End, End] | None = None,
    kind: Kind = "phase",
    bundle: int | None = None,
    diameter_m: float | None = None,
    name: str | None = None,
) -> Wire:
    """The upright catenary between `a` and `b` whose greatest drop below the chord is `sag_m`.

    ends: structures 1 and 2 hold it where left out.  Raises ConfigError for a sag that is not positive.
    """
    first, last = np.array(a, np.float64), np.array(b, np.float64)
    base = Base(first[:2], last[:2])
    p = catenary.p_of_sag(base.length_m, float(last[2] - first[2]), sag_m)
    theta = np.array([0.0, 0.0, first[2], last[2], base.length_m**2 / (8 * p), 0.0])
    held = ends or (Attached(1, first, 0.0), Attached(2, last, 0.0))
    return Wire(
        id, base, theta, np.zeros((6, 6)), held, Evidence("given", 0), kind, bundle, diameter_m, name
    )
