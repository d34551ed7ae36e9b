"""The search for lines among the ridges that are left: what speaks for one line speaks for no other."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt8

from plnerf.detect.narrow import curve_odds, narrow
from plnerf.detect.odds import odds_of, without
from plnerf.detect.refit import Fit, claim, refit
from plnerf.detect.views import Views

FINER = (0.5, 0.25, 0.125)
"""Of a cell: the widths in which a candidate is narrowed down."""
BATCH = 8
"""Curves that are narrowed down; of more, the most promising."""
CLAIMED_PX, CLAIMED_RMS = 2, 4.5
"""To both sides of a curve: the ridges there are its own; also in units of how far the first line's lie off,
because poses that are wrong scatter them."""
SHARPNESS_PX = (0.75, 1.5, 3.0)
"""Radii that the first line chooses from: within which of them a ridge is a conductor's."""
LEAST_MEAN = 0.14
"""Nats for each time that a view sees the line in a plane.  Beside others' ridges hardly a view speaks
against a curve, and chance ridges add up there."""
FAINT = 5.0
"""Nats against a line beyond an end that do not end it."""


@dataclass(frozen=True)
class Line:
    """A curve as fitted, the odds for it, and over how many planes it has them."""

    fit: Fit
    odds: float
    planes: int
    ends: tuple[int, int]
    """From which plane to which hardly anything speaks against it."""


class Search:
    """The ridges that are left for a curve when those of others are taken out."""

    def __init__(
        self, views: Views, responses: Float[np.ndarray, " p"], x: Float[np.ndarray, " i"], cell: float
    ) -> None:
        self.views, self.responses, self.x = views, responses, x
        self.cells = tuple(cell * part for part in FINER)
        self.claims = np.zeros(len(responses), np.uint8)
        self.radius_px = 0
        self.all = self.odds = odds_of(responses, views)

    def promise(
        self, curves: Float[np.ndarray, "c 5"], x: Float[np.ndarray, " j"]
    ) -> Float[np.ndarray, " c"]:
        """Odds of curves known to half a cell."""
        return stretches(curve_odds(self.views, self.odds, curves, x, self.cells[0])[:, :, 0])[0]

    def best(
        self, curves: Float[np.ndarray, "c 5"], least: float, wanted: Callable[[Line], bool] | None = None
    ) -> Line | None:
        """The best of the lines near some curves, fitted to the ridges that are left; None for none.

        wanted: what else it must be.
        """
        if len(curves) > BATCH:
            curves = curves[np.argsort(-self.promise(curves, self.x), kind="stable")[:BATCH]]
        near = narrow(self.views, self.odds, curves, self.x, self.cells)
        total = stretches(curve_odds(self.views, self.odds, near, self.x, 0.0)[:, :, 0])[0]
        left = np.where(self.claims > 0, np.float32(0), self.responses)
        for n in np.argsort(-total, kind="stable"):
            if total[n] < least:
                break
            line = self._fitted(near[n], left, least)
            if line is not None and (wanted is None or wanted(line)):
                return line
        return None

    def _fitted(
        self, curve: Float[np.ndarray, "5"], left: Float[np.ndarray, " p"], least: float
    ) -> Line | None:
        """The line that a curve becomes when it is fitted to ridges; None where too little speaks for it."""
        fit = refit(self.views, left, curve, self.x)
        if fit is None:
            return None
        of_plane, seen = self._of_plane(fit, self.odds.sharp_px)
        odds, first, last = stretches(of_plane[None])[:, 0]
        if odds < max(least, LEAST_MEAN * seen[int(first) : int(last) + 1].sum()):
            return None
        softer, _ = self._of_plane(fit, 2 * self.odds.sharp_px)
        _, *ends = stretches(softer[None])[:, 0]
        return Line(fit, float(odds), int(last - first), drawn_out(softer, *(int(end) for end in ends)))

    def _of_plane(self, fit: Fit, sharp_px: float) -> tuple[Float[np.ndarray, " i"], Float[np.ndarray, " i"]]:
        odds = self.odds._replace(sharp_px=sharp_px)
        of_plane, seen = curve_odds(self.views, odds, fit.q[None], self.x, 0.0)[0].T
        return of_plane, seen

    def claim(self, line: Line) -> None:
        """Takes a line's ridges out."""
        self._claim(line)
        self._renew()

    def again(self, line: Line, curves: Float[np.ndarray, "c 5"], least: float) -> Line | None:
        """The best near the given curves with a line's own ridges put back; it then has the line's place."""
        self.claims -= self._own(line)
        self._renew()
        best = self.best(curves, least)
        if best is not None:
            self._claim(best)
        return best

    def _claim(self, line: Line) -> None:
        if not self.radius_px:
            self._sharpen(line)
        self.claims += self._own(line)

    def _sharpen(self, line: Line) -> None:
        """What the first line says of the poses: the radius at which it has the highest odds."""
        self.radius_px = max(CLAIMED_PX, round(CLAIMED_RMS * line.fit.rms_px))
        odds = [self.odds._replace(sharp_px=radius) for radius in SHARPNESS_PX]
        total = [curve_odds(self.views, one, line.fit.q[None], self.x, 0.0)[0, :, 0].sum() for one in odds]
        self.all = self.all._replace(sharp_px=SHARPNESS_PX[int(np.argmax(total))])

    def _own(self, line: Line) -> UInt8[np.ndarray, " p"]:
        own = np.zeros_like(self.claims)
        fine = np.linspace(self.x[0], self.x[-1], 40 * len(self.x))
        claim(self.views, line.fit.q, fine, self.radius_px, own)
        return own

    def _renew(self) -> None:
        self.odds = without(self.all, self.responses, self.claims > 0, self.views)


def stretches(odds: Float[np.ndarray, "c i"]) -> Float[np.ndarray, "3 c"]:
    """The largest sum of each row over a stretch of it, and the stretch's first and last column (Kadane)."""
    out = np.zeros((3, len(odds)))
    run, begin = np.zeros(len(odds)), np.zeros(len(odds))
    for i, column in enumerate(odds.T):
        begin = np.where(run > 0, begin, i)
        run = np.maximum(run, 0) + column
        out = np.where(run > out[0], np.stack([run, begin, np.full(len(odds), i)]), out)
    return out


def drawn_out(odds: Float[np.ndarray, " i"], first: int, last: int) -> tuple[int, int]:
    """A stretch with what lies beyond its ends, as far as hardly anything speaks against it."""
    before, beyond = np.cumsum(odds[:first][::-1]), np.cumsum(odds[last + 1 :])
    steps = [
        int(np.argmax(np.append(np.minimum.accumulate(part) < -FAINT, True))) for part in (before, beyond)
    ]
    return first - steps[0], last + steps[1]
