"""The tables of a report: wires, structures and clearances; its cards and its protocol."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from plnerf.line.ends import Attached, End, Quantity
from plnerf.line.line import Structure
from plnerf.line.survey import Survey
from plnerf.line.wire import Wire
from plnerf.report.figures import CERTAIN, NOTHING, Units, counted, listed, share
from plnerf.report.nearest import Nearest, Standing, worst
from plnerf.report.shown import height_shift, shown
from plnerf.report.words import kinds_of, number_of, temperature, where

SIGNS: dict[Standing, str] = {"short": "✕", "doubtful": "!", "kept": "✓", "open": NOTHING}
"""Before a verdict's words, so that colour is not needed to read it."""
XYZ = "x,\u00a0y,\u00a0z"
"""Head of a column of coordinates, which does not break."""


@dataclass(frozen=True)
class Verdict:
    """A verdict's words and sign; the standing gives its colour."""

    words: str
    standing: Standing

    @property
    def sign(self) -> str:
        """Of its standing."""
        return SIGNS[self.standing]


Cell = str | Verdict


@dataclass(frozen=True)
class Table:
    """Cells by row, and what they mean."""

    columns: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    caption: str
    left: frozenset[int]
    """Columns of words, set left; all others are figures and set right."""


@dataclass(frozen=True)
class Card:
    """A figure to remember."""

    name: str
    value: str
    below: str
    verdict: Verdict | None = None


def wire_tables(survey: Survey) -> list[Table]:
    """What was measured, and how well it is known; none without wires."""
    rows = [
        (wire, number_of(survey, line, span))
        for line in survey.lines
        for span in line.spans
        for wire in span.wires
    ]
    if not rows:
        return []
    units, up = Units(survey.frame.unit), height_shift(survey.frame)
    some_open = any(wire.open for wire, _ in rows)
    measured = Table(
        ["wire", _span_head(survey), "kind", *units.heads_95("sag", "span length", "wire length", "p"),
         *units.heads("lowest at"),
         *units.heads_95("its height", "height of first end", "height of last end"),
         *["no sag, span length and p, because"] * some_open],
        [[*_measured(wire, span, units, up), *[wire.open or NOTHING] * some_open] for wire, span in rows],
        f"Catenaries, with half the width of each length's {CERTAIN} interval. Sag: greatest vertical drop "
        "below the chord between the attachments. p: tension across the load, over load per length. The "
        "lowest point between the ends, by its horizontal distance from the first end and its height z.",
        frozenset({2, 11}),
    )  # fmt: skip
    known = Table(
        ["wire", *units.heads("residual across", "residual up"), "coverage", *units.heads("longest gap"),
         "first end", "last end", "evidence", "notes"],
        [_known(wire, units) for wire, _ in rows],
        "How well each is known. Residuals: root mean square distance of its points, horizontally across the "
        "wire and vertically. Coverage: share of its length with evidence; on the rest the curve bridges a "
        "gap.",
        frozenset({5, 6, 7, 8}),
    )  # fmt: skip
    return [measured, known]


def _span_head(survey: Survey) -> str:
    return "span" if len(survey.lines) == 1 else "line / span"


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


def structure_table(survey: Survey) -> Table | None:
    """Where the structures stand and what shows them; None without any."""
    units = Units(survey.frame.unit)
    named = any(one.name for one in survey.structures)
    several = len(survey.lines) > 1
    rows = [
        [*[str(line.id)] * several, *_structure(one, survey, units), *[one.name or NOTHING] * named]
        for line in survey.lines
        for one in line.structures
    ]
    if not rows:
        return None
    columns = [
        *["line"] * several, "structure", "kind", f"foot {XYZ}", *units.heads_95("along the line"),
        *units.heads("height"), "evidence", *["name"] * named,
    ]  # fmt: skip
    return Table(
        columns, rows,
        "Where each stands: its foot, half the width of the interval of its place along the line, its height "
        "above the foot as far as it is seen, and what shows it.",
        frozenset(k for k, name in enumerate(columns) if name in {"kind", "evidence", "name"}),
    )  # fmt: skip


def _structure(one: Structure, survey: Survey, units: Units) -> list[str]:
    along = Quantity(0.0, one.sigma_m).half_95
    return [
        str(one.id), one.kind, units.place(shown(survey.frame, one.foot)), f"±\u202f{units.length(along)}",
        units.length(one.height_m, 1), one.evidence,
    ]  # fmt: skip


def clearance_table(survey: Survey, rows: list[Nearest]) -> Table | None:
    """A row for each wire and group, those first that need attention; None without any."""
    if not rows:
        return None
    units = Units(survey.frame.unit)
    span = {
        wire.id: number_of(survey, line, one)
        for line in survey.lines
        for one in line.spans
        for wire in one.wires
    }
    judged = any(one.standing != "open" for one in rows)
    order = (
        "First those that fall short of what is required, or come nearest to it."
        if judged
        else "Nothing is required: give a voltage or a distance to have them judged."
    )
    cells: list[list[Cell]] = [
        [
            *[verdict_of(one)] * judged, one.to.replace(" ", "\u00a0"), str(one.place.wire),
            span[one.place.wire], units.interval(one.distance),
            *[units.length(one.required_m), units.length(one.margin_m)] * judged,
            units.length(one.place.s_m, 1), units.place(shown(survey.frame, one.place.on_wire)),
            units.place(shown(survey.frame, one.place.on_obstacle)),
        ]
        for one in rows
    ]  # fmt: skip
    return Table(
        [*["verdict"] * judged, "to", "wire", _span_head(survey), *units.heads_95("distance"),
         *units.heads("required", "margin") * judged, *units.heads("at"), f"on the wire {XYZ}",
         f"on the obstacle {XYZ}"],
        cells,
        "Least distance in space from each wire to each group of things, where along the span (horizontally "
        f"from the wire's first end) and between which points. {order}",
        frozenset({0, 1} if judged else {0}),
    )  # fmt: skip


def verdict_of(one: Nearest) -> Verdict:
    """As the page shows it."""
    return Verdict(one.words, one.standing)


def protocol(survey: Survey, files: Sequence[str], about_files: Sequence[str]) -> list[tuple[str, str]]:
    """Where the figures come from, as names and values."""
    pairs = [
        ("source", survey.source),
        *survey.made.items(),
        ("unit and place", where(survey)),
        ("conductor temperature", temperature(survey)),
    ]
    required = survey.clearances.requirement if survey.clearances is not None else None
    if required is not None:
        date = f", {required.date}" if required.date else ""
        pairs.append(("required clearance", f"{required.name} ({required.source}{date})"))
    if files:
        pairs.append(("files beside this report", listed(list(files))))
    if about_files:
        pairs.append(("about these files", " ".join(about_files)))
    return pairs


def cards(survey: Survey, rows: list[Nearest]) -> list[Card]:
    """The figures to remember: wires, spans, sags and the worst clearance to each group."""
    units, wires = Units(survey.frame.unit), survey.wires
    found = [Card("wires", str(len(wires)), kinds_of(survey) if wires else "")]
    if wires:
        spans = _range([wire.span_m for wire in wires], units, 1)
        found.append(Card("spans", str(len(survey.spans)), f"{spans} long" if spans else "of unknown length"))
        sags = _range([wire.sag for wire in wires], units, 2)
        found.append(Card("sag", sags or NOTHING, _why(wires) or "of all wires"))
    for one in worst(rows):
        about = f"wire {one.place.wire}, at {units.with_unit(one.place.s_m, 1)}"
        distance = units.interval_with_unit(one.distance)
        verdict = None if one.standing == "open" else verdict_of(one)
        found.append(Card(f"least to {one.to}", distance, about, verdict))
    return found


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


def _range(values: Sequence[Quantity | None], units: Units, digits: int) -> str:
    """The least and the greatest, each with its interval; empty where there is none."""
    some = sorted((one for one in values if one is not None), key=lambda one: one.value)
    if not some:
        return ""
    low, high = units.interval(some[0], digits), units.interval(some[-1], digits)
    return f"{low if low == high else f'{low} to {high}'}\u00a0{units.short}"
