"""In which direction is searched next: those that many lines vote for, or whose thin lines are in the air.

Where none has such lines, nor any wire been found, those with most votes are searched all the same: wires of
a pixel show as ridges along a direction where they do not show as thin lines.  The last is the one in which
the cameras flew: lines are flown along, and a lattice tower beside them has more votes than a few wires.
"""

import numpy as np

from plnerf.detect.config import DetectConfig
from plnerf.detect.directions import Direction, flown, given, no_votes, stands_out, strongest, vote
from plnerf.detect.glance import direction_in_air
from plnerf.detect.in_window import Known
from plnerf.detect.line_maps import LineMaps
from plnerf.detect.segments import Segments
from plnerf.detect.surroundings import Surroundings
from plnerf.detect.views import Views
from plnerf.detect.voted_windows import voted_windows
from plnerf.detect.windows import Window, windows_along
from plnerf.scene.orientation import heading
from plnerf.scene.scene import Scene


class Directions:
    """The directions of a scene, one after the other."""

    def __init__(
        self, scene: Scene, views: Views, maps: LineMaps, surroundings: Surroundings, config: DetectConfig
    ) -> None:
        self._scene, self._views, self._maps = scene, views, maps
        self._surroundings, self._config = surroundings, config
        self._looked: list[float] = []
        """Azimuths with votes that had a look or a search."""
        self._silent: list[Direction] = []
        """Those whose thin lines show nothing in the air, and that were not searched."""
        self._flown = False
        """Whether the one in which the cameras flew was asked for."""
        self._first: Direction | None = None
        self._votes = no_votes(views, config.directions)
        """Those of the segments that were left when the last direction was asked for."""
        self._count = 0

    def following(self, left: Segments, known: Known) -> Direction | None:
        """The next one to search; None where there is none.  left: the segments that no line has taken.

        Raises SceneError where an azimuth is given and the scene has no north.
        """
        config = self._config.directions
        self._count += 1
        if self._count > (config.most if config.azimuth_deg is None else 1):
            return None
        self._votes = votes = vote(left, self._views, config)
        if config.azimuth_deg is not None:
            x, y, _ = heading(self._scene.frames, config.azimuth_deg)
            return given(float(np.arctan2(y, x)) % np.pi, votes, config)
        found = any(wire.evidence.certain for wire in known.wires)
        while True:
            direction = strongest(votes, self._looked, config)
            faint = not stands_out(direction, self._first, config)
            least = config.min_faint if faint else config.min_excess
            if direction.excess < (least if found else config.least_excess):
                break
            self._first = self._first or direction
            self._looked.append(direction.azimuth_rad)
            if direction.excess >= config.clear:
                return direction
            in_air = self._in_air(direction, known, faint)
            if in_air is not None:
                self._looked.append(in_air.azimuth_rad)  # votes on its other side may lead to it again
                return in_air
            if not faint:
                self._silent.append(direction)
        if found:
            return None
        if self._silent:
            return self._silent.pop(0)
        azimuth = None if self._flown else flown(self._views, config)
        self._flown = True
        return None if azimuth is None else given(azimuth, votes, config)

    def windows(self, direction: Direction) -> list[Window]:
        """Those along a direction that are searched.  Along the first one that is all of them, for wires of a
        pixel show as ridges where they do not show as thin lines; and along one that nobody voted for."""
        if self._count == 1 or np.isinf(direction.excess):
            return list(windows_along(direction, self._views, self._config.windows))
        return voted_windows(direction, self._views, self._votes, self._config)

    def _in_air(self, direction: Direction, known: Known, faint: bool) -> Direction | None:
        """The direction that a look finds.  Faint directions are many, and most of them are clutter."""
        config = self._config
        least = config.select.min_odds if faint else config.directions.least_in_air
        windows = self.windows(direction)
        return direction_in_air(
            direction, windows, self._views, self._maps, self._surroundings, known, least, config
        )
