"""Crossarms that were taken for wires: straight, thin, level and at the wires' heights, but across the line.

Letters: t along a junction's axis, y to its left.
"""

from collections.abc import Sequence

import numpy as np

from plnerf.findings import Finding, note
from plnerf.line.wire import Wire
from plnerf.survey.config_spans import CrossarmConfig
from plnerf.survey.span_wires import crossing
from plnerf.survey.support import Support, Supports


def without_crossarms(wires: Sequence[Wire], supports: Supports, config: CrossarmConfig) -> list[Wire]:
    """The wires without those that lie across a structure's line, at it, and reach no farther to its sides
    than its own wires."""
    every = [one for chain in supports.chains for one in chain if one.structure is not None]
    return [wire for wire in wires if not any(_is_arm(wire, one, config) for one in every)]


def _is_arm(wire: Wire, support: Support, config: CrossarmConfig) -> bool:
    axis = support.junction.axis
    if abs(float(wire.base.u @ axis.u)) > np.cos(np.radians(config.across_deg)):
        return False
    assert support.structure is not None
    t, y = axis.local(support.structure.foot[None])[0, :2]
    own = [
        axis.local(one.points(crossing(one, axis, np.array([t]))))[0, 1]
        for side in support.junction.sides
        for one in side
    ]
    reach = config.beyond_m + max((abs(float(one - y)) for one in own), default=0.0)
    ends = axis.local(wire.points(np.array([0.0, wire.base.length_m])))[:, :2]
    return bool((np.linalg.norm(ends - [t, y], axis=1) <= reach).all())


def about_crossarms(count: int) -> list[Finding]:
    """What a reader may know of those that were left out."""
    if not count:
        return []
    what = "One curve was a structure's arm" if count == 1 else f"{count} curves were a structure's arms"
    return [note("structures", f"{what}, and left out.")]
