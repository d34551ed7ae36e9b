"""The search for lines among the ridges that are left: a ridge counts for one line only."""

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from copy import copy
from dataclasses import replace
from typing import NamedTuple, no_type_check

import numpy as np
from jaxtyping import Float, Int

from plnerf.detect.candidate import Candidate, hangs
from plnerf.detect.chains import Chains, chains_of
from plnerf.detect.claims import Claims, pixels_along
from plnerf.detect.config import DetectConfig
from plnerf.detect.distinct import distinct_ones
from plnerf.detect.line_ridges import LineRidges
from plnerf.detect.meets import curves_where_chains_meet
from plnerf.detect.odds import Odds, odds_of
from plnerf.detect.parabola import DirectedOdds, curve_odds, curve_points, odds_along, odds_directed
from plnerf.detect.refit import refit
from plnerf.detect.to_wire import is_certain, transport_matrix
from plnerf.detect.views import Views
from plnerf.detect.windows import Window
from plnerf.ops.kernel_cache import njit


class Sharpness(NamedTuple):
    """How far the ridges of a wire lie from it in the images, which depends on the poses."""

    odds_px: float
    """Radius within which a ridge is a wire's."""
    mask_px: int
    """Half width of a wire's mask."""


class Search:
    """The ridges of some views, and which of them no line has been fitted to yet."""

    def __init__(
        self,
        views: Views,
        ridges: LineRidges,
        x: Float[np.ndarray, " i"],
        config: DetectConfig,
        sharpness: Sharpness | None = None,
    ) -> None:
        self.views, self.x, self.config = views, x, config
        responses, self.tangents = ridges
        self.responses = responses
        self.sharpness = sharpness
        """None until a line that hangs has shown it, here or in another window."""
        self._mask_px: dict[Candidate, int] = {}
        self._chains: Chains | None = None
        self._all = odds_of(responses, views, config.odds)
        if sharpness is not None:
            self._all = self._all._replace(sharp_px=sharpness.odds_px)
        self.claims = Claims(views, responses, self._all, config.odds)

    @property
    def odds(self) -> Odds:
        """Those of the ridges that no line has."""
        return self.claims.odds

    @property
    def length(self) -> float:
        """From the first plane to the last."""
        return float(self.x[-1] - self.x[0])

    @property
    def chains(self) -> Chains:
        """Those of all ridges."""
        if self._chains is None:
            least = self.config.odds.min_response
            self._chains = chains_of(self.responses, self.views, least, self.config.chains)
        return self._chains

    def turned(self, views: Views) -> "Search":
        """The search of the same ridges in another frame, before any line has some.  views: in that frame."""
        other, other_chains = copy(self), self.chains
        other.views, other._mask_px, other._chains = views, {}, other_chains
        other.claims = Claims(views, self.responses, self._all, self.config.odds)
        return other

    def met(self, window: Window, spare: float) -> Float[np.ndarray, "c 6"]:
        """Curves in which chains of two views meet, of all ridges, whether a line has them or not.

        spare: by which part of its length a chain may be longer.
        """
        config = self.config.chains.finer(window.finer, spare)
        box = (window.low, window.high)
        return curves_where_chains_meet(self.chains, self.views, self.x, *box, config)

    def rated(self, curves: Float[np.ndarray, "c 6"]) -> Float[np.ndarray, "3 c"]:
        """Odds of each curve's best stretch on a few planes, and where it begins and ends, 0 to 1."""
        planes = max(2, len(self.x) // self.config.search.coarse)
        x = np.linspace(self.x[0], self.x[-1], planes)
        odds = curve_odds(self.views, self.odds, curves, x, self.config.search.reach)[:, :, 0]
        total, first, last = stretches(odds)
        return np.stack([total * len(self.x) / planes, first / (planes - 1), last / (planes - 1)])

    def ranked(self, curves: Float[np.ndarray, "c 6"]) -> Float[np.ndarray, "c 6"]:
        """The curves with the highest odds first."""
        return curves[np.argsort(-self.rated(curves)[0], kind="stable")]

    def distinct(self, curves: Float[np.ndarray, "c 6"]) -> Float[np.ndarray, "d 6"]:
        """The best of all curves that lie near each other where they show most, best first."""
        search = self.config.search
        total, first, last = self.rated(curves)
        order = np.argsort(-total, kind="stable")
        order = order[total[order] > 0]
        curves = curves[order]
        kept = distinct_ones(curves, first[order], last[order], search.apart, search.most_pending)
        return curves[kept]

    def alike(
        self, theta: Float[np.ndarray, "6"], curves: Float[np.ndarray, "c 6"]
    ) -> Float[np.ndarray, "d 6"]:
        """Curves of one shape, and of one bend, through the middle of what each of some curves shows."""
        _, first, last = self.rated(curves)
        s = (first + last) / 2
        y, z = curve_points(curves.T, s)
        dy, dz = np.subtract((y, z), curve_points(theta, s))
        more = theta[4] - curves[:, 4]
        before, beyond = 4 * s**2, 4 * (1 - s) ** 2
        aside = theta[5] - curves[:, 5]
        bent = curves + np.stack(
            [-before * aside, -beyond * aside, before * more, beyond * more, more, aside], 1
        )
        return np.concatenate([theta + np.stack([dy, dy, dz, dz, 0 * dy, 0 * dy], 1), bent])

    def best(
        self,
        curves: Float[np.ndarray, "c 6"],
        least: float,
        wanted: Callable[[Candidate], bool] | None = None,
    ) -> tuple[Candidate | None, int]:
        """The first of some curves that becomes a line when it is fitted, and how many were tried.

        least: nats that it needs; wanted: what else it must be.
        """
        for tried, curve in enumerate(curves, 1):
            line = self._fitted(curve, least)
            if line is not None and (wanted is None or wanted(line)):
                return line, tried
        return None, len(curves)

    def lengthen(self, before: int, beyond: int, lines: Sequence[Candidate]) -> list[Candidate]:
        """Adds planes before the first and beyond the last one, and gives the lines on all of them."""
        most, step = len(self.x) - 1, self.x[1] - self.x[0]
        T = transport_matrix(-before / most, 1 + beyond / most)
        low, high = self.x[0] - before * step, self.x[-1] + beyond * step
        self.x = np.linspace(low, high, len(self.x) + before + beyond)
        self.claims.give_all_back()
        longer = []
        for line in lines:
            theta, covariance = T @ line.theta, T @ line.covariance @ T.T
            seen = (line.seen[0] + before, line.seen[1] + before)
            longer.append(replace(line, theta=theta, covariance=covariance, seen=seen))
            self._mask_px[longer[-1]] = self.mask_px(line)
            self.claims.take(self._own(longer[-1]))
        self.update_odds()
        return longer

    def mask_ridges(self, line: Candidate) -> None:
        """Takes a line's ridges out."""
        self.claim(line)
        self.update_odds()

    def free_ridges(self, line: Candidate) -> None:
        """Puts a line's ridges back."""
        self.release(line)
        self.update_odds()

    def claim(self, line: Candidate) -> None:
        """Makes ridges a line's own.  The odds learn of it with `update_odds`, as of `release`."""
        if self.sharpness is None and hangs(line, self.length, self.config.select):
            self._sharpen(line)
        self.claims.take(self._own(line))

    def release(self, line: Candidate) -> None:
        """Makes ridges a line's own no longer."""
        self.claims.give_back(self._own(line))

    def refit(self, line: Candidate, curves: Float[np.ndarray, "c 6"], least: float) -> Candidate | None:
        """The best near some curves with a line's own ridges put back; it then takes the line's place.

        The odds learn of it with the next change.
        """
        self.free_ridges(line)
        best, _ = self.best(self.ranked(curves), least)
        if best is None:
            return None
        if line.fixed and not best.fixed:
            best = line  # it was followed to where views do not fix it
        else:
            best = replace(best, likeness=line.likeness, repeats=line.repeats)
        self.claim(best)
        return best

    def _fitted(self, curve: Float[np.ndarray, "6"], least: float) -> Candidate | None:
        """The line that a curve becomes when it is fitted to ridges; None where its odds are too low."""
        search, piece, before = self.config.search, self._piece(curve), 0.0
        for fit in range(search.stretches):
            line = self._refit(curve, piece, search.coarse_step)
            if line is None:
                return None
            curve = line.theta
            odds, needed, shown = self._shown(line, least)
            if fit and odds < min(search.promising * needed, search.growing * before):
                return None
            if shown == piece or shown[1] - shown[0] < search.least_planes:
                break
            piece, before = shown, odds
        line = self._refit(curve, piece)
        if line is None:
            return None
        odds, needed, (first, last) = self._shown(line, least)
        if odds < needed or not self._runs_along(line):
            return None
        line = replace(line, odds=odds, seen=(first, last))
        return replace(line, fixed=is_certain(line, self.views, self.x, self.config.certainty))

    def _shown(self, line: Candidate, least: float) -> tuple[float, float, tuple[int, int]]:
        """Odds of a line's best stretch, those that it needs, and the stretch's first and last plane."""
        radii = {self.odds.sharp_px}
        if self.sharpness is None:  # the radius at which this line does best
            radii |= {radius for radius in self.config.search.sharpness_px if radius < self.odds.sharp_px}
        rated = []
        for radius in sorted(radii):
            of_plane, seen = self.odds_in_planes(line, radius)
            _, first, last = stretches(of_plane[None] - self.config.search.doubt)[:, 0]
            shown = (int(first), int(last))
            odds = of_plane[shown[0] : shown[1] + 1].sum()
            needed = max(least, self.config.search.min_mean * float(seen[shown[0] : shown[1] + 1].sum()))
            rated.append((float(odds), needed, shown))
        return max(rated, key=lambda one: one[0] / one[1])

    def _runs_along(self, line: Candidate) -> bool:
        """Whether a line has the direction that is searched: others are found in theirs."""
        y_A, y_B, z_A, z_B, *_ = line.theta
        chains = self.config.chains
        return bool(
            abs(y_B - y_A) <= chains.max_askew * self.length
            and abs(z_B - z_A) <= chains.max_slope * self.length
        )

    def _piece(self, curve: Float[np.ndarray, "6"]) -> tuple[int, int]:
        """First and last plane of the stretch that shows a curve, not shorter than a fit needs."""
        planes = len(self.x)
        odds = odds_along(self.views, self.odds, curve, self.x, self.config.search.reach)[:, 0]
        _, first, last = stretches(odds[None] - self.config.search.doubt)[:, 0]
        more = max(0.0, (self.config.search.least_planes - (last - first)) / 2)
        return max(0, int(first - more)), min(planes - 1, int(np.ceil(last + more)))

    def _refit(
        self, curve: Float[np.ndarray, "6"], piece: tuple[int, int], step: int = 1
    ) -> Candidate | None:
        """The curve fitted to ridges in a piece of the window, from plane to plane, and extrapolated.

        Beyond the piece the line may be another span's, or nothing, and ridges near the curve are chance.
        step: one of so many planes is used.
        """
        s = [plane / (len(self.x) - 1) for plane in piece]
        T = transport_matrix(s[0], s[1])
        planes, config = (piece[1] - piece[0]) // step + 1, self.config
        x = np.linspace(self.x[piece[0]], self.x[piece[1]], planes)
        ridges = LineRidges(self.claims.left, self.tangents)
        line = refit(self.views, ridges, T @ curve, x, config.odds.min_response, config.refit)
        if line is None:
            return None
        back = np.linalg.inv(T)
        return replace(line, theta=back @ line.theta, covariance=back @ line.covariance @ back.T)

    def odds_in_planes(
        self, line: Candidate, sharp_px: float
    ) -> tuple[Float[np.ndarray, " i"], Float[np.ndarray, " i"]]:
        """Odds of a line in each plane, ridges within a radius being its own, and how many views see it."""
        odds, config = self.odds._replace(sharp_px=sharp_px), self.config.odds
        directed = DirectedOdds(
            math.radians(config.turn_deg), config.turn_shown, config.turn_chance, self.config.refit.end_on
        )
        of_plane, seen = odds_directed(self.views, odds, self.tangents, line.theta, self.x, directed).T
        return of_plane, seen

    def _sharpen(self, line: Candidate) -> None:
        """Chooses the radius at which the first wire has the highest odds: it shows how good poses are."""
        search = self.config.search
        odds = [self.odds._replace(sharp_px=radius) for radius in search.sharpness_px]
        total = [odds_along(self.views, one, line.theta, self.x, 0.0)[:, 0].sum() for one in odds]
        sharp_px = search.sharpness_px[int(np.argmax(total))]
        self.sharpness = Sharpness(sharp_px, self.mask_px(line))
        self.claims.sharpen(sharp_px)

    def mask_px(self, line: Candidate) -> int:
        """Half width of a line's mask; it stays what it was when it was asked for first."""
        search = self.config.search
        if line not in self._mask_px:
            own = max(search.mask_px, round(search.mask_rms * line.rms_px))
            self._mask_px[line] = self.sharpness.mask_px if self.sharpness else own
        return self._mask_px[line]

    def _own(self, line: Candidate) -> Int[np.ndarray, " k"]:
        """The pixels whose ridges are a line's."""
        (first, last), most = line.seen, len(self.x) - 1
        T = transport_matrix(first / most, last / most)
        fine = np.linspace(self.x[first], self.x[last], 40 * (last - first + 1))
        return pixels_along(self.views, T @ line.theta, fine, self.mask_px(line))

    @contextmanager
    def blurred(self) -> Iterator[None]:
        """Ridges may lie as far from a line as before the first wire had shown how near to it they lie."""
        sharp_px = self.claims.sharp_px
        self.claims.blur(max(sharp_px, self.config.odds.sharp_px))
        try:
            yield
        finally:
            self.claims.blur(sharp_px)

    def update_odds(self) -> None:
        """Lets the odds know which ridges are left."""
        self.claims.update()


@njit(cache=True)
@no_type_check
def stretches(odds):
    """The largest sum of each row (c, i) over a stretch, and the stretch's first and last column: (3, c).

    Kadane's algorithm.
    """
    out = np.zeros((3, len(odds)))
    for c in range(len(odds)):
        run, begin = 0.0, 0
        for i in range(odds.shape[1]):
            if run <= 0:
                run, begin = 0.0, i
            run += odds[c, i]
            if run > out[0, c]:
                out[0, c], out[1, c], out[2, c] = run, begin, i
    return out
