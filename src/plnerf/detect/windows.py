"""Windows along a direction: stretches of space in which lines are searched, each in a frame of its own.

A window's frame has x along the direction, z up, its length from -1 to 1; all sizes of the search are
fractions of it.  The views that see a window, and the ridges in them that run along it, are all that the
search needs: cost and memory grow with the number of windows, not with the length of the line times the
number of images.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from plnerf.detect.config_windows import WindowConfig
from plnerf.detect.directions import Direction
from plnerf.detect.views import Views, seen_places
from plnerf.line.frame import LineFrame


@dataclass(frozen=True, eq=False)
class Window:
    """A stretch of space, in the scene frame."""

    origin: Float[np.ndarray, "3"]
    azimuth_rad: float
    half: float
    """Half its length."""
    low: Float[np.ndarray, "2"]
    """Lowest y and z of the volume to search, in the window's frame."""
    high: Float[np.ndarray, "2"]
    views: Int[np.ndarray, " k"]
    """Those that are used."""
    planes: int
    """Planes across it in which lines are looked for."""
    follow: tuple[int, int] = (0, 0)
    """Planes before and beyond it in which those that were found are followed: no other window is there."""
    finer: float = 1.0
    """Its planes are so many times closer together than usual, because each image shows little of it."""

    @property
    def R(self) -> Float[np.ndarray, "3 3"]:
        """Scene to window."""
        c, s = np.cos(self.azimuth_rad), np.sin(self.azimuth_rad)
        return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])

    def to_scene(self, points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "m 3"]:
        """Points of the window's frame in the scene's."""
        return self.half * points @ self.R + self.origin

    def of_scene(self, points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "m 3"]:
        """The inverse of `to_scene`."""
        return (points - self.origin) @ self.R.T / self.half

    def unit_m(self, frame: LineFrame) -> float:
        """Half its length in metres."""
        return float(frame.from_scene(np.array([self.half]))[0])

    def seen_by(self, views: Views) -> Views:
        """The window's views in its frame, their pixels one after another."""
        sizes = views.sizes[self.views]
        starts = np.concatenate([[0], np.cumsum(sizes.prod(1))[:-1]]).astype(np.int64)
        return Views(
            np.ascontiguousarray(views.R[self.views] @ self.R.T),
            self.of_scene(views.centre[self.views]),
            views.focal[self.views],
            views.principal[self.views],
            views.distortion[self.views],
            sizes,
            starts,
        )


def spacing_along(centres: Float[np.ndarray, "n 3"], u: Float[np.ndarray, "2"]) -> float:
    """The usual way along a direction from image to image: half of all the way is flown in longer steps.

    A climb past a structure takes many images in one place: with them the median step would be too short.
    """
    steps = np.diff(centres, axis=0)
    ahead = np.sort(np.abs(steps[:, :2] @ u))
    way = np.cumsum(ahead)
    if way[-1] <= 0:
        return float(np.median(np.linalg.norm(steps, axis=1)))
    return float(ahead[np.searchsorted(way, way[-1] / 2)])


def windows_along(direction: Direction, views: Views, config: WindowConfig) -> Iterator[Window]:
    """The windows along a direction past the cameras that any views show, each a part over the one before
    it."""
    u = np.array([np.cos(direction.azimuth_rad), np.sin(direction.azimuth_rad)])
    along = views.centre[:, :2] @ u
    across = views.centre[:, :2] @ np.array([-u[1], u[0]])
    height = views.centre[:, 2]
    spacing = max(spacing_along(views.centre, u), config.least_step * direction.footprint)
    first, last = along.min(), along.max()
    flown = max(last - first, np.ptp(across))
    whole = flown <= config.whole * spacing
    longer = config.margin * min(flown, config.whole * spacing) + (flown - (last - first)) / 2
    first, last = first - longer, last + longer
    length = last - first if whole else config.spacings * spacing
    planes = round(config.planes * length / flown) if whole else config.planes
    finer = max(1.0, config.shown * length / (planes * (direction.footprint or np.inf)))
    planes = round(finer * planes)
    count = int(np.ceil((last - first - length) / ((1 - config.overlap) * length) - 1e-9)) + 1
    more = round(config.follow * planes)
    for k, middle in enumerate(np.linspace(first + length / 2, last - length / 2, count)):
        near = np.abs(along - middle) <= (0.5 + config.near) * length
        at = np.abs(along - middle) <= 0.5 * length
        if not at.any():
            continue
        beside, level, half = across[at], height[at], length / 2
        y, z = (beside.min() + beside.max()) / 2, (level.min() + level.max()) / 2
        low = [beside.min() - y - config.aside * length, level.min() - z - config.below * length]
        high = [beside.max() - y + config.aside * length, level.max() - z + config.above * length]
        window = Window(
            np.array([*(middle * u + y * np.array([-u[1], u[0]])), z]), direction.azimuth_rad, half,
            np.array(low) / half, np.array(high) / half, np.flatnonzero(near), planes,
            (more * (k == 0), more * (k == count - 1)), finer,
        )  # fmt: skip
        window = window if whole else _with_those_that_see_it(window, views, config)
        if len(window.views):
            yield window


def _with_those_that_see_it(window: Window, views: Views, config: WindowConfig) -> Window:
    """With the views that show enough of it."""
    sides = zip((-1.0, *window.low), (1.0, *window.high), config.places, strict=True)
    places = np.stack(np.meshgrid(*(np.linspace(*side) for side in sides), indexing="ij"), -1).reshape(-1, 3)
    shown = seen_places(window.seen_by(views), places).mean(1)
    enough = np.sort(shown)[-min(config.enough, len(shown))]
    return replace(window, views=window.views[(shown >= min(config.least_shown, enough)) & (shown > 0)])
