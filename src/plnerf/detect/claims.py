"""Which ridges lines have, and the odds of those that are left: a ridge counts for one line only.

A line has a few thousand of the millions of pixels that a window's views have, and gives them back many times
while others are fitted: only what changed is computed again.

Letters: p pixels of all views, k of them.
"""

from typing import no_type_check

import numpy as np
from jaxtyping import Bool, Float, Float32, Int, UInt8

from plnerf.detect.config import OddsConfig
from plnerf.detect.odds import Box, Odds, forget, with_own_arrays
from plnerf.detect.parabola import curve_point
from plnerf.detect.views import Views, project_point
from plnerf.ops.kernel_cache import njit
from plnerf.ops.threads import share


class Claims:
    """The ridges of some views; which lines have them is learnt by the odds with `update`."""

    def __init__(
        self, views: Views, responses: Float32[np.ndarray, " p"], odds: Odds, config: OddsConfig
    ) -> None:
        self.odds, self.left = odds, responses
        """The odds, and the responses, of the ridges that no line has."""
        self.masks: UInt8[np.ndarray, " p"] = np.zeros(len(responses), np.uint8)
        """Lines whose ridge a pixel is."""
        self._views, self._responses, self._all, self._config = views, responses, odds, config
        self._others: Bool[np.ndarray, " p"] = np.zeros(len(responses), bool)
        """Whether a pixel was a line's at the last update."""
        self._changed = list[Int[np.ndarray, " k"]]()
        """Pixels that lines took or gave back since."""
        self._own = False
        """Whether the arrays are no others' too."""

    def take(self, pixels: Int[np.ndarray, " k"]) -> None:
        """Has one line more at each of some pixels."""
        self.masks[pixels] += 1
        self._changed.append(pixels)

    def give_back(self, pixels: Int[np.ndarray, " k"]) -> None:
        """Has one line less at each of some pixels."""
        self.masks[pixels] -= 1
        self._changed.append(pixels)

    def give_all_back(self) -> None:
        """Has no line anywhere."""
        self._changed.append(np.flatnonzero(self.masks))
        self.masks[:] = 0

    @property
    def sharp_px(self) -> float:
        """How far ridges may lie from a line that has them."""
        return self._all.sharp_px

    def sharpen(self, sharp_px: float) -> None:
        """Sets that; the odds learn of it with the next update."""
        self._all = self._all._replace(sharp_px=sharp_px)

    def blur(self, sharp_px: float) -> None:
        """Sets that at once."""
        self.sharpen(sharp_px)
        self.odds = self.odds._replace(sharp_px=sharp_px)

    def update(self) -> None:
        """Lets the odds know which ridges are left."""
        boxes = dict[int, Box]()
        for pixels in self._changed:
            differs = pixels[(self.masks[pixels] > 0) != self._others[pixels]]
            if not len(differs):
                continue
            if not self._own:
                self.left, self.odds, self._own = self.left.copy(), with_own_arrays(self.odds), True
            others = ~self._others[differs]
            self._others[differs] = others
            self.left[differs] = np.where(others, np.float32(0), self._responses[differs])
            for n, box in boxes_of(differs, self._views).items():
                boxes[n] = around_both(boxes[n], box) if n in boxes else box
        self._changed.clear()
        self.odds = self.odds._replace(sharp_px=self.sharp_px)
        forget(self.odds, self._all, self.left, self._others, self._views, self._config, boxes)


def boxes_of(pixels: Int[np.ndarray, " k"], views: Views) -> dict[int, Box]:
    """The box around the pixels of each view that has any.  pixels: ascending."""
    boxes, cuts = dict[int, Box](), np.searchsorted(pixels, views.starts)
    for n, (first, end) in enumerate(zip(cuts, [*cuts[1:], len(pixels)], strict=True)):
        if first < end:
            row, column = np.divmod(pixels[first:end] - views.starts[n], views.sizes[n, 0])
            boxes[n] = (
                slice(int(row[0]), int(row[-1]) + 1), slice(int(column.min()), int(column.max()) + 1)
            )  # fmt: skip
    return boxes


def around_both(a: Box, b: Box) -> Box:
    """The least box that holds two."""
    rows, columns = (
        slice(min(one.start, other.start), max(one.stop, other.stop)) for one, other in zip(a, b, strict=True)
    )
    return rows, columns


def pixels_along(
    views: Views, theta: Float[np.ndarray, "6"], x: Float[np.ndarray, " i"], radius_px: int
) -> Int[np.ndarray, " k"]:
    """The pixels of all views within a square about each of some places x of a curve, ascending."""
    N = len(views.R)
    marks, rows = np.zeros(int(views.sizes.prod(1).sum()), np.uint8), np.zeros((N, 2), np.int64)
    counts = np.zeros(N, np.int64)
    share(_mark, views, theta, x, radius_px, marks, rows, counts, of=N)
    out = np.empty(int(counts.sum()), np.int64)
    share(_gather, views, marks, rows, np.cumsum(counts) - counts, out, of=N)
    return out


@njit(cache=True)
@no_type_check
def _mark(views, theta, x, radius_px, marks, rows, counts, start, stop):  # noqa: PLR0913 (a kernel's arrays, one by one)
    """Into marks (p,): 1 at the pixels; into rows (n, 2): the first and the end of those that have any."""
    for n in range(start, stop):
        w, h = views.sizes[n]
        first, end, count, last = h, 0, 0, (-1, -1)
        for i in range(len(x)):
            y, z = curve_point(theta, i / (len(x) - 1))
            u, v, depth = project_point(views, n, x[i], y, z)
            if depth < 0 or (int(u), int(v)) == last:
                continue
            last = int(u), int(v)
            top, bottom = max(0, int(v) - radius_px), min(h, int(v) + radius_px + 1)
            first, end = min(first, top), max(end, bottom)
            for row in range(top, bottom):
                for column in range(max(0, int(u) - radius_px), min(w, int(u) + radius_px + 1)):
                    pixel = views.starts[n] + row * w + column
                    count += marks[pixel] == 0
                    marks[pixel] = 1
        rows[n, 0], rows[n, 1], counts[n] = first, end, count


@njit(cache=True)
@no_type_check
def _gather(views, marks, rows, places, out, start, stop):
    """Into out (k,): the pixels that are marked, those of each view from its place on."""
    for n in range(start, stop):
        w, k = views.sizes[n, 0], places[n]
        for pixel in range(views.starts[n] + rows[n, 0] * w, views.starts[n] + rows[n, 1] * w):
            if marks[pixel]:
                out[k] = pixel
                k += 1
