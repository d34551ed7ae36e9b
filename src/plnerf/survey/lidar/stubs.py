"""Stubs of spans at a cloud's edge: a few metres of wires beyond a structure, which make no span.

So short a piece fixes neither sag nor p nor where the wires go, and as a span of its own it would make two
conductors of every wire that passes a single structure.  Its points stay points of conductors.
"""

from collections.abc import Sequence

from plnerf.findings import Finding, note
from plnerf.survey.lidar.candidates import Candidate
from plnerf.survey.lidar.structures import CLOUD_ENDS, Holder


def without_stubs(
    found: Sequence[Candidate], holders: Sequence[tuple[Holder, Holder]], min_open_m: float
) -> tuple[list[Candidate], list[Candidate]]:
    """The wires of spans, and those of stubs: spans that the cloud cuts off all of whose wires are shorter
    than `min_open_m`."""
    longest: dict[int, float] = {}
    for one in found:
        longest[one.span] = max(longest.get(one.span, 0.0), one.wire.base.length_m)
    cut = {k for k, length in longest.items() if CLOUD_ENDS in holders[k] and length < min_open_m}
    return [one for one in found if one.span not in cut], [one for one in found if one.span in cut]


def about_stubs(stubs: Sequence[Candidate], min_open_m: float) -> list[Finding]:
    """That wires go on to where the cloud ends; nothing without stubs."""
    if not stubs:
        return []
    lengths = [one.wire.base.length_m for one in stubs]
    reach = f"{min(lengths):.0f} to {max(lengths):.0f} m" if len(lengths) > 1 else f"{lengths[0]:.0f} m"
    return [
        note(
            "stubs",
            f"{len(stubs)} wires go on for {reach} to where the cloud ends. Pieces of less than "
            f"{min_open_m:g} m are no spans: their points are conductors, but nothing is measured of them.",
        )
    ]
