"""The clearance that a conductor must keep: given by the user, or out of a table with its source.

A table is a TOML file (`data/clearances/`, or the user's own in the same form): distances by voltage class
and band of altitude.  Classes are never interpolated, because insulation is designed anew for each.
"""

import math
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

from plnerf.errors import SurveyError
from plnerf.line.clearances import GROUPS, Group, Requirement
from plnerf.line.survey import Survey
from plnerf.scene.toml_files import toml_of
from plnerf.survey.altitude import Altitude, altitude_of

METRES = {"ft": 0.3048, "m": 1.0}
"""Length of the units that a table may have."""
TABLES = files("plnerf") / "data" / "clearances"
DEFAULT_TABLE = "nerc-fac-003-5.toml"
_KEYS = ("name", "source", "date", "applies_to", "unit", "altitude_up_to", "caveats", "class")


class AboveTableError(SurveyError):
    """The line lies, or may lie, above the altitudes of a table."""


@dataclass(frozen=True)
class Table:
    """Distances in metres by nominal voltage (kV), for bands of altitude."""

    path: str
    name: str
    source: str
    date: str
    applies_to: tuple[Group, ...]
    caveats: tuple[str, ...]
    up_to_m: tuple[float, ...]
    """Upper bound of each band, which belongs to it."""
    distances_m: dict[float, tuple[float, ...]]
    in_force: str = ""
    """Whether the standard is in force, from when on and until when, as a sentence."""

    def of_class(self, voltage_kv: float) -> tuple[float, ...]:
        """Distances by band of altitude.  Raises SurveyError for a voltage that is no class of the table."""
        distances = self.distances_m.get(voltage_kv)
        if distances is None:
            classes = ", ".join(f"{nominal:g}" for nominal in sorted(self.distances_m))
            raise SurveyError(
                f"{self.path} has no class of {voltage_kv:g} kV. Its classes are {classes} kV (nominal), and "
                "none is interpolated. Give one of them, a table of your own, or the distance itself in "
                "metres."
            )
        return distances


def own_requirement(distance_m: float) -> Requirement:
    """A distance given by the user, to be kept from everything.  Raises SurveyError unless it is positive."""
    if not 0 < distance_m < float("inf"):
        raise SurveyError(
            f"The clearance to be kept must be greater than 0 m, got {distance_m}. Give it in metres."
        )
    return Requirement(distance_m, GROUPS, f"{distance_m:g} m", "given by the user")


def required_clearance(voltage_kv: float, altitude: Altitude, table: Table) -> Requirement:
    """The greatest distance that a table asks for at a nominal voltage, of the bands in which a line may be.

    Raises SurveyError for a voltage that is no class of the table, AboveTableError where the line may be
    above its bands.
    """
    distances = table.of_class(voltage_kv)
    bands = [_band(table, bound) for bound in (altitude.low_m, altitude.high_m)]
    if bands[1] == len(table.up_to_m):
        raise _above(table, altitude)
    band = max(range(bands[0], bands[1] + 1), key=lambda k: distances[k])
    caveats = [table.in_force] * bool(table.in_force)
    if altitude.why:
        counts = (
            f"the greatest distance of the {bands[1] - bands[0] + 1} bands between them counts"
            if bands[0] < bands[1]
            else "these are in one band"
        )
        caveats.append(
            f"The altitude above the sea is known to be {altitude.words} only, since {altitude.why}: "
            f"{counts}."
        )
    return Requirement(
        distances[band],
        table.applies_to,
        f"{table.name}: {voltage_kv:g} kV, up to {table.up_to_m[band]:.0f} m above sea level",
        table.source,
        table.date,
        (*caveats, *table.caveats),
    )


def _band(table: Table, altitude_m: float) -> int:
    """The number of the band that an altitude is in; that of the bands where it is above all."""
    return sum(altitude_m > bound for bound in table.up_to_m)


def _above(table: Table, altitude: Altitude) -> AboveTableError:
    why = f" ({altitude.why})" if altitude.why else ""
    return AboveTableError(
        f"{table.path} goes up to {table.up_to_m[-1]:.0f} m above sea level, but the line is at "
        f"{altitude.words}{why}, where air insulates less. Give a table of your own, or the distance itself "
        "in metres."
    )


def check_altitude(
    lowest: Altitude, voltage_kv: float | None, thresholds: Path | None, clearance_m: float | None
) -> None:
    """Raises AboveTableError where even the lowest altitude that the line may have is above the table: before
    a line is surveyed."""
    if voltage_kv is None or clearance_m is not None:
        return
    table = load_table(thresholds)
    if _band(table, lowest.low_m) == len(table.up_to_m):
        raise _above(table, lowest)


def check_required(voltage_kv: float | None, thresholds: Path | None, clearance_m: float | None) -> None:
    """Raises SurveyError for a voltage that the table does not have, a table that is none or that no voltage
    is given for, and a clearance that is not positive: before a line is surveyed."""
    if thresholds is not None and voltage_kv is None and clearance_m is None:
        raise SurveyError(
            f"The table {thresholds} has distances by voltage, but no voltage is given. Give --voltage-kv."
        )
    if clearance_m is not None:
        own_requirement(clearance_m)
    elif voltage_kv is not None:
        load_table(thresholds).of_class(voltage_kv)


def requirement(
    survey: Survey, voltage_kv: float | None, thresholds: Path | None, clearance_m: float | None
) -> Requirement | None:
    """The clearance that the conductors of a survey must keep; None where neither voltage nor distance is
    given.

    clearance_m, a distance to be kept from everything, precedes the table's.  thresholds: path or name of a
    table (`load_table`).  Raises AboveTableError for a line above the table's altitudes.
    """
    if clearance_m is not None:
        return own_requirement(clearance_m)
    if voltage_kv is None:
        return None
    return required_clearance(voltage_kv, altitude_of(survey), load_table(thresholds))


def load_table(path: Path | None = None) -> Table:
    """Reads a table from a TOML file.

    path: where nothing is there, the name of a table that comes with the package; None: `DEFAULT_TABLE`.
    Raises SurveyError where the file is missing, or not of the form of `data/clearances/`.
    """
    place = path or TABLES / DEFAULT_TABLE
    if path is not None and not path.exists() and (TABLES / path.name).is_file():
        place = TABLES / path.name
    try:
        data = toml_of(place)
    except OSError as error:
        raise SurveyError(
            f"The table {place} cannot be read ({error.strerror or error}). Check its path."
        ) from error
    except ValueError as error:  # of TOML, or of the encoding
        raise SurveyError(f"{place} is not valid TOML ({error}). {_ADVICE}") from error
    missing = [key for key in _KEYS if key not in data]
    if missing:
        raise SurveyError(f"{place} does not say {', '.join(missing)}. {_ADVICE}")
    try:
        return _table(data, str(path or DEFAULT_TABLE))
    except KeyError as error:
        raise SurveyError(f"{place} has a class that does not say {error}. {_ADVICE}") from error
    except (TypeError, ValueError, OverflowError) as error:
        raise SurveyError(f"{place} is no table of clearances: {error}. {_ADVICE}") from error


_ADVICE = f"Copy {DEFAULT_TABLE} of the package and change its numbers."


def _table(data: dict[str, Any], path: str) -> Table:
    """The table of a TOML file's values.  Raises ValueError for values that make none."""
    if data["unit"] not in METRES:
        raise ValueError(f"its unit is {data['unit']!r}, but must be one of {', '.join(METRES)}")
    strange = [group for group in data["applies_to"] if group not in GROUPS]
    if strange:
        raise ValueError(f"it applies to {', '.join(strange)}, but knows only {', '.join(GROUPS)}")
    metres, bounds = METRES[data["unit"]], [float(bound) for bound in data["altitude_up_to"]]
    if not bounds or bounds != sorted(set(bounds)) or not all(map(math.isfinite, bounds)):
        raise ValueError(f"its altitudes {bounds} must be finite and rise")
    distances: dict[float, tuple[float, ...]] = {}
    for row in data["class"]:
        nominal, values = float(row["nominal_kv"]), [float(value) for value in row["distance"]]
        if not 0 < nominal < float("inf"):
            raise ValueError(f"it has a class of {nominal:g} kV")
        if nominal in distances:
            raise ValueError(f"it has {nominal:g} kV twice")
        if len(values) != len(bounds):
            raise ValueError(f"{nominal:g} kV has {len(values)} distances for {len(bounds)} altitudes")
        if not all(0 < value < float("inf") for value in values):
            raise ValueError(f"{nominal:g} kV has distances that are not greater than 0: {values}")
        distances[nominal] = tuple(value * metres for value in values)
    if not distances:
        raise ValueError("it has no class")
    return Table(
        path=path,
        name=str(data["name"]),
        source=str(data["source"]),
        date=str(data["date"]),
        applies_to=tuple(data["applies_to"]),
        caveats=tuple(str(caveat) for caveat in data["caveats"]),
        up_to_m=tuple(bound * metres for bound in bounds),
        distances_m=distances,
        in_force=str(data.get("in_force", "")),
    )
