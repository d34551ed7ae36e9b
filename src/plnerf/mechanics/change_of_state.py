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


@dataclass(frozen=True, eq=False)
class Loads:
    """What a state does to a wire."""

    coefficient: float
    """The resultant over the weight."""
    swing_rad: Float[np.ndarray, " n"]
    """By how much the resultant leans to the left of each span's base."""


@dataclass(frozen=True, eq=False)
class Spans:
    """A section's spans from attachment to attachment, as surveyed."""

    bases: tuple[Base, ...]
    theta: Float[np.ndarray, "n 6"]
    """Of their curves, on these bases."""


@dataclass(frozen=True, eq=False)
class SectionModel:
    """One wire through the spans of a section, in one state."""

    bases: tuple[Base, ...]
    load: Load
    diameter_mm: float
    forward: tuple[bool, ...]
    """Whether each wire runs as its line does, so that left of the line is left of it."""

    def spans(self, theta: Float[np.ndarray, "n 6"], ends: Float[np.ndarray, "n 2"]) -> Spans:
        """theta counts on the surveyed bases, `self.bases`."""
        cuts = tuple(
            base.cut(float(first), base.length_m + float(last))
            for base, (first, last) in zip(self.bases, ends, strict=True)
        )
        moved = [transport(*one) for one in zip(theta, self.bases, cuts, strict=True)]
        return Spans(cuts, np.array(moved))

    def residual(
        self, spans: Spans, m: Float[np.ndarray, "4"], ratio: float
    ) -> Float[np.ndarray, " n"]:
        """By how much the unstressed length of each span is greater than at the survey."""
        after = _unstressed(self._planes(spans, m, ratio), m, self.load.temperature_c)
        return after - _unstressed(_surveyed(spans), m, m[0])

    def solve(self, spans: Spans, m: Float[np.ndarray, "4"]) -> float:
        """r.  Raises SurveyError where no tension answers."""
        surveyed = _unstressed(_surveyed(spans), m, m[0]).sum()
        as_tense = self._planes(spans, m, 1.0)

        def total(log_ratio: float) -> float:
            planes = as_tense * [1.0, 1.0, math.exp(log_ratio), 1.0]
            return float(_unstressed(planes, m, self.load.temperature_c).sum() - surveyed)

        most = math.log(MOST_RATIO)
        if total(-most) < 0 or total(most) > 0:
            raise SurveyError(
                f"No tension answers the state {self.load.name!r} ({self.load.words}). Check its temperature "
                "and its loads, and the units of the conductor's file."
            )
        return math.exp(brentq(total, -most, most, xtol=1e-12))

    def outputs(
        self, spans: Spans, m: Float[np.ndarray, "4"], ratio: float
    ) -> Float[np.ndarray, "n 10"]:
        """`OUTPUTS` of each span, theta on the surveyed bases."""
        swings, rows = self._loads(m).swing_rad, []
        planes = self._planes(spans, m, ratio)
        for base, cut, old, swing, (D, h, p, load) in zip(
            self.bases, spans.bases, spans.theta, swings, planes, strict=True
        ):
            L = cut.length_m
            new = np.array([*old[:4], L**2 / (8 * p), swing])
            sag = vertical_sag(new, L)
            x0 = catenary.lowest(D, h, p)[0]
            tension = load * m[1] * p
            greatest = tension * math.cosh(max(abs(x0), abs(D - x0)) / p)
            rows.append([*transport(new, cut, base), sag, sag - vertical_sag(old, L), tension, greatest])
        return np.array(rows)

    def _loads(self, m: Float[np.ndarray, "4"]) -> Loads:
        found = CableLoads(
            np.float64(self.diameter_mm / 1e3), np.float64(m[1]), np.array([self.load.ice_mm / 1e3]),
            np.array([abs(self.load.wind_pa)]), ice_density=self.load.ice_kg_m3 * GRAVITY,
        )  # fmt: skip
        # phi turns down about the base, so that the load leans to the left of it where phi is positive.
        side = math.copysign(1.0, self.load.wind_pa) * np.where(self.forward, 1.0, -1.0)
        return Loads(float(found.load_coefficient[0]), side * float(found.load_angle[0]))

    def _planes(
        self, spans: Spans, m: Float[np.ndarray, "4"], ratio: float
    ) -> Float[np.ndarray, "n 4"]:
        """D, h, p and the resultant over the weight of each span in the state."""
        loads, rows = self._loads(m), []
        for cut, theta, (_, _, p, load), swing in zip(
            spans.bases, spans.theta, _surveyed(spans), loads.swing_rad, strict=True
        ):
            D, h, _ = plane_of(np.array([*theta[:5], swing]), cut.length_m)
            rows.append((D, h, ratio * p * load / loads.coefficient, loads.coefficient))
        return np.array(rows)


def _surveyed(spans: Spans) -> Float[np.ndarray, "n 4"]:
    """D, h, p and the resultant over the weight of each span at the survey."""
    return np.array([
        (*plane_of(theta, base.length_m), 1 / math.cos(theta[5]))
        for base, theta in zip(spans.bases, spans.theta, strict=True)
    ])  # fmt: skip


def _unstressed(
    planes: Float[np.ndarray, "n 4"], m: Float[np.ndarray, "4"], temperature_c: float
) -> Float[np.ndarray, " n"]:
    """Length without stress at 0 degrees of each span that hangs so at a temperature."""
    (_, w, ea, alpha), (D, h, p, load) = m, planes.T
    span = CatenarySpan(D, h, p, load, np.float64(w))
    strained = DeformationRte(
        span.T_mean(), span.L, np.float64(1.0), np.float64(w), np.float64(ea), np.float64(alpha),
        np.float64(0.0), Polynomial([0.0, ea]), np.full(len(D), temperature_c),
    )  # fmt: skip
    length: Float[np.ndarray, " n"] = strained.L_0()
    return length
