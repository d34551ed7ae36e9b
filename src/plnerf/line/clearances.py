"""How near the wires come to the ground, to vegetation, to buildings and to all else: values.

Letters: k stations along a wire; s along the wire's base from its first end; LineFrame, metres.
"""

from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
from jaxtyping import Float

from plnerf.line.wire import Kind

Group = Literal["ground", "vegetation", "structures", "other"]
"""What a wire may come near to."""
GROUPS: tuple[Group, ...] = get_args(Group)
IN_WORDS: dict[Group, str] = {
    "ground": "ground",
    "vegetation": "vegetation",
    "structures": "buildings",
    "other": "other things",
}
"""For people, to whom the structures of a line are its towers and poles."""
Verdict = Literal["closer than required", "within its uncertainty", "not all seen", "clear"]
VERDICTS: tuple[Verdict, ...] = get_args(Verdict)
"""The most urgent first."""
SIGMAS = 2.0
"""A distance differs from the required one if they are so many standard deviations apart."""


def verdict_of(
    distance_m: float, sigma_m: float, required_m: float, *, at_most: bool = False, hidden_m: float = 0.0
) -> Verdict:
    """How a distance, with its standard deviation, compares with a required one.

    at_most: it is an upper limit, since something nearer may be where images do not show it; hidden_m: but
    nothing nearer than this.
    """
    spare = distance_m - required_m
    if spare > SIGMAS * sigma_m:
        return "not all seen" if at_most and hidden_m < required_m else "clear"
    return "closer than required" if spare < -SIGMAS * sigma_m else "within its uncertainty"


@dataclass(frozen=True)
class Requirement:
    """A distance to be kept, and who says so."""

    distance_m: float
    applies_to: tuple[Group, ...]
    name: str
    source: str
    date: str | None = None
    caveats: tuple[str, ...] = ()

    def verdict(
        self, distance_m: float, sigma_m: float, *, at_most: bool = False, hidden_m: float = 0.0
    ) -> Verdict:
        """On a distance and its standard deviation, or on an upper limit."""
        return verdict_of(distance_m, sigma_m, self.distance_m, at_most=at_most, hidden_m=hidden_m)


@dataclass(frozen=True, eq=False)
class Place:
    """Where a wire comes near to something."""

    wire: int
    """Its id."""
    span: int
    kind: Kind
    to: Group
    class_code: int
    """Of the obstacle."""
    measure: Literal["distance", "vertical"]
    """In space, or straight down to the ground's surface."""
    distance_m: float
    sigma_m: float
    s_m: float
    on_wire: Float[np.ndarray, "3"]
    on_obstacle: Float[np.ndarray, "3"]
    air_seen: float | None = None
    """Share of the air nearer to the wire than the nearest plant that enough images see; None: not known."""
    at_most: bool = False
    """Whether that is too little, or what may be a plant is nearer: low ones that do not stand out from the
    ground's scatter, green ones that too few images see.  The distance is an upper limit then."""
    hidden_m: float = 0.0
    """Of an upper limit: a plant that was not found may be so near."""

    @property
    def vertical_m(self) -> float:
        """How much higher the wire is than the obstacle."""
        return float(self.on_wire[2] - self.on_obstacle[2])

    def limit(self, hidden_m: float) -> "Place":
        """The same as an upper limit."""
        return replace(self, at_most=True, hidden_m=hidden_m)


@dataclass(frozen=True, eq=False)
class Profile:
    """A wire and what is below and beside it, for k stations; NaN where nothing is known."""

    wire: int
    """Its id."""
    s_m: Float[np.ndarray, " k"]
    points: Float[np.ndarray, "k 3"]
    """Of the wire."""
    sigma_z_m: Float[np.ndarray, " k"]
    """Of the wire's height."""
    ground_z: Float[np.ndarray, " k"]
    vegetation_z: Float[np.ndarray, " k"]
    """The highest within the corridor."""
    distance_m: dict[Group, Float[np.ndarray, " k"]]
    """From the wire to the nearest obstacle beside the station."""


@dataclass(frozen=True, eq=False)
class WireClearance:
    """All of one wire."""

    wire: int
    """Its id."""
    span: int
    kind: Kind
    places: dict[Group, tuple[Place, ...]]
    """Distinct places, the nearest first; empty where the group has no points near."""
    vertical: Place | None
    """The least height above the ground; None: no ground is known below, or it may be less elsewhere."""
    profile: Profile
    no_vertical: str | None = None
    """Why no least height is stated although ground is known below some of the wire."""

    def least(self, group: Group) -> Place | None:
        """The least distance."""
        return self.places[group][0] if self.places[group] else None


@dataclass(frozen=True, eq=False)
class Possible:
    """What may come nearer to a wire than anything that enough images show."""

    place: Place
    seen: int
    """How many images see something there."""
    past: int
    """How many see past it, as if nothing were there."""
    at_open_end: bool = False
    """Whether it may be a structure that was not found: it stands where a wire is seen last."""
    at_structure: bool = False
    """Whether it may be a crossarm: it stands beside a structure, about as high as its wires."""
    floats: bool = False
    """Whether it is too thin to be a plant in the air, and may be a wire that was not found."""


@dataclass(frozen=True, eq=False)
class Crossing:
    """Where a wire of one line passes over a wire of another."""

    upper: int
    """Id of the wire above."""
    lower: int
    """Id of the wire below."""
    distance_m: float
    """Least distance in space between the two."""
    sigma_m: float
    s_upper_m: float
    """Where it is reached, along the base of the wire above."""
    s_lower_m: float
    on_upper: Float[np.ndarray, "3"]
    on_lower: Float[np.ndarray, "3"]
    vertical_m: float
    """How much higher the one is where they cross as seen from above."""


@dataclass(frozen=True, eq=False)
class Clearances:
    """Of all wires, as surveyed: neither at their greatest temperature, nor loaded, nor swung further."""

    wires: tuple[WireClearance, ...]
    requirement: Requirement | None = None
    state: str = "as surveyed"
    crossings: tuple[Crossing, ...] = ()
    """Of wires of different lines, the nearest to each other first.  A requirement applies to none of them:
    what lines must keep from each other is another rule."""
    possible: tuple[Possible, ...] = ()
    """Things that would be the nearest to a wire if they were there, the nearest first.  They have no
    verdict."""

    def verdict(self, place: Place) -> Verdict | None:
        """None where nothing is required: of shield wires, and of what the requirement does not apply to."""
        if self.requirement is None or place.kind != "phase" or place.to not in self.requirement.applies_to:
            return None
        return self.requirement.verdict(
            place.distance_m, place.sigma_m, at_most=place.at_most, hidden_m=place.hidden_m
        )

    def all_places(self) -> tuple[Place, ...]:
        """Of every wire, by group and then by distance; last the height above the ground."""
        found: list[Place] = []
        for one in self.wires:
            for group in GROUPS:
                found += one.places[group]
            found += [one.vertical] if one.vertical is not None else []
        return tuple(found)

    def least_places(self) -> tuple[Place, ...]:
        """The nearest of every wire to each group, and its least height above the ground."""
        found: list[Place] = []
        for one in self.wires:
            found += [places[0] for places in one.places.values() if places]
            found += [one.vertical] if one.vertical is not None else []
        return tuple(found)
