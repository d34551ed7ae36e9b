"""Tables of what a line is made of: its spans, its structures, and where it crosses another."""

from collections.abc import Sequence

from plnerf.line.clearances import Crossing
from plnerf.line.ends import Attached, Open, Quantity
from plnerf.line.line import Line, Structure
from plnerf.line.stations import Stretch, azimuth_deg, chains, structure_stations
from plnerf.line.survey import Survey
from plnerf.line.wire import Wire
from plnerf.report.figures import AS_THEY_ARE, CERTAIN, NOTHING, Units, degrees, listed, runs_of, wires_named
from plnerf.report.shown import shown, units_of
from plnerf.report.tables import XYZ, Table
from plnerf.report.words import length_of, number_of, numbers_of_spans, span_head


def span_table(survey: Survey) -> Table | None:
    """A row for each span; None without any."""
    units = units_of(survey)
    rows = [
        _span(survey, line, one, units) for line in survey.lines for chain in chains(line) for one in chain
    ]
    if not rows:
        return None
    columns = [
        span_head(survey), "structures",
        *units.heads("from station", "length"), "direction", "wires", *units.heads_95("sag"),
        f"swing,\u00a0° ±\u00a0{CERTAIN}", "open ends",
    ]  # fmt: skip
    return Table(
        columns, rows,
        "Stations count along each line from its first structure; lengths are horizontal, from structure to "
        "structure; a dash: no structure is seen at one end. Direction: clockwise from "
        f"{'north' if survey.frame.crs else 'the y axis'}. Sag and swing: the least and the greatest of the "
        "span's wires. Swing: the angle of the load about the span, to the left of its direction where "
        f"positive; a dash: the wires were taken to hang straight down.{_why_open(survey)}",
        frozenset({0, 1, 5, 8}),
    )  # fmt: skip


def _span(survey: Survey, line: Line, one: Stretch, units: Units) -> list[str]:
    wires = one.span.wires
    first, last = (NOTHING if id_ is None else str(id_) for id_ in one.held)
    # Wires may run against the chain: then their swing is to the other side of it.
    swings = [_turned(wire, one) for wire in wires]
    return [
        number_of(survey, line, one.span), f"{first} to {last}", units.length(one.from_m, 1),
        units.length(one.length_m, 1), degrees(azimuth_deg(survey.frame, one.base), 1),
        runs_of([wire.id for wire in wires]), value_range([wire.sag for wire in wires], units, 2) or NOTHING,
        value_range(swings, AS_THEY_ARE, 1) or NOTHING, open_ends(wires) or NOTHING,
    ]  # fmt: skip


def _turned(wire: Wire, one: Stretch) -> Quantity | None:
    swing = wire.swing_deg
    if swing is None or wire.base.u @ one.base.u >= 0:
        return swing
    return Quantity(-swing.value, swing.sigma)


def open_ends(wires: Sequence[Wire]) -> str:
    """Which ends of the wires are open; empty where all are held."""
    found = {
        name: [wire.id for wire in wires if not isinstance(wire.ends[k], Attached)]
        for k, name in enumerate(("first", "last"))
    }
    open_ = {name: ids for name, ids in found.items() if ids}
    if all(len(ids) == len(wires) for ids in open_.values()):
        return " and ".join(open_)
    return "; ".join(f"{name} ({wires_named(ids)})" for name, ids in open_.items())


def _why_open(survey: Survey) -> str:
    """A sentence with every reason for which ends of wires are open, each once; empty where none is."""
    ends = (end for wire in survey.wires for end in wire.ends)
    reasons = list(dict.fromkeys(end.reason for end in ends if isinstance(end, Open)))
    return f" Why ends are open: {'; '.join(reasons)}." if reasons else ""


def structure_table(survey: Survey) -> Table | None:
    """Where the structures stand and what shows them; None without any."""
    units = units_of(survey)
    named = any(one.name for one in survey.structures)
    several = len(survey.lines) > 1
    rows = []
    for line in survey.lines:
        stations = structure_stations(line)
        for one in line.structures:
            cells = _structure(one, stations.get(one.id), survey, units)
            rows.append([*[str(line.id)] * several, *cells, *[one.name or NOTHING] * named])
    if not rows:
        return None
    columns = [
        *["line"] * several, "structure", *units.heads("station"), "kind", "line angle", f"foot {XYZ}",
        *units.heads_95("along the line"), *units.heads("height"), "evidence", *["name"] * named,
    ]  # fmt: skip
    return Table(
        columns, rows,
        "Where each stands: its station, by how much the line turns there, its foot, half the width of the "
        "interval of its place along the line, its height above the foot as far as it is seen, and what "
        "shows it.",
        frozenset(k for k, name in enumerate(columns) if name in {"kind", "evidence", "name"}),
    )  # fmt: skip


def _structure(one: Structure, station: float | None, survey: Survey, units: Units) -> list[str]:
    along = Quantity(0.0, one.sigma_m).half_95
    return [
        str(one.id), units.length(station, 1), one.kind, degrees(one.line_angle_deg),
        units.place(shown(survey.frame, one.foot)), f"±\u202f{units.length(along)}",
        units.length(one.height_m, 1), one.evidence,
    ]  # fmt: skip


def crossing_table(survey: Survey) -> Table | None:
    """The nearest wires of every two spans that cross; None where no lines do."""
    least = least_crossings(survey)
    if not least:
        return None
    units = units_of(survey)
    number = numbers_of_spans(survey)
    rows = [
        [
            number[one.upper], str(one.upper), number[one.lower], str(one.lower),
            units.interval(Quantity(one.distance_m, one.sigma_m)), units.length(one.vertical_m),
            units.place(shown(survey.frame, one.on_upper)), units.place(shown(survey.frame, one.on_lower)),
        ]
        for one in least
    ]  # fmt: skip
    return Table(
        ["above: line / span", "wire", "below: line / span", "wire below", *units.heads_95("distance"),
         *units.heads("straight down"), f"on the upper {XYZ}", f"on the lower {XYZ}"],
        rows,
        "Where one line crosses over another: of every two spans, the wires that come nearest to each other, "
        "as surveyed. Nothing is required of these distances here.",
        frozenset({0, 2}),
    )  # fmt: skip


def least_crossings(survey: Survey) -> list[Crossing]:
    """The nearest crossing of every two spans."""
    span = {wire.id: (line.id, one.id) for line in survey.lines for one in line.spans for wire in one.wires}
    found: dict[tuple[tuple[int, int], tuple[int, int]], Crossing] = {}
    for one in survey.clearances.crossings if survey.clearances is not None else ():
        found.setdefault((span[one.upper], span[one.lower]), one)
    return list(found.values())


def value_range(values: Sequence[Quantity | None], units: Units, digits: int) -> str:
    """The least and the greatest, each with its interval; empty where there is none."""
    some = sorted((one for one in values if one is not None), key=lambda one: one.value)
    if not some:
        return ""
    low, high = units.interval(some[0], digits), units.interval(some[-1], digits)
    return low if low == high else f"{low} to {high}"


def span_headings(survey: Survey) -> list[tuple[int, str]]:
    """How many wires each span has, and what stands before them in a table, in the order of the wires; empty
    of a single span."""
    spans = [(line, span) for line in survey.lines for span in line.spans if span.wires]
    if len(spans) < 2:
        return []
    units, found = units_of(survey), []
    stretches = {id(one.span): one for line in survey.lines for chain in chains(line) for one in chain}
    for line, span in spans:
        one = stretches[id(span)]
        held = [str(id_) for id_ in one.held if id_ is not None]
        between = f"structure{'s' * (len(held) > 1)} {listed(held)}" if held else "no structure is seen"
        several = f"Line {line.id}, span {span.id}" if len(survey.lines) > 1 else f"Span {span.id}"
        found.append((len(span.wires), f"{several}: {between}, {length_of(one, units)}"))
    return found
