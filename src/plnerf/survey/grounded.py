"""Curves that run along the ground are no wires: edges of tracks, which views from two sides show as lines.

Some of them sag between two structures as the wires above them do: images alone do not distinguish them.
"""

from collections.abc import Sequence

import numpy as np

from plnerf.findings import Finding, note
from plnerf.line.wire import Wire
from plnerf.survey.classify import ground_of
from plnerf.survey.config_ground import ClassifyConfig
from plnerf.survey.surface import Surface

STEP_M = 1.0


def without_grounded(
    wires: Sequence[Wire], surface: Surface, config: ClassifyConfig
) -> tuple[list[Wire], tuple[Finding, ...]]:
    """The wires of which half or more is at least `grounded_m` above the ground; all where no ground is seen.

    With a finding where any is left out.
    """
    count = len(surface.xyz)
    ground = ground_of(surface, (), np.zeros(count, np.bool_), config) if count else None
    if ground is None:
        return list(wires), ()
    kept = [
        wire for wire in wires if np.median(ground.above(wire.polyline(STEP_M))) >= config.grounded_m
    ]  # fmt: skip
    left = len(wires) - len(kept)
    if not left:
        return kept, ()
    what = (
        f"{left} of {len(wires)} curves run less than {config.grounded_m:g} m above the ground, or below it, "
        "for half of their length or more. They are taken for edges on the ground and left out."
    )
    return kept, (note("wires", what),)
