"""Tension strings of one line are alike: where a structure at an end of the line is placed badly, they tell
where it stands.

Single photos show of such a structure its arm, or the ends of its strings, and from one side only.  Where its
strings end, images show as well as elsewhere; it stands beyond by the length of the line's other strings.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from plnerf.line.ends import Attached
from plnerf.line.line import Line, Structure
from plnerf.line.wire import Wire
from plnerf.survey.config_spans import TensionStringConfig
from plnerf.survey.tension_strings import about_string


def with_like_strings(lines: Sequence[Line], config: TensionStringConfig) -> tuple[Line, ...]:
    """The lines with such structures, and what they hold without strings, moved along the line.

    Of the strings' ends, which stay, only the deviation changes.  A structure whose strings differ from the
    others' by more than what is known of both stays where it is.
    """
    return tuple(_of_line(line, config) for line in lines)


def _of_line(line: Line, config: TensionStringConfig) -> Line:
    by_id = {one.id: one for one in line.structures}  # a tee ends at another line's
    found: dict[int, list[float]] = {}
    for wire in line.wires:
        for end in wire.ends:
            if isinstance(end, Attached) and end.string_m and end.structure in by_id:
                found.setdefault(end.structure, []).append(end.string_m)
    own = {id_: float(np.median(lengths)) for id_, lengths in found.items()}
    others = [length for id_, length in own.items() if by_id[id_].sigma_m <= config.placed_m]
    if not others:
        return line
    sigma = float(np.hypot(config.sigma_m, config.alike_m))
    for id_, length in own.items():
        by_m = float(np.median(others)) - length
        if by_id[id_].sigma_m > config.placed_m and abs(by_m) <= config.sigmas * sigma:
            line = _placed(line, by_id[id_], by_m, sigma)
    return line


def _placed(line: Line, structure: Structure, by_m: float, sigma: float) -> Line:
    """The line with the structure moved outwards, by how much its strings are too short.

    sigma: standard deviation of the place that the strings give.
    """
    held = [
        (wire, k)
        for wire in line.wires
        for k, end in enumerate(wire.ends)
        if isinstance(end, Attached) and end.structure == structure.id
    ]
    outwards = np.array([(1 if k else -1) * wire.base.u for wire, k in held]).mean(0)
    if np.linalg.norm(outwards) < 1 / 2:  # wires go on to both sides: their kinks are the better witnesses
        return line
    outwards /= np.linalg.norm(outwards)
    before = structure.sigma_m**2
    after = 1 / (1 / before + 1 / sigma**2)
    by_m *= 1 - after / before
    moved = replace(
        structure,
        foot=structure.foot + np.append(by_m * outwards, 0.0),
        sigma_m=float(np.sqrt(after)),
        evidence=f"{structure.evidence}, and strings as long as the line's others",
    )

    def changed(wire: Wire) -> Wire:
        for k in (k for one, k in held if one.id == wire.id):
            wire = _held(wire, k, by_m, (before, after))
        return wire

    return replace(
        line,
        structures=tuple(moved if one.id == structure.id else one for one in line.structures),
        spans=tuple(replace(span, wires=tuple(changed(wire) for wire in span.wires)) for span in line.spans),
    )


def _held(wire: Wire, k: int, by_m: float, variances: tuple[float, float]) -> Wire:
    """A wire whose structure is moved outwards.  variances: of the structure's place, before and after."""
    end = wire.ends[k]
    assert isinstance(end, Attached)
    before, after = variances
    free = max(end.sigma_m**2 - before, 0.0)  # of the wire's own place
    L, notes = wire.base.length_m, wire.notes
    if end.string_m:
        longer = end.string_m + by_m
        old, new = about_string(end.string_m, k), about_string(longer, k)
        notes = tuple(new if one == old else one for one in notes)
        end = replace(end, sigma_m=float(np.sqrt(free)), string_m=longer)
    else:
        wire = wire.between(*((-by_m, L) if k == 0 else (0.0, L + by_m)))
        point = wire.points(np.array([0.0, wire.base.length_m]))[k]
        end = replace(end, point=point, sigma_m=float(np.sqrt(free + after)))
    ends = list(wire.ends)
    ends[k] = end
    return replace(wire, ends=(ends[0], ends[1]), notes=notes)
