"""One line in the place of two that meet: a piece of a wire, and a line made of that wire and another.

Wires of a span hang side by side.  The first line that a search fits has all wires' ridges near it, and may
run along one wire for a part of its way and beside it further on, where the rest of that wire then is a line
of its own.  The two have more ridges than the wire alone, so that no fit of both together mends them.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

from plnerf.detect.candidate import Candidate, needed
from plnerf.detect.search import Search
from plnerf.detect.together import parallel


def merged(search: Search, lines: Sequence[Candidate]) -> list[Candidate]:
    """The lines, of which two that meet give way to one that has nearly all that they have.

    It is fitted with the ridges of both, and leaves none of them of which the other could be a line.
    """
    lines, most = list(lines), search.config.search.meeting
    pairs = {(a, b): parallel(a, b, search) for a, b in combinations(lines, 2)}
    for a, b in sorted((pair for pair in pairs if pairs[pair] < most), key=lambda pair: pairs[pair]):
        if a in lines and b in lines:
            one = _one_for(search, a, b)
            if one is not None:
                lines[lines.index(a)] = one
                lines.remove(b)
    search.update_odds()
    return lines


def _one_for(search: Search, a: Candidate, b: Candidate) -> Candidate | None:
    """The line that has the ridges of two lines, and then claims them; None where both keep theirs."""
    for line in (a, b):
        search.release(line)
    search.update_odds()
    alone = {line: search.best(line.theta[None], needed(line, search.config.select))[0] for line in (a, b)}
    line, other = (a, b) if _odds(alone[a]) >= _odds(alone[b]) else (b, a)
    one = alone[line]
    if one is not None and one.odds >= search.config.search.merged_odds * (a.odds + b.odds):
        one = replace(one, likeness=line.likeness, repeats=line.repeats)
        search.mask_ridges(one)
        rest, _ = search.best(other.theta[None], needed(other, search.config.select))
        if rest is None and one.fixed >= max(a.fixed, b.fixed):
            return one
        search.release(one)
    for line in (a, b):
        search.claim(line)
    search.update_odds()
    return None


def _odds(line: Candidate | None) -> float:
    return 0.0 if line is None else line.odds
