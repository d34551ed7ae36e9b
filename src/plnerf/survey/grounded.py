"""Curves that run along the ground are no wires: edges of tracks, which views from two sides show as lines.

Some of them sag between two structures as the wires above them do: images alone do not distinguish them.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool
from scipy.spatial import cKDTree

from plnerf.findings import Finding, note
from plnerf.line.wire import Wire
from plnerf.survey.classify import ground_of
from plnerf.survey.config_ground import ClassifyConfig
from plnerf.survey.on_wires import NONE, on_wires
from plnerf.survey.surface import Surface

STEP_M = 1.0


def without_grounded(
    wires: Sequence[Wire], surface: Surface, unsure: Bool[np.ndarray, " n"], config: ClassifyConfig
) -> tuple[list[Wire], tuple[Finding, ...]]:
    """The wires without those of which half or more runs less than `grounded_m` above ground that is seen
    beside it; with a finding where any is left out.

    Points on the curves are no ground here, nor are those that may be on others, `unsure`: where nothing
    else is seen they would be the lowest, as the arms of a tower are in the air, beside the end of a wire.
    """
    nearest, _ = on_wires(surface, wires, config.on_wires)
    free = (nearest == NONE) & ~unsure
    ground = ground_of(surface, (), ~free, config) if free.any() else None
    if ground is None:
        return list(wires), ()
    points = surface.xyz[free]
    beside = cKDTree(points[np.abs(ground.above(points)) <= config.grounded_m, :2])

    def runs_along_it(wire: Wire) -> bool:
        places = wire.polyline(STEP_M)
        seen = np.isfinite(beside.query(places[:, :2], distance_upper_bound=config.grounded_beside_m)[0])
        return bool((seen & (ground.above(places) < config.grounded_m)).mean() >= 1 / 2)

    kept = [wire for wire in wires if not runs_along_it(wire)]
    left = len(wires) - len(kept)
    if not left:
        return kept, ()
    what = (
        f"{left} of {len(wires)} curves run less than {config.grounded_m:g} m above the ground, or below it, "
        "for half of their length or more. They are taken for edges on the ground and left out."
    )
    return kept, (note("wires", what),)
