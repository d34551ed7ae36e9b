"""What a report tells beside the survey itself: clearances, profiles, pictures, and how it was made.

World frame; lengths in metres, or in units of an unscaled survey.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from jaxtyping import Float, UInt8

from plnerf.errors import SurveyError
from plnerf.survey.model import Conductor, Survey
from plnerf.survey.thresholds import SIGMAS

TWO_SIDED_95 = 1.96
"""Standard deviations that 95 % of normal errors lie within."""
Standing = Literal["short", "doubtful", "kept", "open"]
"""Less than required; not to be told from it; more; nothing is required."""


@dataclass(frozen=True, eq=False)
class Clearance:
    """The least distance from one conductor to one class of things."""

    conductor: int
    """Its id."""
    to: str
    """The class in words, such as "vegetation"."""
    distance_m: float
    sigma_m: float | None
    """Standard deviation of the distance; None: unknown."""
    place_m: float
    """Of the point on the wire, horizontally along the span from its end A."""
    on_wire: Float[np.ndarray, "3"]
    on_obstacle: Float[np.ndarray, "3"]
    required_m: float | None
    verdict: str
    """In words."""

    @property
    def margin_m(self) -> float | None:
        """What is left over of the required distance; None where nothing is required."""
        return None if self.required_m is None else self.distance_m - self.required_m

    @property
    def standing(self) -> Standing:
        """How the distance compares with the required one."""
        if self.margin_m is None:
            return "open"
        if abs(self.margin_m) <= SIGMAS * (self.sigma_m or 0.0):
            return "doubtful"
        return "short" if self.margin_m < 0 else "kept"


@dataclass(frozen=True, eq=False)
class Profile:
    """What lies below one conductor, at k places along its span."""

    conductor: int
    """Its id."""
    place_m: Float[np.ndarray, " k"]
    """Horizontally from its end A, rising."""
    wire_m: Float[np.ndarray, " k"]
    """Height of the wire."""
    ground_m: Float[np.ndarray, " k"]
    """Height of the ground, NaN where it is not known."""
    vegetation_m: Float[np.ndarray, " k"]
    """Height of the top of vegetation, NaN where there is none."""


@dataclass(frozen=True, eq=False)
class Picture:
    """A photo with the fitted wires drawn over it."""

    caption: str
    rgb: UInt8[np.ndarray, "h w 3"]


@dataclass(frozen=True, eq=False)
class Report:
    """All that is told.  Raises SurveyError where its parts do not belong together."""

    survey: Survey
    clearances: tuple[Clearance, ...] = ()
    profiles: tuple[Profile, ...] = ()
    pictures: tuple[Picture, ...] = ()
    files: tuple[str, ...] = ()
    """Names of what was written beside the report."""
    made: Mapping[str, str] = field(default_factory=dict)
    """How it was made, in words: preset, versions, date."""
    about_files: tuple[str, ...] = ()
    """What the files' coordinates mean, and which were left out and why."""

    def __post_init__(self) -> None:
        known = {conductor.id for conductor in self.survey.conductors}
        if len(known) < len(self.survey.conductors):
            raise SurveyError(
                f"The {len(self.survey.conductors)} conductors of {self.survey.source} share ids. Number "
                "them from 1."
            )
        parts: list[Clearance | Profile] = [*self.clearances, *self.profiles]
        for part in parts:
            if part.conductor not in known:
                raise SurveyError(
                    f"A {type(part).__name__.lower()} is of conductor {part.conductor}, but the survey of "
                    f"{self.survey.source} has {sorted(known) or 'none'}. Give those of this survey."
                )
        judged = [one for one in self.clearances if one.required_m is not None]
        if self.survey.unit == "unscaled" and judged:
            raise SurveyError(
                f"The survey of {self.survey.source} is unscaled, so that its distances cannot be compared "
                f"with a required one, but {judged[0].required_m} m are required to {judged[0].to}. Give "
                "positions or control points, or leave out what is required."
            )

    @property
    def spans(self) -> dict[int, list[Conductor]]:
        """Conductors of each span, in the line's order, by id."""
        conductors = sorted(self.survey.conductors, key=lambda one: (one.span, one.id))
        return {
            span: [one for one in conductors if one.span == span]
            for span in dict.fromkeys(one.span for one in conductors)
        }

    def worst(self, conductors: set[int] | None = None) -> list[Clearance]:
        """The worst clearance to each class, of some conductors or of all: least margin, else distance."""
        found: dict[str, Clearance] = {}
        for one in self.by_need:
            if conductors is None or one.conductor in conductors:
                found.setdefault(one.to, one)
        return list(found.values())

    @property
    def by_need(self) -> list[Clearance]:
        """Clearances, those first that fall short of what is required, or are nearest to it."""
        return sorted(
            self.clearances,
            key=lambda one: (one.margin_m is None, one.margin_m or 0.0, one.distance_m, one.conductor),
        )
