"""The tables of a report: conductors, how well each is known, clearances; and the protocol."""

import numpy as np

from plnerf.report.data import Clearance, Report, Standing
from plnerf.report.markup import Markup, facts, joined, table, tag
from plnerf.report.words import (
    CERTAIN,
    NOTHING,
    Units,
    listed,
    share,
    temperature,
    units_of,
    where,
)
from plnerf.survey.fit import CatenaryFit
from plnerf.survey.model import Conductor

SIGNS: dict[Standing, str] = {"short": "✕", "doubtful": "!", "kept": "✓", "open": NOTHING}
"""Beside a verdict's words, so that it is told neither by colour nor by reading alone."""
XYZ = "x,\u00a0y,\u00a0z"
"""Head of a column of places, which does not break."""


def conductor_tables(report: Report) -> Markup:
    """What was measured, and how well it is known; a sentence where no conductor was found."""
    if not report.survey.conductors:
        return tag("p", "No conductor was found, so that there is none to list.", class_="empty")
    units = units_of(report.survey)
    conductors = [one for span in report.spans.values() for one in span]
    measured = table(
        ("id", "span", "kind", *units.heads("span length", "wire length"), units.head_95("sag"),
         *units.heads("p = H/w", "lowest at", "its height", "heights of A / B")),
        [_measured(one, units) for one in conductors],
        f"Catenaries. Sag: greatest drop below the chord between the ends, ± half of its {CERTAIN} interval. "
        "p: horizontal tension over weight per length. The lowest point within the span, by its horizontal "
        "distance from end A and its height z.",
        {2},
    )  # fmt: skip
    known = table(
        ("id", *units.heads("residual across", "residual up"), "coverage", *units.heads("longest gap"),
         "evidence", "note"),
        [_known(one, units) for one in conductors],
        "How well each is known. Residuals: root mean square of its points, horizontally across the wire and "
        "vertically; much more across than up is a wire that wind bows. Coverage: share of the length with "
        "evidence; the rest is the catenary's continuation.",
        {5, 6},
    )  # fmt: skip
    return joined([measured, known])


def _measured(one: Conductor, units: Units) -> list[str]:
    curve = one.fit.curve
    s, z = lowest_within(one.fit)
    at_end = " (end A)" if s == 0 else " (end B)" if s == curve.span_m else ""
    return [
        str(one.id), str(one.span + 1), one.kind, units.length(curve.span_m), units.length(curve.length_m),
        units.known_to(curve.sag_m, one.fit.sag_sigma_m, 3), units.length(curve.p_m, 1),
        units.length(s) + at_end, units.length(z),
        f"{units.length(curve.a[2])} / {units.length(curve.b[2])}",
    ]  # fmt: skip


def _known(one: Conductor, units: Units) -> list[str]:
    return [
        str(one.id), units.length(one.fit.residual_across_m, 3), units.length(one.fit.residual_up_m, 3),
        share(one.coverage), units.length(one.longest_gap_m), one.source, one.note or NOTHING,
    ]  # fmt: skip


def lowest_within(fit: CatenaryFit) -> tuple[float, float]:
    """Horizontal distance from end A and height of the lowest point between the ends."""
    curve = fit.curve
    s = float(np.clip(curve.s0_m, 0.0, curve.span_m))
    return s, float(curve.heights(np.array([s]))[0])


def verdict(one: Clearance) -> Markup:
    """Words and a sign, coloured."""
    sign = tag("b", SIGNS[one.standing], aria_hidden="true")
    return tag("span", sign, " ", one.verdict, class_=f"verdict {one.standing}")


def clearance_table(report: Report) -> Markup:
    """A row for each conductor and class, those first that need attention."""
    units = units_of(report.survey)
    if not report.clearances:
        why = "" if report.survey.unit == "m" else ": without a scale no distance can be one"
        return tag("p", f"No clearance was measured{why}.", class_="empty")
    span = {one.id: one.span + 1 for one in report.survey.conductors}
    rows = [
        [
            verdict(one), one.to, str(one.conductor), str(span[one.conductor]),
            units.known_to(one.distance_m, one.sigma_m), units.length(one.required_m),
            units.length(one.margin_m), units.length(one.place_m, 1), units.place(one.on_wire),
            units.place(one.on_obstacle),
        ]
        for one in report.by_need
    ]  # fmt: skip
    return table(
        ("verdict", "to", "conductor", "span", units.head_95("distance"),
         *units.heads("required", "margin", "at"), f"on the wire {XYZ}", f"on the obstacle {XYZ}"),
        rows,
        "Least distance in space from each conductor to each class, where along the span (horizontally from "
        "end A) and between which points of the world. First those that fall short of what is required, "
        "or come nearest to it.",
        {0, 1},
    )  # fmt: skip


def protocol(report: Report) -> Markup:
    """Where the figures come from, as names and values."""
    survey = report.survey
    pairs = [
        ("source", survey.source),
        *report.made.items(),
        ("unit and place", where(survey)),
        ("conductor temperature", temperature(survey)),
    ]
    if report.files:
        pairs.append(("files beside this report", listed(list(report.files))))
    if report.about_files:
        pairs.append(("about these files", " ".join(report.about_files)))
    return facts(pairs)


def cards(report: Report) -> Markup:
    """The figures to remember, large: conductors, spans, sags and the worst clearance to each class."""
    units, conductors = units_of(report.survey), report.survey.conductors
    sags = [one.fit.curve.sag_m for one in conductors]
    lengths = [one.fit.curve.span_m for one in conductors]
    kinds = [one.kind for one in conductors]
    below = ", ".join(f"{kinds.count(kind)} {kind}" for kind in dict.fromkeys(kinds))
    shown = [_card("conductors", str(len(conductors)), below)]
    if conductors:
        shown.append(_card("spans", str(len(report.spans)), _range(lengths, units, 1) + " long"))
        shown.append(_card("sag", _range(sags, units, 2), "of all conductors"))
    for one in report.worst():
        distance = f"{units.known_to(one.distance_m, one.sigma_m)}\u00a0{units.short}"
        about = f"conductor {one.conductor}, at {units.with_unit(one.place_m, 1)}"
        shown.append(_card(f"least to {one.to}", distance, joined([about, verdict(one)])))
    return tag("div", *shown, class_="cards")


def _card(title: str, value: str, below: str) -> Markup:
    parts = (("name", title), ("value", value), ("below", below))
    return tag("div", *(tag("div", text, class_=kind) for kind, text in parts), class_="card")


def _range(values: list[float], units: Units, digits: int) -> str:
    low, high = units.length(min(values), digits), units.length(max(values), digits)
    return f"{low if low == high else f'{low} to {high}'}\u00a0{units.short}"
