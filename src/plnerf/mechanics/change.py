"""The change of state of one tension section, by mechaphlowers: how its tensions change with temperature and
load.

Over suspensions a wire's tension evens out, so that in all spans the horizontal tension changes by one ratio
r, while the attachments stay where they are.  r is where the wire's length without stress and at 0 degrees,
summed over the section, stays what it was:

    sum L / (1 + T_mean / EA + alpha t) at the survey  =  the same in the state

Of level spans this is the ruling span's equation.  Length L, mean tension, strain and loads are
mechaphlowers' (`CatenarySpan`, `DeformationRte`, `CableLoads`), which are imported here alone.

Letters: n spans; theta (n, 6) as in `line/wire.py`; ends (n, 2) by how much each first and last end lies
farther along the base than it was surveyed; m = (t, w, EA, alpha), temperature at the survey, weight N/m.
"""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from mechaphlowers.core.models.cable.deformation import DeformationRte
from mechaphlowers.core.models.cable.span import CatenarySpan
from mechaphlowers.core.models.external_loads import CableLoads
from numpy.polynomial import Polynomial
from scipy.optimize import brentq

from plnerf.errors import SurveyError
from plnerf.line import catenary
from plnerf.line.base import Base
from plnerf.line.curve import plane_of, transport, vertical_sag
from plnerf.line.states import Load

GRAVITY = 9.80665
MOST_RATIO = 50.0
"""Tensions that change by more than this factor are no answer."""
OUTPUTS = 10
"""theta (6), sag, sag less that of the survey, horizontal and greatest tension."""


@dataclass(frozen=True)
class Loaded:
    """What a load does to a wire of weight w: the resultant over w, and the angle it swings by."""

    coefficient: float
    swing_rad: float


def loaded(load: Load, weight_n_m: float, diameter_mm: float, *, forward: bool) -> Loaded:
    """forward: whether the wire runs as its line does, so that left of the line is left of it."""
    loads = CableLoads(
        np.float64(diameter_mm / 1e3), np.float64(weight_n_m), np.array([load.ice_mm / 1e3]),
        np.array([abs(load.wind_pa)]), ice_density=load.ice_kg_m3 * GRAVITY,
    )  # fmt: skip
    # phi turns down about the base, so that the load leans to the left of it where phi is positive.
    side = math.copysign(1.0, load.wind_pa) * (1 if forward else -1)
    return Loaded(float(loads.load_coefficient[0]), side * float(loads.load_angle[0]))


@dataclass(frozen=True, eq=False)
class SectionModel:
    """One wire through the spans of a section, in one state."""

    bases: tuple[Base, ...]
    load: Load
    diameter_mm: float
    forward: tuple[bool, ...]

    def residual(
        self, theta: Float[np.ndarray, "n 6"], ends: Float[np.ndarray, "n 2"], m: Float[np.ndarray, "4"],
        ratio: float,
    ) -> Float[np.ndarray, " n"]:  # fmt: skip
        """By how much the unstressed length of each span is greater than at the survey."""
        before, after = self._planes(theta, ends, m, ratio)
        t, w, ea, alpha = m
        return _unstressed(after, w, ea, alpha, self.load.temperature_c) - _unstressed(
            before, w, ea, alpha, t
        )

    def solve(
        self, theta: Float[np.ndarray, "n 6"], ends: Float[np.ndarray, "n 2"], m: Float[np.ndarray, "4"]
    ) -> float:
        """r.  Raises SurveyError where no tension answers."""

        def total(log_ratio: float) -> float:
            return float(self.residual(theta, ends, m, math.exp(log_ratio)).sum())

        most = math.log(MOST_RATIO)
        if total(-most) < 0 or total(most) > 0:
            raise SurveyError(
                f"No tension answers the state {self.load.name!r} ({self.load.words}). Check its temperature "
                "and its loads, and the units of the conductor's file."
            )
        return math.exp(brentq(total, -most, most, xtol=1e-12))

    def outputs(
        self, theta: Float[np.ndarray, "n 6"], ends: Float[np.ndarray, "n 2"], m: Float[np.ndarray, "4"],
        ratio: float,
    ) -> Float[np.ndarray, "n 10"]:  # fmt: skip
        """`OUTPUTS` of each span; theta counts on the surveyed base."""
        rows = []
        _, after = self._planes(theta, ends, m, ratio)
        for k, base in enumerate(self.bases):
            cut = base.cut(float(ends[k, 0]), base.length_m + float(ends[k, 1]))
            old = transport(theta[k], base, cut)
            D, h, p, load = after[k]
            new = np.array([*old[:4], cut.length_m**2 / (8 * p), self._swing(m, k)])
            sag, surveyed = vertical_sag(new, cut.length_m), vertical_sag(old, cut.length_m)
            x0 = catenary.lowest(D, h, p)[0]
            tension = load * m[1] * p
            greatest = tension * math.cosh(max(abs(x0), abs(D - x0)) / p)
            rows.append([*transport(new, cut, base), sag, sag - surveyed, tension, greatest])
        return np.array(rows)

    def _swing(self, m: Float[np.ndarray, "4"], k: int) -> float:
        return loaded(self.load, m[1], self.diameter_mm, forward=self.forward[k]).swing_rad

    def _planes(
        self, theta: Float[np.ndarray, "n 6"], ends: Float[np.ndarray, "n 2"], m: Float[np.ndarray, "4"],
        ratio: float,
    ) -> tuple[Float[np.ndarray, "n 4"], Float[np.ndarray, "n 4"]]:  # fmt: skip
        """D, h, p and the resultant over the weight of each span, at the survey and in the state."""
        before, after = [], []
        for k, base in enumerate(self.bases):
            cut = base.cut(float(ends[k, 0]), base.length_m + float(ends[k, 1]))
            old = transport(theta[k], base, cut)
            L = cut.length_m
            D, h, p = plane_of(old, L)
            coefficient = 1 / math.cos(old[5])
            before.append((D, h, p, coefficient))
            state = loaded(self.load, m[1], self.diameter_mm, forward=self.forward[k])
            D, h, _ = plane_of(np.array([*old[:5], state.swing_rad]), L)
            after.append((D, h, ratio * p * coefficient / state.coefficient, state.coefficient))
        return np.array(before), np.array(after)


def _unstressed(
    planes: Float[np.ndarray, "n 4"], w: float, ea: float, alpha: float, temperature_c: float
) -> Float[np.ndarray, " n"]:
    """Length of each span without stress at 0 degrees."""
    D, h, p, load = planes.T
    span = CatenarySpan(D, h, p, load, np.float64(w))
    strained = DeformationRte(
        span.T_mean(), span.L, np.float64(1.0), np.float64(w), np.float64(ea), np.float64(alpha),
        np.float64(0.0), Polynomial([0.0, ea]), np.full(len(D), temperature_c),
    )  # fmt: skip
    length: Float[np.ndarray, " n"] = strained.L_0()
    return length
