"""The tables of a report: wires and clearances; its cards and its protocol."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from plnerf.line.ends import Attached, End, Quantity
from plnerf.line.survey import Survey
from plnerf.line.wire import Wire
from plnerf.report.coverage_view import any_not_seen, not_seen
from plnerf.report.figures import AS_THEY_ARE, CERTAIN, NOTHING, Units, counted, listed, share
from plnerf.report.line_tables import least_crossings, span_headings, value_range
from plnerf.report.nearest import Nearest, by_need, worst
from plnerf.report.possible_view import or_nearer
from plnerf.report.shown import height_shift, shown, units_of
from plnerf.report.tables import XYZ, Cell, Table, Verdict, verdict_of
from plnerf.report.words import kinds_of, numbers_of_spans, span_head, temperature, where

MOST_ROWS = 60
"""Of the table of clearances; of more, the least of each span come first and the whole table is folded."""


@dataclass(frozen=True)
class Card:
    """A figure to remember."""

    name: str
    value: str
    below: str
    verdict: Verdict | None = None


def wire_tables(survey: Survey) -> list[Table]:
    """What was measured, and how well it is known; none without wires."""
    numbers = numbers_of_spans(survey)
    rows = [(wire, numbers[wire.id]) for wire in survey.wires]
    if not rows:
        return []
    units, up = units_of(survey), height_shift(survey.frame)
    some_open = any(wire.open for wire, _ in rows)
    some_swing = any(wire.swing_deg for wire, _ in rows)
    groups, first = {}, 0
    for count, text in span_headings(survey):
        groups[first] = text
        first += count
    measured = Table(
        ["wire", span_head(survey), "kind", *units.heads_95("sag", "span length", "wire length", "p"),
         *units.heads("lowest at"),
         *units.heads_95("its height", "height of first end", "height of last end"),
         *[f"swing,\u00a0° ±\u00a0{CERTAIN}"] * some_swing,
         *["no sag, span length and p, because"] * some_open],
        [
            [*_measured(wire, span, units, up), *[AS_THEY_ARE.interval(wire.swing_deg, 1)] * some_swing,
             *[wire.open or NOTHING] * some_open]
            for wire, span in rows
        ],
        f"Catenaries, with half the width of each length's {CERTAIN} interval. Sag: greatest vertical drop "
        "below the chord between the attachments. p: tension across the load, over load per length. The "
        "lowest point between the ends, by its horizontal distance from the first end and its height z."
        + " Swing: the angle of the load about the base, to the left of it, from first end to last, where "
        "positive." * some_swing,
        frozenset({2, 11 + some_swing}), groups,
    )  # fmt: skip
    known = Table(
        ["wire", *units.heads("residual across", "residual up"), "coverage", *units.heads("longest gap"),
         "first end", "last end", "evidence", "notes"],
        [_known(wire, units) for wire, _ in rows],
        "How well each is known. Residuals: root mean square distance of its points, horizontally across the "
        "wire and vertically. Coverage: share of its length with evidence; on the rest the curve bridges a "
        "gap.",
        frozenset({5, 6, 7, 8}), groups,
    )  # fmt: skip
    return [measured, known]


def _measured(wire: Wire, span: str, units: Units, up: float) -> list[str]:
    length = wire.base.length_m
    s = wire.lowest[0]
    at_end = " (first end)" if s == 0 else " (last end)" if s == length else ""
    places = np.array([s, 0.0, length])
    heights = zip(wire.at(places)[:, 1] + up, wire.sigma_at(places)[:, 1], strict=True)
    return [
        str(wire.id), span, wire.kind, units.interval(wire.sag, 3), units.interval(wire.span_m),
        units.interval(wire.arc_m), units.interval(wire.p_m, 1), units.length(s) + at_end,
        *(units.interval(Quantity(float(height), float(sigma))) for height, sigma in heights),
    ]  # fmt: skip


def _known(wire: Wire, units: Units) -> list[str]:
    seen, (first, last) = wire.evidence, wire.ends
    return [
        str(wire.id), units.length(seen.residual_across_m, 3), units.length(seen.residual_up_m, 3),
        share(seen.coverage), units.length(seen.longest_gap_m), _end(first), _end(last), seen.source,
        " ".join(wire.notes) or NOTHING,
    ]  # fmt: skip


def _end(end: End) -> str:
    return f"structure {end.structure}" if isinstance(end, Attached) else f"open: {end.reason}"


def clearance_tables(survey: Survey, rows: list[Nearest]) -> list[Table]:
    """A row for each wire and group, those first that need attention; none without any.  Of a long line,
    first the least of each span and group, and all that is not kept."""
    if not rows:
        return []
    if len(rows) <= MOST_ROWS:
        return [_clearances(survey, rows, "")]
    span = {wire.id: (line.id, one.id) for line in survey.lines for one in line.spans for wire in one.wires}
    seen: set[tuple[tuple[int, int], str]] = set()
    short = []
    for one in rows:
        key = (span[one.place.wire], one.to)
        if key not in seen or one.standing in {"short", "doubtful"}:
            short.append(one)
        seen.add(key)
    if len(short) == len(rows):
        return [_clearances(survey, rows, "")]
    return [
        _clearances(survey, short, ""),
        _clearances(survey, rows, f"All {len(rows):,} least clearances, of every wire"),
    ]


def _clearances(survey: Survey, rows: list[Nearest], folded: str) -> Table:
    units = units_of(survey)
    span = numbers_of_spans(survey)
    judged, silent = any(one.standing != "open" for one in rows), any_not_seen(survey)
    upper = any(one.place.at_most for one in rows)
    order = "Nothing is required: give a voltage or a distance to have them judged."
    if judged:
        order = "First those that fall short of what is required, or come nearest to it."
    elif survey.rules is not None:
        order = "They are judged by rule, below."
    cells: list[list[Cell]] = [
        [
            *[verdict_of(one)] * judged, one.to.replace(" ", "\u00a0"), str(one.place.wire),
            span[one.place.wire], one.sign + units.interval(one.distance),
            *[units.length(one.required_m), units.length(one.margin_m)] * judged,
            units.length(one.place.s_m, 1), *[not_seen(survey, one.place.wire) or NOTHING] * silent,
            units.place(shown(survey.frame, one.place.on_wire)),
            units.place(shown(survey.frame, one.place.on_obstacle)),
        ]
        for one in rows
    ]  # fmt: skip
    whole = len(rows) == len(by_need(survey))
    which = "from each wire" if whole else "from the wires of each span, and all that is not kept,"
    return Table(
        [*["verdict"] * judged, "to", "wire", span_head(survey), *units.heads_95("distance"),
         *units.heads("required", "margin") * judged, *units.heads("at"),
         *["not seen at stations"] * silent, f"on the wire {XYZ}", f"on the obstacle {XYZ}"],
        cells,
        f"Least distance in space {which} to each group of things, where along the span (horizontally from "
        f"the wire's first end) and between which points. {order}"
        + " Where stretches were not seen, distances are those to what was seen." * silent
        + " ≤: too little of the air nearer to the wire was seen, so that a plant may be nearer." * upper,
        frozenset({0, 1} if judged else {0}), folded=folded,
    )  # fmt: skip


def protocol(survey: Survey, files: Sequence[str], about_files: Sequence[str]) -> list[tuple[str, str]]:
    """Where the figures come from, as names and values."""
    pairs = [
        ("source", survey.source),
        *survey.made.items(),
        ("unit and place", where(survey)),
        *_in_feet(survey),
        ("conductor temperature", temperature(survey)),
    ]
    required = survey.clearances.requirement if survey.clearances is not None else None
    if required is not None:
        date = f", {required.date}" if required.date else ""
        pairs.append(("required clearance", f"{required.name} ({required.source}{date})"))
    if survey.states is not None:
        known = survey.states.temperature_c
        pairs.append((
            "other states",
            f"conductors at {known.value:.1f} ± {known.half_95:.1f} °C ({CERTAIN}) when surveyed, "
            f"{survey.states.temperature_from}; "
            + "; ".join(f"{kind}: {of}" for kind, of in survey.states.conductors),
        ))  # fmt: skip
    if files:
        pairs.append(("files beside this report", listed(list(files))))
    if about_files:
        pairs.append(("about these files", " ".join(about_files)))
    return pairs


def _in_feet(survey: Survey) -> list[tuple[str, str]]:
    """What is in feet and what is not; nothing where all is in metres."""
    if units_of(survey).unit != "ft":
        return []
    text = "tables and cards in feet (0.3048 m); drawings, coordinates, findings and files in metres"
    return [("units of the report", text)]


def cards(survey: Survey, rows: list[Nearest]) -> list[Card]:
    """The figures to remember: wires, spans, sags and the worst clearance to each group."""
    units, wires = units_of(survey), survey.wires
    found = [Card("wires", str(len(wires)), kinds_of(survey) if wires else "")]
    if wires:
        spans = _with_unit(value_range([wire.span_m for wire in wires], units, 1), units)
        of_lines = f"of {counted(len(survey.lines), 'line')}, " if len(survey.lines) > 1 else ""
        about = f"{of_lines}{spans} long" if spans else f"{of_lines}of unknown length"
        found.append(Card("spans", str(len(survey.spans)), about))
        sags = _with_unit(value_range([wire.sag for wire in wires], units, 2), units)
        found.append(Card("sag", sags or NOTHING, _why(wires) or "of all wires"))
    for one in worst(rows):
        about = f"wire {one.place.wire}, at {units.with_unit(one.place.s_m, 1)}"
        missing = not_seen(survey, one.place.wire)
        about += f"; of its span {missing} not seen" if missing else ""
        about += or_nearer(survey, one.place)
        distance = one.sign + units.interval_with_unit(one.distance)
        verdict = None if one.standing == "open" else verdict_of(one)
        found.append(Card(f"least to {one.to}", distance, about, verdict))
    for crossing in least_crossings(survey)[:1]:
        distance = units.interval_with_unit(Quantity(crossing.distance_m, crossing.sigma_m))
        about = f"wire {crossing.upper} above wire {crossing.lower}"
        found.append(Card("least between crossing lines", distance, about))
    return found


def _with_unit(text: str, units: Units) -> str:
    return f"{text}\u00a0{units.short}" if text else ""


def _why(wires: Sequence[Wire]) -> str:
    """How many wires have no sag, and why; empty where all have one."""
    reasons = [wire.open for wire in wires if wire.open is not None]
    if not reasons:
        return ""
    known = len(wires) - len(reasons)
    parts = [f"of {counted(known, 'wire')}"] if known else []
    for reason in dict.fromkeys(reasons):
        count = reasons.count(reason)
        parts.append(f"{counted(count, 'wire')} {'has' if count == 1 else 'have'} none, because {reason}")
    return "; ".join(parts)
