"""What holds the wires where spans meet or end, as values.

Letters: t along a junction's axis; b and a wires before and after it.
"""

from dataclasses import dataclass

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
