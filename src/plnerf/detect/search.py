"""The search for lines among the ridges that are left: a ridge counts for one line only."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from jaxtyping import Float, UInt8

from plnerf.detect.candidate import Candidate
from plnerf.detect.config import DetectConfig
from plnerf.detect.narrow import curve_odds, curve_point, narrow
from plnerf.detect.odds import odds_of, unclaimed
from plnerf.detect.refit import mask_ridges, refit
from plnerf.detect.sweep import Box
from plnerf.detect.to_wire import is_certain, transport_matrix
from plnerf.detect.views import Views


class Search:
    """The ridges of some views, and which of them no line has been fitted to yet."""

    def __init__(
        self,
        views: Views,
        responses: Float[np.ndarray, " p"],
        x: Float[np.ndarray, " i"],
        config: DetectConfig,
    ) -> None:
        self.views, self.responses, self.x, self.config = views, responses, x, config
        self.masks = np.zeros(len(responses), np.uint8)
        """Lines whose ridge a pixel is."""
        self.radius_px = 0
        """Half width of a line's mask; 0 until there is a line."""
        self.all_odds = self.odds = odds_of(responses, views, config.odds)

    @property
    def length(self) -> float:
        """From the first plane to the last."""
        return float(self.x[-1] - self.x[0])

    def settled(
        self, curves: Float[np.ndarray, "c 5"], x: Float[np.ndarray, " j"]
    ) -> Float[np.ndarray, "c 5"]:
        """Each curve at the best place nearby, in the widest of the narrowing cells and on few planes.

        The sweep's cells blur what the nearest views show: the order of its curves says little before this.
        """
        widths = self.config.narrow.cells[: self.config.narrow.settle]
        return narrow(self.views, self.odds, curves, x, widths, self.config)

    def shifted(self, theta: Float[np.ndarray, "5"], s: float, box: Box) -> Float[np.ndarray, "c 5"]:
        """A curve shifted to each cell of a box, of which those with most odds: wires that hang just alike.

        s: where along it the curve is to lie in the cells.  A cell shows next to nothing of a wire that is
        near to some cameras; the curve itself, where its shape is known, shows all.
        """
        j, k = (part.ravel() for part in np.meshgrid(*(np.arange(n) for n in box.shape), indexing="ij"))
        y, z = curve_point(theta, s)
        dy, dz = box.low[0] + box.cell * j - y, box.low[1] + box.cell * k - z
        curves = theta + np.stack([dy, dy, dz, dz, np.zeros(len(dy))], 1)
        odds = self.score(curves, box.x, box.cell / 2)
        return curves[np.argsort(-odds, kind="stable")[: self.config.search.most_alike]]

    def score(
        self, curves: Float[np.ndarray, "c 5"], x: Float[np.ndarray, " j"], reach: float
    ) -> Float[np.ndarray, " c"]:
        """Odds of curves that are known to a reach."""
        return stretches(curve_odds(self.views, self.odds, curves, x, reach)[:, :, 0])[0]

    def best(
        self,
        curves: Float[np.ndarray, "c 5"],
        least: float,
        wanted: Callable[[Candidate], bool] | None = None,
    ) -> Candidate | None:
        """The best of the lines near some curves, fitted to the ridges that are left; None for none.

        least: nats that it needs; wanted: what else it must be.
        """
        batch = self.config.search.batch
        if len(curves) > batch:
            reach = self.config.sweep.cell * self.config.narrow.cells[0]
            curves = curves[np.argsort(-self.score(curves, self.x, reach), kind="stable")[:batch]]
        # From narrow cells on too: wide ones may lead away a curve that is known well already.
        cells = self.config.narrow.cells
        near = np.concatenate([
            narrow(self.views, self.odds, curves, self.x, widths, self.config)
            for widths in (cells, cells[self.config.narrow.settle :])
        ])
        total = stretches(curve_odds(self.views, self.odds, near, self.x, 0.0)[:, :, 0])[0]
        left = np.where(self.masks > 0, np.float32(0), self.responses)
        for n in np.argsort(-total, kind="stable"):
            if total[n] < least:
                break
            line = self._fitted(near[n], left, least)
            if line is not None and (wanted is None or wanted(line)):
                return line
        return None

    def mask_ridges(self, line: Candidate) -> None:
        """Takes a line's ridges out."""
        self._mask(line)
        self._update_odds()

    def refit(self, line: Candidate, curves: Float[np.ndarray, "c 5"], least: float) -> Candidate | None:
        """The best near some curves with a line's own ridges put back; it then takes the line's place."""
        self.masks -= self._own(line)
        self._update_odds()
        best = self.best(curves, least)
        if best is not None:
            self._mask(best)
        return best

    def _fitted(
        self, curve: Float[np.ndarray, "5"], left: Float[np.ndarray, " p"], least: float
    ) -> Candidate | None:
        """The line that a curve becomes when it is fitted to ridges; None where its odds are too low."""
        search, last_plane = self.config.search, len(self.x) - 1
        line, piece = None, (0, last_plane)
        for _ in range(search.stretches):
            line = self._refit(curve, left, piece)
            if line is None:
                return None
            curve = line.theta
            of_plane, seen = self._of_plane(line, self.odds.sharp_px)
            odds, first, last = stretches(of_plane[None])[:, 0]
            shown = (int(first), int(last))
            if shown == piece or last - first < search.least_planes:
                break
            piece = shown
        assert line is not None
        if odds < max(least, search.min_mean * seen[int(first) : int(last) + 1].sum()):
            return None
        softer, _ = self._of_plane(line, 2 * self.odds.sharp_px)
        _, begin, end = stretches(softer[None])[:, 0]
        extent = extended(softer, int(begin), int(end), search.faint)
        line = replace(line, odds=float(odds), seen=(int(first), int(last)), ends=extent)
        return replace(line, fixed=is_certain(line, self.views, self.x, self.config.certainty))

    def _refit(
        self, curve: Float[np.ndarray, "5"], left: Float[np.ndarray, " p"], piece: tuple[int, int]
    ) -> Candidate | None:
        """The curve fitted to ridges in a piece of the window, from plane to plane, and extrapolated.

        Beyond the piece the line may be another span's, or nothing, and ridges near the curve are chance.
        """
        s = [plane / (len(self.x) - 1) for plane in piece]
        T = transport_matrix(s[0], s[1])
        x, config = self.x[piece[0] : piece[1] + 1], self.config
        line = refit(self.views, left, T @ curve, x, config.odds.min_response, config.refit)
        if line is None:
            return None
        back = np.linalg.inv(T)
        return replace(line, theta=back @ line.theta, covariance=back @ line.covariance @ back.T)

    def _of_plane(
        self, line: Candidate, sharp_px: float
    ) -> tuple[Float[np.ndarray, " i"], Float[np.ndarray, " i"]]:
        odds = self.odds._replace(sharp_px=sharp_px)
        of_plane, seen = curve_odds(self.views, odds, line.theta[None], self.x, 0.0)[0].T
        return of_plane, seen

    def _mask(self, line: Candidate) -> None:
        if not self.radius_px:
            self._sharpen(line)
        self.masks += self._own(line)

    def _sharpen(self, line: Candidate) -> None:
        """Chooses the radius at which the first line has the highest odds: it shows how good poses are."""
        search = self.config.search
        self.radius_px = max(search.mask_px, round(search.mask_rms * line.rms_px))
        odds = [self.odds._replace(sharp_px=radius) for radius in search.sharpness_px]
        total = [curve_odds(self.views, one, line.theta[None], self.x, 0.0)[0, :, 0].sum() for one in odds]
        self.all_odds = self.all_odds._replace(sharp_px=search.sharpness_px[int(np.argmax(total))])

    def _own(self, line: Candidate) -> UInt8[np.ndarray, " p"]:
        own = np.zeros_like(self.masks)
        fine = np.linspace(self.x[0], self.x[-1], 40 * len(self.x))
        mask_ridges(self.views, line.theta, fine, self.radius_px, own)
        return own

    def _update_odds(self) -> None:
        self.odds = unclaimed(self.all_odds, self.responses, self.masks > 0, self.views, self.config.odds)


def stretches(odds: Float[np.ndarray, "c i"]) -> Float[np.ndarray, "3 c"]:
    """The largest sum of each row over a stretch of it, and the stretch's first and last column (Kadane)."""
    out = np.zeros((3, len(odds)))
    run, begin = np.zeros(len(odds)), np.zeros(len(odds))
    for i, column in enumerate(odds.T):
        begin = np.where(run > 0, begin, i)
        run = np.maximum(run, 0) + column
        out = np.where(run > out[0], np.stack([run, begin, np.full(len(odds), i)]), out)
    return out


def extended(odds: Float[np.ndarray, " i"], first: int, last: int, faint: float) -> tuple[int, int]:
    """A stretch with what lies beyond its ends, as far as no more than `faint` nats speak against it."""
    before, beyond = np.cumsum(odds[:first][::-1]), np.cumsum(odds[last + 1 :])
    steps = [
        int(np.argmax(np.append(np.minimum.accumulate(part) < -faint, True))) for part in (before, beyond)
    ]
    return first - steps[0], last + steps[1]
