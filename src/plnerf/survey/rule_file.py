"""A matrix of clearances out of a TOML file: rows by class of object, direction and kind of state, with their
distances by voltage class.

    required = distance[class] + terms      a term by class (EN 50341's D_el), or by the voltage (NESC)

Classes are never interpolated.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from plnerf.errors import ConfigError
from plnerf.line.rules import DIRECTIONS, OBJECTS, STATE_KINDS, Direction, Rule, RuleObject, StateKind
from plnerf.scene.toml_files import Fields, read_toml

FOLDER = "rules"
"""In the package's data."""
METRES = {"ft": 0.3048, "m": 1.0}
MEASURED: dict[RuleObject, tuple[Direction, ...]] = {
    "ground": ("vertical", "radial"),
    "road": ("vertical", "horizontal"),
    "rail": ("vertical", "horizontal"),
    "water": ("vertical", "horizontal"),
    "line": ("vertical", "radial"),
}
"""Directions in which there is a distance to what is no body of points; to all else in every direction."""


@dataclass(frozen=True)
class Term:
    """A part of a distance that depends on the voltage."""

    name: str
    distance_m: tuple[float | None, ...] | None
    """In the order of the matrix's classes, or one number for all; None: it is by the voltage itself."""
    m_per_kv: float
    above_kv: float
    highest_share: float
    """The highest voltage over the nominal one."""
    read_in: str
    verified: bool

    def metres(self, kv: float, number: int | None) -> float | None:
        """At a nominal voltage, which is the class of a number; None: it has none."""
        if self.distance_m is not None:
            return _of_class(self.distance_m, number)
        to_ground = kv * self.highest_share / math.sqrt(3)
        return self.m_per_kv * max(to_ground - self.above_kv, 0.0)


@dataclass(frozen=True)
class Row:
    """A row as the file has it."""

    number: int
    object: RuleObject
    direction: Direction
    states: tuple[StateKind, ...]
    distance_m: tuple[float | None, ...]
    """In the order of the classes, or one number for all; None: nothing is required."""
    terms: tuple[Term, ...]
    read_in: str
    verified: bool
    note: str
    area: str
    """Where it applies; empty: everywhere."""
    up_to_m: float | None
    """Of altitude; None: at any."""


@dataclass(frozen=True)
class Matrix:
    """A file's content."""

    path: str
    name: str
    source: str
    date: str
    caveats: tuple[str, ...]
    classes_kv: tuple[float, ...]
    """Nominal; empty: any voltage."""
    kv_between: tuple[float, float]
    """Where there are no classes."""
    rows: tuple[Row, ...]

    def rule(self, row: Row, kv: float) -> Rule | None:
        """A row at a voltage; None where nothing is required there.  Raises ConfigError for a voltage that is
        no class of the matrix."""
        number = self.number_of(kv)
        own = _of_class(row.distance_m, number)
        parts = [term.metres(kv, number) for term in row.terms]
        if own is None or None in parts:
            return None
        added = [part for part in parts if part is not None]
        words = [f"{own:.2f} m"]
        words += [f"{m:.2f} m ({term.name})" for m, term in zip(added, row.terms, strict=True)]
        read = dict.fromkeys([row.read_in, *(term.read_in for term in row.terms)])
        return Rule(
            row.number, row.object, row.direction, row.states, own + sum(added), " + ".join(words),
            "; ".join(read), row.verified and all(term.verified for term in row.terms), row.note,
        )  # fmt: skip

    def check_areas(self, areas: Sequence[str]) -> None:
        """Raises ConfigError for one that no row is for."""
        known = sorted({row.area for row in self.rows} - {""})
        strange = [area for area in areas if area not in known]
        if strange:
            raise ConfigError(
                f"{self.path} has no rules for the area {strange[0]!r}, but for {', '.join(known) or 'none'}."
            )

    def number_of(self, kv: float) -> int | None:
        """The number of a class; None where the matrix has none.  Raises ConfigError for a voltage that it
        is not for."""
        low, high = self.kv_between
        if not self.classes_kv:
            if not low <= kv <= high:
                raise ConfigError(
                    f"{self.path} is for {low:g} to {high:g} kV (nominal), got {kv:g} kV. Give a matrix that "
                    "is for this voltage."
                )
            return None
        if kv not in self.classes_kv:
            classes = ", ".join(f"{one:g}" for one in self.classes_kv)
            raise ConfigError(
                f"{self.path} has no class of {kv:g} kV. Its classes are {classes} kV (nominal), and none is "
                "interpolated. Give --voltage-kv one of them, or a matrix of your own."
            )
        return self.classes_kv.index(kv)


def _of_class(distance_m: tuple[float | None, ...], number: int | None) -> float | None:
    """Of one number for each class or one for all; None where nothing is required."""
    return distance_m[0] if len(distance_m) == 1 or number is None else distance_m[number]


def load_matrix(path: Path) -> Matrix:
    """Reads a matrix from a TOML file of the form of `data/rules/`, or by the name of one of these.

    Raises ConfigError where there is no such file, or it lacks a value or has one that cannot be.
    """
    fields = Fields(read_toml(path, FOLDER, "rule"), f"The rule file {path}")
    name, source, date = (fields.text(key) for key in ("name", "source", "date"))
    metres = METRES[fields.one_of("unit", METRES, "m")]
    classes = fields.floats("classes_kv")
    between = fields.floats("kv_between") or (1.0, 1500.0)
    caveats = fields.texts("caveats")
    if len(between) != 2 or not 0 < between[0] < between[1] or any(kv <= 0 for kv in classes):
        raise ConfigError(f"The rule file {path} needs voltages that are greater than 0, in rising order.")
    terms = {
        key: _term(key, values, len(classes), metres, path)
        for key, values in (fields.table("term") or {}).items()
    }
    rows = tuple(
        _row(number, values, terms, len(classes), metres, path)
        for number, values in enumerate(fields.tables("row"), 1)
    )
    fields.done()
    return Matrix(str(path), name, source, date, caveats, classes, (between[0], between[1]), rows)


def _row(
    number: int, values: dict[str, Any], terms: dict[str, Term], classes: int, metres: float, path: Path
) -> Row:
    where = f"Row {number} of {path}"
    fields = Fields(values, where)
    names = fields.texts("plus")
    strange = [name for name in names if name not in terms]
    if strange:
        raise ConfigError(f"{where} adds {', '.join(strange)}, but the file has no [term.{strange[0]}].")
    of = cast(RuleObject, fields.one_of("object", OBJECTS))
    found = Row(
        number=number,
        object=of,
        direction=cast(Direction, fields.one_of("direction", MEASURED.get(of, DIRECTIONS))),
        states=_states(fields.texts("states") or STATE_KINDS, where),
        distance_m=_distances(fields, "distance", classes, metres, where),
        terms=tuple(terms[name] for name in names),
        read_in=fields.text("read_in"),
        verified=fields.flag("verified", False),
        note=fields.text("note") if fields.has("note") else "",
        area=fields.text("area") if fields.has("area") else "",
        up_to_m=fields.number("altitude_up_to") * metres if fields.has("altitude_up_to") else None,
    )
    fields.done()
    return found


def _states(names: Sequence[str], where: str) -> tuple[StateKind, ...]:
    strange = [name for name in names if name not in STATE_KINDS]
    if strange:
        raise ConfigError(
            f"{where} is for the states {', '.join(strange)}, but knows only {', '.join(STATE_KINDS)}."
        )
    return tuple(cast(StateKind, name) for name in names)


def _term(key: str, values: Any, classes: int, metres: float, path: Path) -> Term:
    where = f"[term.{key}] of {path}"
    fields = Fields(values if isinstance(values, dict) else {}, where)
    by_class = _distances(fields, "distance", classes, metres, where) if fields.has("distance") else None
    found = Term(
        name=fields.text("name", key),
        distance_m=by_class,
        m_per_kv=0.0 if by_class else fields.number("per_kv", above=0.0) * metres,
        above_kv=0.0 if by_class else fields.number("above_kv", least=0.0),
        highest_share=fields.number("highest_share", 1.0, least=1.0, most=1.5),
        read_in=fields.text("read_in"),
        verified=fields.flag("verified", False),
    )
    fields.done()
    return found


def _distances(
    fields: Fields, name: str, classes: int, metres: float, where: str
) -> tuple[float | None, ...]:
    """One number, or one for each class, of which "none" is no requirement."""
    found = fields.numbers_or(name, "none")
    if len(found) not in {1, classes}:
        raise ConfigError(f"{where} has {len(found)} distances for {classes} classes of voltage.")
    if any(one is not None and not one > 0 for one in found):
        raise ConfigError(f"{where} has distances that are not greater than 0.")
    return tuple(None if one is None else one * metres for one in found)
