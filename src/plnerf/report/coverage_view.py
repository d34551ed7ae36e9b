"""What was seen along the spans and what was not: tables, and marks in the profile and on the plan."""

import numpy as np
from jaxtyping import Float

from plnerf.line.coverage import Coverage
from plnerf.line.stations import Chain, Stretch
from plnerf.line.survey import Survey
from plnerf.report.figures import NOTHING, Units, share
from plnerf.report.shown import units_of
from plnerf.report.side import TOP, Scale
from plnerf.report.tables import Table
from plnerf.report.words import number_of, span_head

GREY = "#374151"
AIR_OPACITY, GROUND_OPACITY = 0.12, 0.85
"""Of the marks where the air, and where the ground, was not seen."""
STRIP_PX = 8.0
"""Height of the strip above a profile's axis that marks where the ground was not seen."""


def coverage_tables(survey: Survey) -> list[Table]:
    """A row for each span, and folded one for each stretch; none where nothing is known of it."""
    if not survey.coverage:
        return []
    units, numbers = units_of(survey), _numbers(survey)
    spans = [
        [
            numbers[one.line, one.span], units.length(one.length_m, 1), _percent(_mean(one, one.ground)),
            _percent(_mean(one, one.air)), _count(_mean(one, one.images)), units.length(one.silent_m, 1),
            _stations(one, units) or NOTHING,
        ]
        for one in survey.coverage
    ]  # fmt: skip
    rows = [
        [
            numbers[one.line, one.span], f"{units.length(begin, 0)} to {units.length(end, 0)}",
            _percent(ground), _percent(air), _count(images), _what(bool(no_ground), bool(no_air)),
        ]
        for one in survey.coverage
        for begin, end, ground, air, images, no_ground, no_air in zip(
            one.from_m, one.to_m, one.ground, one.air, one.images, one.no_ground, one.no_air, strict=True
        )
    ]  # fmt: skip
    head = span_head(survey)
    least = share(survey.coverage[0].least)
    about = (
        "Ground: share of the area below and beside the wires with points on the ground or on what stands "
        "on it. Air: share of the space from there up to the wires that enough images see; images: how many "
        f"do, the median. A stretch with less than {least} of either counts as not seen: that nothing is "
        "found there does not mean that nothing is there."
    )
    return [
        Table([head, *units.heads("examined"), "ground seen", "air seen", "images",
               *units.heads("not seen"), "not seen at stations"], spans, about, frozenset({6})),
        Table([head, *units.heads("stations"), "ground seen", "air seen", "images", ""], rows,
              "Stretch by stretch.", frozenset({5}), folded="Coverage, stretch by stretch"),
    ]  # fmt: skip


def not_seen(survey: Survey, wire: int) -> str:
    """The stations of the wire's span that were not seen; empty where all were."""
    for line in survey.lines:
        for span in line.spans:
            if any(one.id == wire for one in span.wires):
                found = [one for one in survey.coverage if (one.line, one.span) == (line.id, span.id)]
                return _stations(found[0], units_of(survey)) if found else ""
    return ""


def any_not_seen(survey: Survey) -> bool:
    """Whether any stretch was not seen."""
    return any(one.silent for one in survey.coverage)


def air_on_profile(scale: Scale, survey: Survey, line: int, sheet: Chain) -> list[str]:
    """Grey behind the wires where the air was not seen."""
    return [
        _bar(scale, one, k, float(scale.height), AIR_OPACITY)
        for one in _of(survey, line, sheet)
        for k in np.flatnonzero(one.no_air).tolist()
    ]


def ground_on_profile(scale: Scale, survey: Survey, line: int, sheet: Chain) -> list[str]:
    """A dark strip above the axis where the ground was not seen."""
    return [
        _bar(scale, one, k, STRIP_PX, GROUND_OPACITY)
        for one in _of(survey, line, sheet)
        for k in np.flatnonzero(one.no_ground).tolist()
    ]


def _bar(scale: Scale, one: Coverage, k: int, height: float, opacity: float) -> str:
    """A stretch's bar above the axis."""
    x0, x1 = scale.x(float(one.from_m[k])), scale.x(float(one.to_m[k]))
    y = TOP + scale.height - height
    return (
        f'<rect x="{x0:.1f}" y="{y:.1f}" width="{x1 - x0:.1f}" height="{height:.1f}" fill="{GREY}" '
        f'fill-opacity="{opacity}" class="unseen"/>'
    )


def corridors(survey: Survey, stretch: Stretch, line: int) -> list[tuple[float, Float[np.ndarray, "4 3"]]]:
    """Opacity and corners of the parts of a span's corridor that were not seen, for the plan."""
    wires = np.concatenate([
        stretch.base.local(wire.points(np.linspace(0, wire.base.length_m, 9))) for wire in stretch.span.wires
    ])  # fmt: skip
    low, high = float(wires[:, 1].min()), float(wires[:, 1].max())
    aside = max(2.0, 0.1 * (high - low))
    parts = []
    for one in _of(survey, line, (stretch,)):
        for where, opacity in ((one.no_air, AIR_OPACITY), (one.no_ground, AIR_OPACITY)):
            for k in np.flatnonzero(where):
                s = np.array([one.from_m[k], one.to_m[k], one.to_m[k], one.from_m[k]]) - stretch.from_m
                y = np.array([low - aside, low - aside, high + aside, high + aside])
                parts.append((opacity, stretch.base.place(s, np.stack([y, np.zeros(4)], 1))))
    return parts


def _of(survey: Survey, line: int, sheet: Chain) -> list[Coverage]:
    spans = {one.span.id for one in sheet}
    return [one for one in survey.coverage if one.line == line and one.span in spans]


def _numbers(survey: Survey) -> dict[tuple[int, int], str]:
    return {
        (line.id, span.id): number_of(survey, line, span) for line in survey.lines for span in line.spans
    }


def _mean(one: Coverage, values: Float[np.ndarray, " k"]) -> float:
    """Over the span's length; NaN where none is known."""
    return float(np.average(values, weights=one.to_m - one.from_m))


def _percent(value: float) -> str:
    return share(value) if np.isfinite(value) else NOTHING


def _count(value: float) -> str:
    return f"{value:.0f}" if np.isfinite(value) else NOTHING


def _what(no_ground: bool, no_air: bool) -> str:
    return " and ".join(["ground not seen"] * no_ground + ["air not seen"] * no_air)


def _stations(one: Coverage, units: Units) -> str:
    parts = ", ".join(f"{units.length(begin, 0)} to {units.length(end, 0)}" for begin, end in one.silent)
    return f"{parts}\u00a0{units.short}" if parts else ""
