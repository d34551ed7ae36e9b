"""Sentences of a report: what was found, where it is, and what a reader must know."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import PurePath

import numpy as np

from plnerf.capture.heights import crs_name
from plnerf.findings import Degree
from plnerf.line.cloud import GROUND
from plnerf.line.line import Line, Span
from plnerf.line.stations import Stretch
from plnerf.line.survey import Survey
from plnerf.line.wire import Wire
from plnerf.report.colours import KINDS
from plnerf.report.figures import CERTAIN, MINUS, Units, counted, listed, runs_of, share, wires_named
from plnerf.report.nearest import Nearest, Standing
from plnerf.report.shown import shows_world, units_of

LEAST_COVERAGE = 0.8
"""A wire with evidence on less of its length gets a caveat."""
LOOSE_SAG = 0.1
"""So does one whose sag is less certain than this, relatively (95 %)."""
STATE = "state of the line"
"""Kind of the finding by which measured clearances say that they are as surveyed."""
OTHER_STATES = "other states"
"""Kind of the findings about these."""
FIGURE = re.compile(r"\d[\d,]*\.\d+|\d+(?=\u00a0%)")
"""Lengths and shares in a sentence; whole numbers may be those of structures."""
DEGREES: tuple[Degree, ...] = ("stops", "harms", "note")


def name_of(survey: Survey) -> str:
    """What was surveyed, briefly: the last part of its path."""
    return PurePath(survey.source).name or survey.source


def number_of(survey: Survey, line: Line, span: Span) -> str:
    """The number of a span, after its line's where there are several lines."""
    return str(span.id) if len(survey.lines) == 1 else f"{line.id} / {span.id}"


def numbers_of_spans(survey: Survey) -> dict[int, str]:
    """The number of every wire's span, by the wire's id."""
    return {
        wire.id: number_of(survey, line, span)
        for line in survey.lines
        for span in line.spans
        for wire in span.wires
    }


def span_head(survey: Survey) -> str:
    """Head of a column of spans' numbers."""
    return "span" if len(survey.lines) == 1 else "line / span"


def length_of(stretch: Stretch, units: Units, digits: int = 1) -> str:
    """The length of a span between its structures, or that it is open: without a structure at one end."""
    length = stretch.length_m
    return "open" if length is None else units.with_unit(length, digits)


def title_of(survey: Survey, line: Line, spans: list[int]) -> str:
    """The heading of some spans, by their numbers."""
    numbers = listed([part.replace("–", " to ") for part in runs_of(spans).split(", ")])
    text = f"span{'s' * (len(spans) > 1)} {numbers}"
    return f"Line {line.id}, {text}" if len(survey.lines) > 1 else text.capitalize()


def found(survey: Survey) -> str:
    """What the survey found, in one sentence."""
    points = counted(len(survey.cloud.xyz), "point")
    if not survey.wires:
        return f"No wire was found among {points}."
    parts = [*_lines(survey), counted(len(survey.structures), "structure"), f"{points} in the cloud"]
    return f"{kinds_of(survey)} in {', '.join(parts)}."


def _lines(survey: Survey) -> list[str]:
    spans = counted(len(survey.spans), "span")
    return [spans] if len(survey.lines) == 1 else [f"{spans} of {counted(len(survey.lines), 'line')}"]


def kinds_of(survey: Survey) -> str:
    """How many wires of each kind there are."""
    kinds = [wire.kind for wire in survey.wires]
    return listed([counted(kinds.count(kind), KINDS[kind][0]) for kind in KINDS if kind in kinds])


def where(survey: Survey) -> str:
    """Unit, axes and position on the earth of the coordinates that the report shows."""
    frame = survey.frame
    if frame.unit == "unscaled":
        return "Units, unscaled, in the survey's own frame, z up; the place on the earth is not known."
    if not shows_world(frame):
        return (
            "Metres in the survey's own frame, z up. The z of the input's coordinates, which the files hold, "
            "is not up."
        )
    if frame.crs is None:
        return "Metres, z up; the place on the earth is not known."
    if frame.origin_lon_lat_height is None:
        return f"Metres; coordinates: {crs_name(frame.crs)}."
    longitude, latitude, height = frame.origin_lon_lat_height
    east, north = "E" if longitude >= 0 else "W", "N" if latitude >= 0 else "S"
    return (
        f"Metres east, north and up of {abs(latitude):.7f}° {north}, {abs(longitude):.7f}° {east}, "
        f"height {height:.2f} m; the survey's reference system: {crs_name(frame.crs)}."
    )


def temperature(survey: Survey) -> str:
    """Of the conductors, or that it is not given."""
    return "not given" if survey.temperature_c is None else f"{survey.temperature_c:g} °C".replace("-", MINUS)


@dataclass(frozen=True)
class Caveat:
    """What a reader must know of one matter."""

    about: str
    """The matter; empty: of the whole survey."""
    texts: tuple[str, ...]


def caveats(survey: Survey) -> list[str]:
    """What is missing or doubtful, a sentence or two each, what concerns all of the survey first."""
    main, notes = sorted_caveats(survey)
    return [text for one in (*main, *notes) for text in one.texts]


def sorted_caveats(survey: Survey, *, clouds: bool = True) -> tuple[list[Caveat], list[Caveat]]:
    """What limits the use of the figures, and notes on what they rest on; each matter once.

    clouds: whether the survey has its own points; those of a corridor lie with its blocks.
    """
    of_all = _of_all(survey)
    found = sorted(survey.findings, key=lambda one: DEGREES.index(one.degree))
    limits = [(one.kind, one.text) for one in found if one.degree != "note" or one.kind == STATE]
    notes = [(one.kind, one.text) for one in found if one.degree == "note" and one.kind != STATE]
    own = [*(_of_ground(survey) if clouds else []), *_of_wires(survey)]
    main = _by_matter([*(("", text) for text in of_all), *limits, *own])
    said = {text for one in main for text in one.texts}
    return main, _by_matter([(kind, text) for kind, text in notes if text not in said])


def _by_matter(pairs: Sequence[tuple[str, str]]) -> list[Caveat]:
    """Texts of one matter together, in the order of the first of each."""
    found: dict[str, list[str]] = {}
    for about, text in pairs:
        some = found.setdefault(about, [])
        some += [text] if text not in some else []
    return [Caveat(about, tuple(texts)) for about, texts in found.items()]


def _of_all(survey: Survey) -> list[str]:
    """What concerns all of the survey."""
    texts = []
    if survey.frame.unit == "unscaled":
        texts.append(
            "Lengths are in units, unscaled: ratios hold, but no distance can be compared with a required "
            "clearance. Give positions or control points for a scale."
        )
    if survey.wires and not any(one.kind == STATE for one in survey.findings):
        texts.append(
            "As surveyed: clearances and sags hold for the conductor temperature and wind at that time "
            f"(temperature: {temperature(survey)}). At their highest temperature conductors hang lower."
        )
    return texts


def _of_ground(survey: Survey) -> list[tuple[str, str]]:
    """A caveat where no ground is known below wires."""
    profiles = [one.profile for one in survey.clearances.wires] if survey.clearances is not None else []
    bare = [one.wire for one in profiles if not np.isfinite(one.ground_z).any()]
    if survey.wires and not (survey.cloud.label == GROUND).any():
        return [("ground", "No ground is known, and so no height above ground.")]
    return [("ground", f"No ground is known below {wires_named(sorted(bare))}.")] if bare else []


def _of_wires(survey: Survey) -> list[tuple[str, str]]:
    """Caveats about the wires themselves."""
    units, texts = units_of(survey), list[tuple[str, str]]()
    doubts: dict[tuple[str, ...], list[tuple[int, str]]] = {}
    for wire in survey.wires:
        for text in _doubts(wire, units):
            doubts.setdefault(tuple(FIGURE.split(text)), []).append((wire.id, text))
    for alike in doubts.values():
        named = wires_named([number for number, _ in alike]).capitalize()
        texts.append(("wires", f"{named}: {merged([text for _, text in alike])}."))
    return texts


def merged(texts: list[str]) -> str:
    """Texts that differ in figures alone as one, with the least and the greatest of each figure."""
    between = FIGURE.split(texts[0])
    text = between[0]
    columns = zip(*(FIGURE.findall(one) for one in texts), strict=True)
    for figures, after in zip(columns, between[1:], strict=True):
        low, high = (pick(figures, key=lambda one: float(one.replace(",", ""))) for pick in (min, max))
        text += (low if low == high else f"{low} to {high}") + after
    return text


def _doubts(wire: Wire, units: Units) -> list[str]:
    """What must be known of one wire; nothing of most."""
    parts = []
    if wire.open is not None:
        parts.append(f"no sag, span length and p, because {wire.open}")
    if not wire.evidence.certain:
        parts.append("what was seen does not fix its place")
    if wire.evidence.coverage < LEAST_COVERAGE:
        parts.append(
            f"evidence on {share(wire.evidence.coverage)} of its length only, with a gap of "
            f"{units.with_unit(wire.evidence.longest_gap_m)}, where the catenary bridges it"
        )
    sag = wire.sag
    if sag is not None and sag.half_95 > LOOSE_SAG * sag.value:
        parts.append(f"its sag is uncertain, {units.interval_with_unit(sag, 3)} ({CERTAIN})")
    return parts + [note[:1].lower() + note[1:].rstrip(".") for note in wire.notes]


def no_states(survey: Survey) -> str:
    """Why there are no other states, and what would give them."""
    if survey.frame.unit == "unscaled":
        return "Without a scale no other state is known."
    said = [one.text for one in survey.findings if one.kind == OTHER_STATES]
    return " ".join(said) or "No other state was computed."


def judged(rows: list[Nearest]) -> str:
    """How many clearances are kept, in one sentence; nothing where none is required."""
    standings = [one.standing for one in rows if one.standing != "open"]
    if not standings:
        return ""
    words: dict[Standing, tuple[str, str]] = {
        "short": ("falls short of it", "fall short of it"),
        "doubtful": ("is within its uncertainty of it", "are within their uncertainty of it"),
        "kept": ("is kept", "are kept"),
    }
    parts = [
        f"{standings.count(kind)} {one if standings.count(kind) == 1 else more}"
        for kind, (one, more) in words.items()
        if kind in standings
    ]
    return f"Of {counted(len(standings), 'clearance')} with a required distance, {listed(parts)}."
