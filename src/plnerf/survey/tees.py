"""Lines that end at another line's structure: a tee, or a corner too sharp for one line to turn.

Letters: t along a junction's axis, y to its left, z up.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from plnerf.line.line import Structure
from plnerf.survey.config_wires import SupportConfig
from plnerf.survey.span_wires import Junction
from plnerf.survey.support import Support


def with_tees(chains: Sequence[Sequence[Support]], config: SupportConfig) -> list[list[Support]]:
    """The chains' supports, those at which one line ends at another's structure with that structure.

    chains: the longest first; of two that end at one structure, it belongs to the longer.  No span has it at
    both of its ends, as one of a few metres beside it would.
    """
    found = [list(chain) for chain in chains]
    for c in range(len(found) - 1, -1, -1):
        # Of a span of a few metres that end comes to a structure near both where one was seen.
        for k in sorted((0, len(found[c]) - 1), key=lambda k: found[c][k].structure is None):
            others = [one for j, chain in enumerate(found) if j != c for one in chain if one.mine]
            for structure, other in ((one.structure, one) for one in others):
                if structure is None or _is_beside(structure, found[c], k):
                    continue
                if _ends_at(found[c][k], other, config):
                    given_up = found[c][k].structure
                    found[c][k] = _at(found[c][k], structure, config)
                    _follow(found, given_up, structure)
                    break
    return found


def _follow(found: list[list[Support]], given_up: Structure | None, structure: Structure) -> None:
    """Has ends that had come to a structure which its own line gives up come to what that line has now; those
    of a span that has it at its other end are open."""
    for chain in found:
        for k, one in enumerate(chain):
            if given_up is not None and one.structure is given_up:
                chain[k] = replace(one, structure=None if _is_beside(structure, chain, k) else structure)


def _is_beside(structure: Structure, chain: Sequence[Support], k: int) -> bool:
    """Whether a span that ends at the k-th support of its chain has a structure at its other end."""
    return any(chain[j].structure is structure for j in (k - 1, k + 1) if 0 <= j < len(chain))


def _ends_at(end: Support, other: Support, config: SupportConfig) -> bool:
    """Whether the last wires of a line reach another line's structure, or the place of its crossarms."""
    structure, axis = other.structure, end.junction.axis
    assert structure is not None
    ((t, y, foot),) = axis.local(structure.foot[None])
    here = 0.0 if end.structure is None else float(axis.local(end.structure.foot[None])[0, 0])
    z = [span.end(last)[2] for span, last in end.junction.ends]
    reach = config.tee_m + _half_width(other.junction)
    beside = config.tee_m + _half_width(end.junction)
    # A foot that nothing shows is as high as the lowest wire.
    short = config.body.short_m
    level = foot - short <= np.mean(z) <= foot + structure.height_m + short
    return bool(level and abs(t - here) <= reach and abs(y) <= beside)


def _at(end: Support, structure: Structure, config: SupportConfig) -> Support:
    """The end of a line at another's structure: where its own evidence has it, else at that one's axis."""
    if end.structure is not None:
        return replace(end, structure=structure, mine=False)
    t = float(end.junction.axis.local(structure.foot[None])[0, 0])
    before, after = (np.tile([t, config.by_tee_m], (len(wires), 1)) for wires in end.junction.sides)
    return replace(end, structure=structure, at=(before, after), mine=False)


def _half_width(junction: Junction) -> float:
    """Of the wires there, across the line."""
    return max(span.half_width(last) for span, last in junction.ends)
