"""Figures and sentences of a report: lengths with their unit, what was found, and what a reader must know."""

from dataclasses import dataclass
from pathlib import PurePath
from typing import Literal

import numpy as np

from plnerf.report.data import TWO_SIDED_95, Report
from plnerf.survey.model import GROUND, Conductor, Survey

LEAST_COVERAGE = 0.8
"""A conductor with evidence on less of its length gets a caveat."""
LOOSE_SAG = 0.1
"""So does one whose sag is known worse than this, relatively."""
TYPICAL_M = 60.0
"""Of a span, whose figures have the usual decimals."""
NOTHING = "–"
CERTAIN = "95\u00a0%"
"""Of the intervals behind all ± in a report."""
PLUS_MINUS, MINUS = "\u202f±\u202f", "−"


@dataclass(frozen=True)
class Units:
    """How lengths are written."""

    unit: Literal["m", "unscaled"]
    further: int = 0
    """Decimals more than metres get, or less."""

    @property
    def short(self) -> str:
        """Behind a figure."""
        return "m" if self.unit == "m" else "units"

    def length(self, value: float | None, digits: int = 2) -> str:
        """A length, with so many decimals in metres."""
        if value is None or not np.isfinite(value):
            return NOTHING
        return f"{value:,.{max(0, digits + self.further)}f}".replace("-", MINUS)

    def with_unit(self, value: float | None, digits: int = 2) -> str:
        """The same with its unit behind."""
        text = self.length(value, digits)
        return text if text == NOTHING else f"{text}\u00a0{self.short}"

    def known_to(self, value: float, sigma: float | None, digits: int = 2) -> str:
        """A length and the half width of its 95 % interval."""
        if sigma is None or not np.isfinite(sigma):
            return f"{self.length(value, digits)}{PLUS_MINUS}?"
        return f"{self.length(value, digits)}{PLUS_MINUS}{self.length(TWO_SIDED_95 * sigma, digits)}"

    def heads(self, *names: str) -> list[str]:
        """Heads of columns with lengths."""
        return [f"{name},\u00a0{self.short}" for name in names]

    def head_95(self, name: str) -> str:
        """Head of a column with lengths and their 95 % intervals."""
        return f"{name},\u00a0{self.short} ±\u00a0{CERTAIN}"

    def place(self, xyz: np.ndarray) -> str:
        """Coordinates of a world point, without separators so that they can be copied."""
        return ", ".join(f"{value:.{max(0, 2 + self.further)}f}" for value in xyz)


def units_of(survey: Survey) -> Units:
    """Decimals of an unscaled survey are those that it would have if its longest span were TYPICAL_M."""
    if survey.unit == "m":
        return Units("m")
    extents = [one.fit.curve.span_m for one in survey.conductors]
    extents += np.ptp(survey.cloud.xyz, axis=0).tolist() if len(survey.cloud.xyz) and not extents else []
    return Units("unscaled", round(np.log10(TYPICAL_M / max(extents, default=TYPICAL_M))))


def counted(count: int, noun: str) -> str:
    """ "1 span", "2 spans", "no spans"."""
    return f"{count:,} {noun}{'s' * (count != 1)}" if count else f"no {noun}s"


def share(part: float) -> str:
    """Per cent."""
    return f"{100 * part:.0f}\u00a0%"


def listed(parts: list[str]) -> str:
    """ "1, 2 and 3"."""
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"


def name_of(survey: Survey) -> str:
    """What was surveyed, briefly: the last part of its path."""
    return PurePath(survey.source).name or survey.source


def found(report: Report) -> str:
    """What the survey found, in one sentence."""
    survey = report.survey
    if not survey.conductors:
        return f"No conductor was found among {counted(len(survey.cloud.xyz), 'point')}."
    kinds = [one.kind for one in survey.conductors]
    nouns = {"phase": "phase conductor", "shield": "shield wire"}
    parts = [counted(kinds.count(kind), noun) for kind, noun in nouns.items() if kind in kinds]
    return (
        f"{listed(parts)} in {counted(len(report.spans), 'span')}, {counted(len(survey.towers), 'tower')}, "
        f"{counted(len(survey.cloud.xyz), 'classified point')}."
    )


def where(survey: Survey) -> str:
    """Unit and place on the earth, in words."""
    if survey.unit == "unscaled":
        return "Units, unscaled; the place on the earth is not known."
    if survey.crs is None:
        return "Metres, z up; the place on the earth is not known."
    if survey.origin is None:
        return f"Metres; coordinates and heights of {survey.crs}."
    longitude, latitude, height = survey.origin
    east, north = "E" if longitude >= 0 else "W", "N" if latitude >= 0 else "S"
    return (
        f"Metres east, north and up of {abs(latitude):.7f}° {north}, {abs(longitude):.7f}° {east}, "
        f"{height:.2f} m above the WGS 84 ellipsoid; the survey's reference system is {survey.crs}."
    )


def temperature(survey: Survey) -> str:
    """Of the conductors, or that it is not given."""
    return "not given" if survey.temperature_c is None else f"{survey.temperature_c:g} °C".replace("-", MINUS)


def caveats(report: Report) -> list[str]:
    """What is missing or doubtful, a sentence or two each, what concerns all of the survey first."""
    survey, units = report.survey, units_of(report.survey)
    texts = []
    if survey.unit == "unscaled":
        texts.append(
            "Lengths are in units, unscaled: ratios hold, but no distance can be compared with a required "
            "clearance. Give positions or control points for a scale."
        )
    if survey.conductors:
        texts.append(
            "As surveyed: clearances and sags hold for the conductor temperature and wind at that time "
            f"(temperature: {temperature(survey)}). At their highest temperature conductors hang lower."
        )
    texts += survey.notes
    bare = [one.conductor for one in report.profiles if not np.isfinite(one.ground_m).any()]
    if survey.conductors and not (survey.cloud.label == GROUND).any():
        texts.append("No ground is known: heights above ground cannot be told.")
    elif bare:
        texts.append(f"No ground is known below {_conductors(sorted(bare))}.")
    doubts: dict[str, list[int]] = {}
    for one in survey.conductors:
        doubts.setdefault(_doubts(one, units), []).append(one.id)
    named = [f"{_conductors(ids).capitalize()}: {text}." for text, ids in doubts.items() if text]
    return texts + named


def _doubts(one: Conductor, units: Units) -> str:
    """What must be known of one conductor; nothing of most."""
    parts = []
    if one.coverage < LEAST_COVERAGE:
        parts.append(
            f"evidence on {share(one.coverage)} of its length only, with a gap of "
            f"{units.with_unit(one.longest_gap_m)}, where it is the catenary's continuation"
        )
    if TWO_SIDED_95 * one.fit.sag_sigma_m > LOOSE_SAG * one.fit.curve.sag_m:
        sag = units.known_to(one.fit.curve.sag_m, one.fit.sag_sigma_m, 3)
        parts.append(f"its sag is known loosely, {sag} {units.short} ({CERTAIN})")
    if one.note:
        parts.append(one.note.rstrip("."))
    return "; ".join(parts)


def judged(report: Report) -> str:
    """How many clearances are kept, in one sentence; nothing where none is required."""
    standings = [one.standing for one in report.clearances if one.standing != "open"]
    if not standings:
        return ""
    words = {
        "short": ("falls short of it", "fall short of it"),
        "doubtful": ("is too near to it to tell", "are too near to it to tell"),
        "kept": ("is kept", "are kept"),
    }
    parts = [
        f"{standings.count(kind)} {one if standings.count(kind) == 1 else more}"
        for kind, (one, more) in words.items()
        if kind in standings
    ]
    return f"Of {counted(len(standings), 'clearance')} with a required distance, {listed(parts)}."


def _conductors(ids: list[int]) -> str:
    return f"conductor{'s' if len(ids) > 1 else ''} {listed([str(one) for one in ids])}"
