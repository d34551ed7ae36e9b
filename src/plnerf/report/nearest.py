"""The least clearances of a survey: of every wire to each group, and straight down to the ground."""

from collections.abc import Collection
from dataclasses import dataclass
from typing import Literal

from plnerf.errors import SurveyError
from plnerf.line.clearances import IN_WORDS, Place, Verdict
from plnerf.line.ends import Quantity
from plnerf.line.rules import Judged
from plnerf.line.survey import Survey

Standing = Literal["short", "doubtful", "kept", "open"]
"""Less than required; within its uncertainty of it, or of what was seen; more; nothing is required."""
STANDINGS: dict[Verdict | None, Standing] = {
    "closer than required": "short",
    "within its uncertainty": "doubtful",
    "not all seen": "doubtful",
    "clear": "kept",
    None: "open",
}


@dataclass(frozen=True, eq=False)
class Nearest:
    """A least clearance and what is required of it."""

    place: Place
    verdict: Verdict | None
    required_m: float | None
    """None: nothing is required."""

    @property
    def to(self) -> str:
        """What the distance is to, in words."""
        return "ground, straight down" if self.place.measure == "vertical" else IN_WORDS[self.place.to]

    @property
    def distance(self) -> Quantity:
        """With its standard deviation."""
        return Quantity(self.place.distance_m, self.place.sigma_m)

    @property
    def sign(self) -> str:
        """Before the distance: that it is an upper limit."""
        return limit_sign(self.place)

    @property
    def margin_m(self) -> float | None:
        """What is left over of the required distance; None where nothing is required."""
        return None if self.required_m is None else self.place.distance_m - self.required_m

    @property
    def standing(self) -> Standing:
        """How the distance compares with the required one."""
        return STANDINGS[self.verdict]

    @property
    def words(self) -> str:
        """The verdict."""
        return self.verdict or "nothing is required"


def limit_sign(place: Place | Judged) -> str:
    """Before a distance: that it is an upper limit."""
    return "≤\u00a0" if place.at_most else ""


def by_need(survey: Survey) -> list[Nearest]:
    """The least clearances, those first that fall short of what is required or come nearest to it."""
    found = survey.clearances
    if found is None:
        return []
    rows = []
    for place in found.least_places():
        verdict = found.verdict(place)
        required = found.requirement.distance_m if verdict and found.requirement else None
        rows.append(Nearest(place, verdict, required))
    return sorted(
        rows,
        key=lambda one: (
            one.margin_m is None, one.margin_m or 0.0, one.place.distance_m, one.place.wire
        ),
    )  # fmt: skip


def worst(rows: list[Nearest], wires: Collection[int] | None = None) -> list[Nearest]:
    """The first of the rows to each group, of some wires or of all: least margin, else least distance."""
    found: dict[str, Nearest] = {}
    for one in rows:
        if wires is None or one.place.wire in wires:
            found.setdefault(one.to, one)
    return list(found.values())


def check_parts(survey: Survey) -> None:
    """Raises SurveyError where parts of a survey do not belong together."""
    ids = [wire.id for wire in survey.wires]
    if len(set(ids)) < len(ids):
        raise SurveyError(f"The {len(ids)} wires of {survey.source} share ids. Number them from 1.")
    if survey.clearances is None:
        return
    for one in survey.clearances.wires:
        if one.wire not in ids:
            raise SurveyError(
                f"A clearance is of wire {one.wire}, but the survey of {survey.source} has "
                f"{sorted(ids) or 'none'}. Give those of this survey."
            )
    required = survey.clearances.requirement
    if survey.frame.unit == "unscaled" and required is not None:
        raise SurveyError(
            f"The survey of {survey.source} is unscaled, so that its distances cannot be compared with a "
            f"required one, but {required.distance_m} m are required ({required.name}). Give positions or "
            "control points, or leave out what is required."
        )
