"""Tension strings: where strain and terminal structures hold wires.

The curves of adjacent spans meet at the structure, but a tension string ends short of it, and so does the
wire.  One structure holds all phases alike (`string_profiles.py` tells how images show it).  Shield wires are
clamped to it; a wire that hangs alone above all others may be one.  It has no string where phases have none,
or where its own images show it up to the structure; else nothing is known of it: at the peak of a tower its
own images mistake what stands behind it for a string.

The arms of such a structure halve the angle by which the line turns there.  Where its next span is not seen
they are taken to be square to the one that is, and attachments are the less certain along the line the
farther out they are.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from plnerf.line.ends import TWO_SIDED_95, Attached
from plnerf.line.line import Line, Span
from plnerf.line.wire import Wire
from plnerf.survey.config_spans import TensionStringConfig
from plnerf.survey.kinds import PHASES
from plnerf.survey.posed_photos import Photos
from plnerf.survey.string_profiles import End, Strings, shown_strings

Held = Mapping[tuple[int, int], Strings]
"""The strings by which structures hold wires, by the ids of both."""
END_NAMES = ("first", "last")


def with_tension_strings(
    lines: Sequence[Line], photos: Photos, config: TensionStringConfig
) -> tuple[Line, ...]:
    """The lines with their phase conductors ending at the clamps of tension strings where images show these,
    and with attachments as uncertain as such strings are long where images do not show which it is.

    At structures of kind suspension strings hang, whatever the images show.
    """
    full = photos.full_size()
    return tuple(_of_line(line, full, config) for line in lines)


def with_possible_strings(lines: Sequence[Line], config: TensionStringConfig) -> tuple[Line, ...]:
    """The lines of a point cloud, with attachments as uncertain as tension strings are long where the line
    turns by more than strings of suspension let it: of how such strings lie points show too little."""
    found = []
    for line in lines:
        turned = {one.id for one in line.structures if (one.line_angle_deg or 0.0) > config.turned_deg}
        strings = {
            (id_, wire.id): Strings(None, longest_string_m(line.spans, ends, config))
            for id_, ends in _held(line).items()
            for wire, _ in ends
            if id_ in turned
        }
        found.append(_with_strings(line, strings, config))
    return tuple(found)


def _held(line: Line) -> dict[int, list[End]]:
    """The ends of the conductors that each structure holds; shield wires are clamped to it."""
    held: dict[int, list[End]] = {}
    for wire in line.wires:
        for k, end in enumerate(wire.ends):
            if isinstance(end, Attached) and wire.kind != "shield":
                held.setdefault(end.structure, []).append((wire, k))
    return held


def _of_line(line: Line, photos: Photos, config: TensionStringConfig) -> Line:
    hanging = {one.id for one in line.structures if one.kind == "suspension"}
    held = {id_: ends for id_, ends in _held(line).items() if id_ not in hanging}
    longest = {id_: longest_string_m(line.spans, ends, config) for id_, ends in held.items()}
    alike = {id_: _held_alike(line.spans, ends, config) for id_, ends in held.items()}
    shown = {
        id_: shown_strings(phases, photos, longest[id_], config) for id_, (phases, _) in alike.items()
    }
    placed = {one.id for one in line.structures if one.sigma_m <= config.placed_m}
    strings: dict[tuple[int, int], Strings] = {}
    for id_, own in _of_one_length(shown, placed, config).items():
        phases, above = alike[id_]
        strings |= {(id_, wire.id): own for wire, _ in phases}
        if above:
            bare = own.length_m == 0 or shown_strings(above, photos, longest[id_], config).length_m == 0
            strings |= {(id_, wire.id): Strings(0.0 if bare else None, longest[id_]) for wire, _ in above}
    return _with_strings(line, strings, config)


def _of_one_length(
    shown: Mapping[int, Strings], placed: set[int], config: TensionStringConfig
) -> dict[int, Strings]:
    """A line's strings, at well placed structures of about one length where images allow it.

    What is behind the wire beyond a string may look like more of it.  Where two lengths fit what images show
    about as well, it is the one that fits the other structures' strings too.
    """
    known = {id_: dict(one.misfits) for id_, one in shown.items() if id_ in placed and one.length_m}
    lengths = set.intersection(*(set(one) for one in known.values())) if known else set()
    if len(known) < 2 or not lengths:
        return dict(shown)
    common = min(sorted(lengths), key=lambda length: sum(one[length] for one in known.values()))
    within = config.sigmas * config.alike_m
    return {
        id_: one.like(common, within, config.alike_misfit) if id_ in known else one
        for id_, one in shown.items()
    }


def _held_alike(
    spans: Sequence[Span], ends: Sequence[End], config: TensionStringConfig
) -> tuple[list[End], list[End]]:
    """Those of a structure's ends that are held alike, and those of wires that hang above all others, in a
    span that shows each above a circuit's phases or more, which may be shields."""
    height = np.array([wire.points(np.array([0.0, wire.base.length_m]))[k, 2] for wire, k in ends])
    top = height >= height.max() - config.alone_m
    gap_m = height[top].min() - height[~top].max(initial=-np.inf)
    of_span = np.array([[any(one is wire for one in span.wires) for wire, _ in ends] for span in spans])
    high, low = (of_span & top).sum(1), (of_span & ~top).sum(1)
    if not ((high > 0) & (low >= PHASES * high)).any() or gap_m <= config.alone_m:
        return list(ends), []
    below, above = ([end for end, high in zip(ends, top, strict=True) if high == which] for which in (0, 1))
    return below, above


def _with_strings(line: Line, strings: Held, config: TensionStringConfig) -> Line:
    """The line whose structures' strings are known; a structure with tension strings is no suspension."""
    sides = Counter(id_ for span in line.spans for id_ in span.structures)
    maybe = {id_ for (id_, _), one in strings.items() if one.length_m != 0}
    turned = {one.id: one.foot for one in line.structures if one.id in maybe and sides[one.id] == 1}

    def changed(wire: Wire) -> Wire:
        for k, end in enumerate(wire.ends):
            if isinstance(end, Attached):
                foot, own = turned.get(end.structure), strings.get((end.structure, wire.id))
                held = end if foot is None else _at_turned_arm(wire, end, foot, config)
                wire = _with_end(wire, k, held) if own is None else _ended(wire, k, held, own, config)
        return wire

    strained = {id_ for (id_, _), one in strings.items() if one.length_m}
    return replace(
        line,
        structures=tuple(
            replace(one, kind="strain") if one.id in strained and one.kind == "unknown" else one
            for one in line.structures
        ),
        spans=tuple(replace(span, wires=tuple(changed(wire) for wire in span.wires)) for span in line.spans),
    )


def _at_turned_arm(
    wire: Wire, end: Attached, foot: Float[np.ndarray, "3"], config: TensionStringConfig
) -> Attached:
    """An end that is held by an arm of which is not known how it is turned."""
    out_m = abs(float((end.point - foot)[:2] @ wire.base.n))
    return replace(
        end, sigma_m=float(np.hypot(end.sigma_m, out_m * np.tan(np.radians(config.half_turn_deg))))
    )


def _ended(wire: Wire, k: int, end: Attached, strings: Strings, config: TensionStringConfig) -> Wire:
    """A wire that its structure's tension strings hold at one end."""
    if strings.length_m == 0:
        moved, sigma, note = wire, end.sigma_m, None
    elif strings.length_m is None:
        sigma = float(np.hypot(end.sigma_m, strings.longest_m / TWO_SIDED_95))
        note = (
            f"Nothing shows whether a tension string holds its {END_NAMES[k]} end: its attachment may lie up "
            f"to {strings.longest_m:.1f} m nearer."
        )
        moved = wire
    else:
        sigma = float(np.hypot(end.sigma_m, config.sigma_m))
        note = about_string(strings.length_m, k)
        L = wire.base.length_m
        moved = wire.between(*((strings.length_m, L) if k == 0 else (0.0, L - strings.length_m)))
    point = moved.points(np.array([0.0, moved.base.length_m]))[k]
    held = replace(end, point=point, sigma_m=sigma, string_m=strings.length_m)
    notes = wire.notes if note is None else (*wire.notes, note)
    return replace(_with_end(moved, k, held), notes=notes)


def _with_end(wire: Wire, k: int, end: Attached) -> Wire:
    first, last = wire.ends
    return replace(wire, ends=(end, last) if k == 0 else (first, end))


def about_string(length_m: float, k: int) -> str:
    """What is noted of a wire that a tension string holds at one end."""
    return f"A tension string of about {length_m:.1f} m holds its {END_NAMES[k]} end."


def longest_string_m(spans: Sequence[Span], ends: Sequence[End], config: TensionStringConfig) -> float:
    """Greatest length of a structure's tension strings: by the least distance between its phases, below whose
    arms strings as long hang at other structures."""
    least = config.longest_m / config.spacing_share
    for span in spans:
        places = np.array([
            wire.points(np.array([0.0, wire.base.length_m]))[k]
            for wire, k in ends
            if any(one is wire for one in span.wires)
        ]).reshape(-1, 3)
        apart = np.linalg.norm(places[:, None] - places, axis=2)
        apart = apart[apart > config.bundle_m]
        least = min(least, float(apart.min(initial=least)))
    return least * config.spacing_share
