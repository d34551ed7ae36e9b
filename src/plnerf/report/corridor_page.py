"""The page of a corridor: a plan of all lines, a row for each span with a link to its report, the tasks."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from plnerf.line.clearances import Group
from plnerf.line.ends import Quantity
from plnerf.line.line import Line, Span
from plnerf.line.stations import Stretch, chains
from plnerf.line.survey import Survey
from plnerf.report.figures import NOTHING, Units, counted, runs_of
from plnerf.report.line_tables import structure_table, value_range
from plnerf.report.nearest import limit_sign
from plnerf.report.page import asset, environment
from plnerf.report.plan import plan
from plnerf.report.tables import Table
from plnerf.report.words import kinds_of, name_of, sorted_caveats, where
from plnerf.scene.files import write_text


@dataclass(frozen=True, eq=False)
class SpanPage:
    """The survey of a span's block, and where its report lies."""

    survey: Survey
    link: str
    """From the folder of the page."""


@dataclass(frozen=True)
class SpanRow:
    """What the table says of a span."""

    link: str
    """Empty: the span has no report."""
    number: str
    cells: tuple[str, ...]


def write_corridor_page(
    path: Path, survey: Survey, pages: dict[int, SpanPage], tasks: Table, failed: Sequence[tuple[str, str]],
    files: Sequence[str],
) -> None:  # fmt: skip
    """Writes the page, complete or not at all.

    survey: of the whole corridor; pages: by the numbers of spans; failed: tasks and why they failed; files:
    names of what was written beside it.
    """
    units = Units("ft" if survey.report_units == "feet" else "m")
    main, notes = sorted_caveats(survey, clouds=False)
    page = environment().get_template("corridor.html").render(
        title=f"Corridor of {name_of(survey)}",
        style=asset("page.css"),
        found=_found(survey, units),
        where=where(survey),
        failed=failed,
        caveats=main,
        notes=notes,
        plan=plan(survey),
        columns=_columns(units),
        rows=[
            _row(line, stretch, pages, units)
            for line in survey.lines for chain in chains(line) for stretch in chain
        ],
        structures=structure_table(survey),
        tasks=tasks,
        files=files,
    )  # fmt: skip
    write_text(path, page)


def _found(survey: Survey, units: Units) -> str:
    if not survey.wires:
        return "No wire was found."
    length = sum(stretch.base.length_m for line in survey.lines for one in chains(line) for stretch in one)
    of = f"{counted(len(survey.spans), 'span')} of {counted(len(survey.lines), 'line')}"
    held = counted(len(survey.structures), "structure")
    return f"{kinds_of(survey)} in {of}, {held}; {units.with_unit(length, 0)} of line."


def _columns(units: Units) -> list[str]:
    return [
        "line", "span", "structures", *units.heads("from station", "length"), "wires",
        *units.heads_95("sag", "least height above ground", "least to vegetation", "least to buildings"),
        "too near", *units.heads("not seen"),
    ]  # fmt: skip


def _row(line: Line, stretch: Stretch, pages: dict[int, SpanPage], units: Units) -> SpanRow:
    span = stretch.span
    page = pages.get(span.id)
    first, last = (NOTHING if one is None else str(one) for one in stretch.held)
    return SpanRow(
        page.link if page is not None else "",
        str(span.id),
        (
            str(line.id), f"{first} to {last}", units.length(stretch.from_m, 1),
            units.length(stretch.length_m, 1), runs_of([wire.id for wire in span.wires]),
            value_range([wire.sag for wire in span.wires], units, 2) or NOTHING,
            *_of_block(page, span, units),
        ),
    )  # fmt: skip


def _of_block(page: SpanPage | None, span: Span, units: Units) -> tuple[str, ...]:
    """Least clearances, encroachments and what was not seen."""
    survey = None if page is None else page.survey
    if survey is None or survey.clearances is None:
        return (NOTHING,) * 5
    wires = [one for one in survey.clearances.wires if one.span == span.id]
    upright = [one.vertical for one in wires if one.vertical is not None]
    low = min(upright, key=lambda place: place.distance_m, default=None)
    groups: tuple[Group, ...] = ("vegetation", "structures")
    near = [
        min((place for one in wires if (place := one.least(to)) is not None), key=lambda it: it.distance_m,
            default=None)
        for to in groups
    ]  # fmt: skip
    least = [
        NOTHING
        if place is None
        else limit_sign(place) + units.interval(Quantity(place.distance_m, place.sigma_m))
        for place in (low, *near)
    ]
    records = survey.encroachments
    too_near = NOTHING if records is None else str(sum(one.span == span.id for one in records.records))
    unseen = sum(one.silent_m for one in survey.coverage if one.span == span.id)
    return (*least, too_near, units.length(unseen, 1))


def task_table(rows: Sequence[tuple[str, str, str, str, str, str]]) -> Table:
    """A table of tasks: what, on which block, how it stands, seconds, seconds of processor, memory."""
    return Table(
        ["block", "makes", "state", "seconds", "of processor", "memory,\u00a0MB"],
        [list(row) for row in rows],
        "Memory is the most that the process which did it had held until then.", frozenset({0, 1, 2}),
        folded=f"{counted(len(rows), 'task')} and their time and memory",
    )  # fmt: skip
