"""The search of one window of a scene, and the wires that it gives.

Pixels that lines found before took show nothing here; those that lines of this window take are marked.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int, UInt8

from plnerf.detect.candidate import Candidate, common_ends
from plnerf.detect.claims import pixels_along
from plnerf.detect.config import DetectConfig
from plnerf.detect.config_lines import EvidenceConfig
from plnerf.detect.directions import Direction
from plnerf.detect.evidence import line_evidence
from plnerf.detect.line_ridges import LineRidges, joined_ridges
from plnerf.detect.search import Search, Sharpness
from plnerf.detect.to_wire import certain_stretch, known_ends, transport_matrix, typical_footprint, wire_of
from plnerf.detect.views import Views
from plnerf.detect.windows import Window
from plnerf.line.frame import LineFrame
from plnerf.line.wire import Wire
from plnerf.scene.scene import Scene

Found = tuple[list[Candidate], list[Candidate]]
"""Wires, and lines that are none."""
Find = Callable[[Search], Found]
"""What finds them in a window."""


class KeptRidges:
    """The ridges of lines in a direction in the training photos, kept from one window to the next."""

    def __init__(self, scene: Scene, direction: Direction, config: EvidenceConfig) -> None:
        self.scene, self.direction, self.config = scene, direction, config
        self.kept: dict[int, LineRidges] = {}

    def of(self, views: Int[np.ndarray, " k"]) -> LineRidges:
        """Those of some views, which are the only ones kept."""
        scene, missing = self.scene, [int(k) for k in views if int(k) not in self.kept]
        images = [scene.train[k] for k in missing]
        new = line_evidence(scene.photos, scene.photo_cameras, images, self.direction.vector, self.config)
        self.kept.update(zip(missing, new, strict=True))
        self.kept = {int(k): self.kept[int(k)] for k in views}
        return joined_ridges(list(self.kept.values()))


@dataclass
class Known:
    """What windows before have shown."""

    wires: list[Wire]
    """Those of the directions before."""
    others: UInt8[np.ndarray, " p"]
    """1 for pixels, of all views, that lines of the directions before took: they show nothing here."""
    taken: UInt8[np.ndarray, " p"]
    """1 for pixels that any lines took."""
    sharpness: Sharpness | None = None
    """How well ridges agree with wires."""


def search_of(
    window: Window, views: Views, ridges: LineRidges, known: Known, config: DetectConfig
) -> Search:
    """The search of a window.  views: all of the scene; ridges: of those of the window, from which the ones
    that lines of other directions took are taken out."""
    mine = window.seen_by(views)
    counts = zip(views.starts[window.views], mine.sizes.prod(1), strict=True)
    others = np.concatenate([known.others[start : start + count] for start, count in counts])
    ridges.response[others > 0] = 0
    return Search(mine, ridges, middles_of_planes(window.planes), config, known.sharpness)


def wires_in(
    window: Window,
    views: Views,
    ridges: LineRidges,
    known: Known,
    frame: LineFrame,
    config: DetectConfig,
    find: Find,
) -> list[Wire]:
    """The wires in a window; what it takes, and how well ridges agree with wires, is known then.

    views and ridges: as of `search_of`.
    """
    search = search_of(window, views, ridges, known, config)
    found, rest = find(search)
    known.sharpness = search.sharpness
    _mark([*found, *rest], search, replace(window, views=np.arange(len(views.R))).seen_by(views), known.taken)
    wires = [_as_wire(line, found, search, window, frame) for line in found]
    return [wire for wire in wires if wire is not None]


def _as_wire(
    line: Candidate, found: Sequence[Candidate], search: Search, window: Window, frame: LineFrame
) -> Wire | None:
    """A line as far as it is known; None where that is one plane.  found: all wires of its window."""
    x, config = search.x, search.config
    footprint = typical_footprint(search.views, line.theta, x, config.certainty)
    ends = common_ends(line, found, search.length, config.select)
    ends = known_ends(line, ends, x, footprint, config.certainty)
    ends = certain_stretch(line, ends, x, footprint, window.unit_m(frame), config.certainty)
    if ends[0] == ends[1]:
        return None
    return wire_of(line, ends, window, x, footprint, frame, config.certainty)


def middles_of_planes(count: int) -> Float[np.ndarray, " i"]:
    """Places of planes, evenly between -1 and 1."""
    return np.linspace(-1 + 1 / count, 1 - 1 / count, count)


def _mark(lines: list[Candidate], search: Search, views: Views, taken: UInt8[np.ndarray, " p"]) -> None:
    """Marks the pixels of lines in all views."""
    x = search.x
    for line in lines:
        low, high = (x[plane] for plane in line.seen)
        s = [(end - x[0]) / (x[-1] - x[0]) for end in (low, high)]
        fine = np.linspace(low, high, 40 * (line.planes + 1))
        taken[pixels_along(views, transport_matrix(s[0], s[1]) @ line.theta, fine, search.mask_px(line))] = 1
