"""Curves that run into a wire of their span and away from it again.

Wires of a span are held apart: twins all along by the same way, others by more.  A curve that comes nearer to
another than any spacer holds twins, and is farther and several times as far from it elsewhere, was made of
pieces of that wire and of what lies behind it.  So is one that comes less near, if it stands out no more than
what is beside it.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from plnerf.line.wire import Wire
from plnerf.survey.refine.config import RefineConfig
from plnerf.survey.refine.refine import Refinement


def without_strays(refined: Refinement, wires: Sequence[Wire], config: RefineConfig) -> Refinement:
    """The refit of a span in which of two such curves the one that stands out at fewer places is not shown.

    wires: as they were before the refit, whose lengths count.  Metres.
    """
    shown = list(refined.shown)
    by_count = sorted(range(len(wires)), key=lambda k: -refined.counts[k])
    for place, k in enumerate(by_count):
        better = (j for j in by_count[:place] if shown[j])
        shown[k] = shown[k] and not any(_strays(refined, wires, k, j, config) for j in better)
    return replace(refined, shown=tuple(shown))


def _strays(refined: Refinement, wires: Sequence[Wire], k: int, j: int, config: RefineConfig) -> bool:
    """Whether curve k runs into curve j where both are."""
    one, other = refined.wires[k], refined.wires[j]
    ends = np.array([[end for end in (wire.base.a, wire.base.b)] for wire in (wires[k], wires[j])])
    along = np.sort((ends - one.base.a) @ one.base.u, axis=1)
    low, high = along[:, 0].max(), along[:, 1].min()
    if high <= low:
        return False
    s = np.linspace(low, high, config.samples)
    apart = np.linalg.norm(one.at(s) - other.at(s), axis=1)
    indistinct = bool(refined.distinct) and not refined.distinct[k]
    near_m = config.stray_indistinct_m if indistinct else config.stray_m
    far_m = max(near_m, config.stray_ratio * float(apart.min()))
    return bool(apart.min() < near_m and apart.max() > far_m)
