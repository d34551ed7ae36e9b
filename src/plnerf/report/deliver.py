"""What a survey leaves in its folder: clearances, files for other programs, and the report."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from plnerf.errors import SurveyError
from plnerf.export.files import write_exports
from plnerf.report.data import Clearance, Picture, Profile, Report
from plnerf.report.page import write_report
from plnerf.survey.clearance import Clearances, Place, measure_clearances
from plnerf.survey.model import Survey
from plnerf.survey.thresholds import (
    Requirement,
    altitude_m,
    load_table,
    own_requirement,
    required_clearance,
)

PAGE, CONTENT = "report.html", "survey.json"


@dataclass(frozen=True)
class SurveyOptions:
    """What the user says of a line.

    Raises SurveyError for a voltage that the table does not have, a table that is none, and a clearance that
    is not positive: before the line is surveyed.
    """

    voltage_kv: float | None = None
    """Nominal."""
    thresholds: Path | None = None
    """A table of required clearances; None: the one that comes with the package."""
    clearance_m: float | None = None
    """A distance to be kept from everything, which wins."""
    temperature_c: float | None = None
    """Of the conductors when they were surveyed."""

    def __post_init__(self) -> None:
        if self.thresholds is not None and self.voltage_kv is None and self.clearance_m is None:
            raise SurveyError(
                f"The table {self.thresholds} has distances by voltage, but no voltage is given. Give "
                "--voltage-kv."
            )
        if self.clearance_m is not None:
            own_requirement(self.clearance_m)
        elif self.voltage_kv is not None:
            load_table(self.thresholds).of_class(self.voltage_kv)

    def requirement(self, survey: Survey) -> Requirement | None:
        """None where nothing is said.  Raises SurveyError for a line above the altitudes of the table."""
        if self.clearance_m is not None:
            return own_requirement(self.clearance_m)
        if self.voltage_kv is None:
            return None
        return required_clearance(self.voltage_kv, altitude_m(survey), load_table(self.thresholds))


def deliver(
    survey: Survey,
    out: Path,
    options: SurveyOptions,
    *,
    pictures: tuple[Picture, ...] = (),
    made: Mapping[str, str],
    synthetic: bool,
) -> Path:
    """Writes everything into a folder; returns the report's path.

    synthetic: the cloud's points come from images rather than a laser.  Errors are those of the parts.
    """
    survey = replace(survey, temperature_c=options.temperature_c)
    clearances = None
    if survey.unit == "m" and survey.conductors:
        clearances = measure_clearances(survey, options.requirement(survey))
    exports = write_exports(survey, clearances, out, synthetic=synthetic)
    # The first of the clearances' notes is what the report says of itself: as surveyed.
    notes = (*survey.notes, *(clearances.notes[1:] if clearances is not None else ()))
    report = Report(
        replace(survey, notes=tuple(dict.fromkeys(notes))),
        _rows(clearances),
        _profiles(clearances),
        pictures,
        tuple(exports.files),
        made,
        exports.notes,
    )
    write_report(out / PAGE, out / CONTENT, report)
    return out / PAGE


def _rows(clearances: Clearances | None) -> tuple[Clearance, ...]:
    """The least distance of every conductor to each group, and straight down to the ground."""
    if clearances is None:
        return ()
    rows = []
    for one in clearances.conductors:
        nearest = [places[0] for places in one.places.values() if places]
        rows += [_row(place, clearances) for place in nearest]
        rows += [_row(one.vertical, clearances)] if one.vertical is not None else []
    return tuple(rows)


def _row(place: Place, clearances: Clearances) -> Clearance:
    verdict = clearances.verdict(place)
    required = clearances.requirement.distance_m if verdict and clearances.requirement else None
    return Clearance(
        conductor=place.conductor,
        to="ground, straight down" if place.measure == "vertical" else place.to,
        distance_m=place.distance_m,
        sigma_m=place.sigma_m,
        place_m=place.s_m,
        on_wire=place.wire,
        on_obstacle=place.obstacle,
        required_m=required,
        verdict=verdict or "nothing is required",
    )


def _profiles(clearances: Clearances | None) -> tuple[Profile, ...]:
    return tuple(
        Profile(
            one.conductor, one.profile.s_m, one.profile.wire[:, 2], one.profile.ground_z,
            one.profile.vegetation_z,
        )
        for one in (clearances.conductors if clearances is not None else ())
    )  # fmt: skip
