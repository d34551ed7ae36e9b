"""What holds the wires where spans meet or end, as values.

Letters: t along a junction's axis; b and a wires before and after it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float

from plnerf.line.ends import Open
from plnerf.line.line import Structure
from plnerf.survey.kinks import Kink
from plnerf.survey.span_wires import Junction

NOT_SEEN = Open("no structure is seen there, and the images end or do not show it")
NO_KINK = Open("the next span's wires meet it without a clear kink, and no structure is seen there")


@dataclass(frozen=True, eq=False)
class Support:
    """What holds the wires at a junction."""

    junction: Junction
    structure: Structure | None
    """None: nothing shows one."""
    at: tuple[Float[np.ndarray, "b 2"], Float[np.ndarray, "a 2"]]
    """Of each wire before and after it, t of its attachment and the standard deviation of that."""
    kinks: tuple[Kink, ...] = ()
    strings: bool = False
    """Whether something is seen above the wires that holds them."""
    afar: bool = False
    """Whether only photos show it in which it is small."""
    mine: bool = True
    """False: the structure is another line's."""

    @property
    def reason(self) -> Open:
        """Why the wires' ends are open where there is no structure."""
        return NOT_SEEN if self.junction.bend_deg is None else NO_KINK


@dataclass(frozen=True, eq=False)
class Supports:
    """At all junctions of all chains."""

    chains: tuple[tuple[Support, ...], ...]
    """Of each chain one more than it has spans."""
    points: Bool[np.ndarray, " n"]
    """Those of the surface that belong to structures."""

    @property
    def seen(self) -> tuple[Structure, ...]:
        """All structures, each once, in the order of their ids."""
        every = (one.structure for chain in self.chains for one in chain if one.mine)
        return tuple(one for one in every if one is not None)


def each_structure_once(chain: Sequence[Support], least_span: float) -> list[Support]:
    """A chain's supports; where both structures of a span are one, one of its ends is open.

    They are if they stand nearer to each other than this share of what the images show of the span.

    What the images show of a span may be shorter than the reach in which its end looks for what holds it.
    The structure is the one's between two spans, or else the one's that it is nearer to.
    """
    found = list(chain)
    for pair in pairwise(range(len(found))):
        one, other = (found[k].structure for k in pair)
        span = found[pair[0]].junction.after
        if one is None or other is None or span is None:
            continue
        if _apart_m(one, other) < least_span * span.base.length_m:
            k = max(pair, key=lambda k: (found[k].junction.bend_deg is None, _away_m(found[k])))
            nowhere = (np.zeros((0, 2)), np.zeros((0, 2)))
            found[k] = replace(found[k], structure=None, at=nowhere, strings=False, afar=False)
    return found


def _apart_m(one: Structure, other: Structure) -> float:
    return float(np.linalg.norm(one.foot[:2] - other.foot[:2]))


def _away_m(support: Support) -> float:
    """Distance along the line from the junction to its structure."""
    assert support.structure is not None
    return abs(float(support.junction.axis.local(support.structure.foot[None])[0, 0]))
