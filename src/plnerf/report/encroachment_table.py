"""Encroachments by priority: a table, a sentence, and parts of photos of the most urgent."""

from collections import Counter

from plnerf.line.encroachments import IN_WORDS, Encroachment
from plnerf.line.survey import Survey
from plnerf.report.figures import AS_THEY_ARE, CERTAIN, NOTHING, counted, listed
from plnerf.report.nearest import STANDINGS
from plnerf.report.possible_view import CropRow, shown_crop
from plnerf.report.shown import shown, units_of
from plnerf.report.tables import XYZ, Cell, Table, Verdict
from plnerf.report.words import numbers_of_spans, span_head

MOST_ROWS = 60
"""Of more encroachments the most urgent come first, and the whole table is folded."""
NAMES = {"vegetation": "plant", "building": "building", "other": "other thing", "line": "crossing wire"}


def encroachment_tables(survey: Survey) -> list[Table]:
    """A row for each, the most urgent first; none without any."""
    found = survey.encroachments
    if found is None or not found.records:
        return []
    if len(found.records) <= MOST_ROWS:
        return [_table(survey, found.records, "")]
    return [
        _table(survey, found.records[:MOST_ROWS], ""),
        _table(survey, found.records, f"All {len(found.records):,} encroachments"),
    ]


def encroachment_summary(survey: Survey) -> str:
    """How many there are of each priority, in one sentence; empty where nothing is required."""
    found = survey.encroachments
    if found is None:
        return ""
    if not found.records:
        return "No encroachment was found of what was examined."
    counts = Counter(one.priority for one in found.records)
    parts = [f"{counts[number]} {words}" for number, words in IN_WORDS.items() if counts[number]]
    return f"{counted(len(found.records), 'encroachment')}: {listed(parts)}."


def about_encroachments(survey: Survey) -> str:
    """What was required, and what was not examined and why."""
    found = survey.encroachments
    if found is None:
        return "Nothing is required: give a voltage, a distance or rules to have encroachments listed."
    return f"Required by {listed(list(found.required))}. {' '.join(found.not_examined)}"


def encroachment_crops(survey: Survey) -> list[CropRow]:
    """Of the most urgent, parts of photos with a ring around the place that is nearest to the wire."""
    found = survey.encroachments
    if found is None:
        return []
    units = units_of(survey)
    return [
        CropRow(
            f"{one.id}: {NAMES[one.object]}, {units.interval_with_unit(one.radial)} from wire {one.wire} as "
            "surveyed",
            tuple(shown_crop(crop) for crop in survey.encroachment_crops if crop.of == k),
        )
        for k, one in enumerate(found.records)
        if any(crop.of == k for crop in survey.encroachment_crops)
    ]


def _table(survey: Survey, records: tuple[Encroachment, ...], folded: str) -> Table:
    units, span = units_of(survey), numbers_of_spans(survey)
    some_growth = any(each.years for one in records for each in one.approaches)
    rows: list[list[Cell]] = []
    for one in records:
        first = one.first
        names = f"{one.wire}, {one.other_wire}" if one.other_wire is not None else str(one.wire)
        years = next((each.years for each in one.approaches if each.years), None)
        rows.append([
            str(one.id), Verdict(first.way, STANDINGS[first.verdict]), first.state, NAMES[one.object],
            span[one.wire], names, units.length(one.station_m, 1), units.interval(first.distance),
            units.length(first.required_m), *[AS_THEY_ARE.interval(years, 1)] * some_growth,
            units.interval(one.radial), units.interval(one.vertical), units.interval(one.horizontal),
            units.length(one.height_m, 1), ", ".join(one.ways[1:]) or NOTHING,
            units.place(shown(survey.frame, one.highest)),
        ])  # fmt: skip
    groups, last = {}, 0
    for k, one in enumerate(records):
        if one.priority != last:
            groups[k], last = f"Priority {one.priority}: {IN_WORDS[one.priority]}", one.priority
    columns = [
        "", "how", "state", "what", span_head(survey), "wire", *units.heads("station"),
        *units.heads_95("comes to"), *units.heads("required"),
        *[f"years until then ±\u00a0{CERTAIN}"] * some_growth,
        *units.heads_95("in space", "vertical", "in plan"), *units.heads("height"), "also",
        f"highest point {XYZ}",
    ]  # fmt: skip
    also = len(columns) - 2
    return Table(
        columns, rows,
        "Every object that comes nearer to a phase conductor than required, or whose distance is within its "
        "uncertainty of it (!), once, the most urgent first. Comes to: the distance in the way and the state "
        "named, below 0 where a falling tree reaches beyond the wire. In space, vertical, in plan: between "
        "it and its nearest wire as surveyed. Fall-in: the tree tilts about its foot straight at the wire. "
        "Also: further ways.",
        frozenset({1, 2, 3, also}), groups, folded,
    )  # fmt: skip
