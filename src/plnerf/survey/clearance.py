"""How near the conductors come to the ground, to vegetation, to buildings and to all else, as surveyed.

Letters: k stations along a wire; s horizontally from the wire's end A; world frame, metres, z up, float64.

A distance's standard deviation is that of the wire along the line to the obstacle, from the covariance of its
catenary, and of the obstacle's point where the cloud states one.  Along the wire itself, being nearest, the
distance does not change to first order.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import minimum_filter1d

from plnerf.errors import SurveyError
from plnerf.survey.ground_section import ground_under
from plnerf.survey.model import GROUND, NO_WIRE, Conductor, Kind, Survey
from plnerf.survey.obstacles import (
    CLASSES,
    LOOSE_M,
    NEAR_SUPPORT_M,
    NO_THING,
    REACH_M,
    Nearest,
    beside,
    nearest_along,
    obstacles,
    stations,
)
from plnerf.survey.thresholds import GROUPS, Group, Requirement, Verdict

STATION_M = 0.5
"""Between the places along a wire where a profile says what is there."""
CORRIDOR_M = 5.0
"""Vegetation this near to the wire (horizontally) shows in its profile."""
APART_M = 5.0
"""Places of one wire and group are so far apart along it, and each is the nearest within this distance."""
MOST_PLACES = 5
STATE = "as surveyed"
"""Of wires: not at their greatest temperature, not loaded, not swung."""
_Indices = dict[Group, Int[np.ndarray, " _"]]


@dataclass(frozen=True, eq=False)
class Place:
    """Where a conductor comes near to something."""

    conductor: int
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
    wire: Float[np.ndarray, "3"]
    obstacle: Float[np.ndarray, "3"]

    @property
    def vertical_m(self) -> float:
        """How much higher the wire is than the obstacle."""
        return float(self.wire[2] - self.obstacle[2])


@dataclass(frozen=True, eq=False)
class Profile:
    """A wire and what is below and beside it, for k stations; NaN where nothing is known."""

    s_m: Float[np.ndarray, " k"]
    wire: Float[np.ndarray, "k 3"]
    sigma_z_m: Float[np.ndarray, " k"]
    """Of the wire's height."""
    ground_z: Float[np.ndarray, " k"]
    vegetation_z: Float[np.ndarray, " k"]
    """The highest within `CORRIDOR_M`."""
    distance_m: dict[Group, Float[np.ndarray, " k"]]
    """From the wire to the nearest obstacle beside the station."""


@dataclass(frozen=True, eq=False)
class ConductorClearance:
    """All of one conductor."""

    conductor: int
    """Its id."""
    span: int
    kind: Kind
    places: dict[Group, tuple[Place, ...]]
    """Distinct places, the nearest first; empty where the group has no points near."""
    vertical: Place | None
    """The least height above the ground; None: no ground is known below."""
    profile: Profile

    def least(self, group: Group) -> Place | None:
        """The least distance."""
        return self.places[group][0] if self.places[group] else None


@dataclass(frozen=True, eq=False)
class Clearances:
    """Of all conductors."""

    conductors: tuple[ConductorClearance, ...]
    temperature_c: float | None
    """Of the conductors, if it is known."""
    requirement: Requirement | None
    notes: tuple[str, ...]
    """What a reader must know."""
    state: str = STATE

    def verdict(self, place: Place) -> Verdict | None:
        """None where nothing is required: of shield wires, and of what the requirement does not apply to."""
        if self.requirement is None or place.kind != "phase" or place.to not in self.requirement.applies_to:
            return None
        return self.requirement.verdict(place.distance_m, place.sigma_m)

    def all_places(self) -> tuple[Place, ...]:
        """Of every conductor, by group and then by distance; last the height above the ground."""
        found: list[Place] = []
        for one in self.conductors:
            for group in GROUPS:
                found += one.places[group]
            found += [one.vertical] if one.vertical is not None else []
        return tuple(found)

    def worst(self, group: Group, most: int = 10) -> tuple[Place, ...]:
        """The nearest of all conductors, each obstacle (within `APART_M` horizontally) once."""
        chosen: list[Place] = []
        for place in sorted(
            (place for one in self.conductors for place in one.places[group]),
            key=lambda place: place.distance_m,
        ):
            apart = [np.linalg.norm((place.obstacle - other.obstacle)[:2]) > APART_M for other in chosen]
            if all(apart) and len(chosen) < most:
                chosen.append(place)
        return tuple(chosen)


def measure_clearances(survey: Survey, requirement: Requirement | None = None) -> Clearances:
    """Distances of every conductor to every group of the cloud's classes (`obstacles.RULES`).

    Raises SurveyError for a survey without scale, in which a clearance would be a number without meaning.
    """
    if survey.unit != "m":
        raise SurveyError(
            f"The survey {survey.source} has no scale, so that clearances in metres cannot be told. Give the "
            "photos' positions or control points, and survey again."
        )
    found = obstacles(survey)
    conductors = tuple(_measure(conductor, survey, found) for conductor in survey.conductors)
    notes = tuple(_notes(survey, found, requirement))
    return Clearances(conductors, survey.temperature_c, requirement, notes)


def _measure(conductor: Conductor, survey: Survey, found: _Indices) -> ConductorClearance:
    curve, cloud = conductor.fit.curve, survey.cloud
    at = stations(curve, STATION_M)
    wire, sigma = curve.points(at), conductor.fit.sigma_at(at / curve.span_m * conductor.fit.base.length_m)
    beyond_m = REACH_M if cloud.sigma_m is None else 0.0
    near = {group: nearest_along(curve, at, cloud.xyz, found[group], beyond_m) for group in GROUPS}
    ground_z, ground_sigma = ground_under(curve, at, cloud.xyz, found["ground"], cloud.sigma_m)
    profile = Profile(
        s_m=at,
        wire=wire,
        sigma_z_m=sigma[:, 1],
        ground_z=ground_z,
        vegetation_z=_highest(conductor, at, survey, found["vegetation"]),
        distance_m={
            group: np.where(one.index < 0, np.nan, one.distance_m) for group, one in near.items()
        },
    )
    vertical = None
    if np.isfinite(ground_z).any():
        lowest = int(np.nanargmin(wire[:, 2] - ground_z))
        vertical = Place(
            conductor.id, conductor.span, conductor.kind, "ground", GROUND, "vertical",
            distance_m=float(wire[lowest, 2] - ground_z[lowest]),
            sigma_m=float(np.hypot(sigma[lowest, 1], ground_sigma[lowest])),
            s_m=float(at[lowest]),
            wire=wire[lowest],
            obstacle=np.array([*wire[lowest, :2], ground_z[lowest]]),
        )  # fmt: skip
    places = {group: _places(conductor, survey, group, near[group]) for group in GROUPS}
    return ConductorClearance(conductor.id, conductor.span, conductor.kind, places, vertical, profile)


def _places(conductor: Conductor, survey: Survey, group: Group, near: Nearest) -> tuple[Place, ...]:
    """The nearest of all within `APART_M` along the wire, of which the nearest ones."""
    curve, cloud, found = conductor.fit.curve, survey.cloud, []
    for station in _lowest(near.distance_m, curve.span_m / (len(near.s_m) - 1)):
        s, i = near.s_m[station : station + 1], near.index[station]
        wire, obstacle = curve.points(s)[0], cloud.xyz[i]
        towards = (wire - obstacle) / max(float(near.distance_m[station]), 1e-9)
        across = towards[:2] @ np.array([-curve.direction[1], curve.direction[0]])
        of_wire = conductor.fit.sigma_at(s / curve.span_m * conductor.fit.base.length_m)[0]
        of_point = 0.0 if cloud.sigma_m is None else float(cloud.sigma_m[i])
        place = Place(
            conductor.id, conductor.span, conductor.kind, group, int(cloud.label[i]), "distance",
            distance_m=float(near.distance_m[station]),
            sigma_m=float(np.linalg.norm([across * of_wire[0], towards[2] * of_wire[1], of_point])),
            s_m=float(s[0]),
            wire=wire,
            obstacle=obstacle.copy(),
        )  # fmt: skip
        found.append(place)
    return tuple(found)


def _lowest(values: Float[np.ndarray, " k"], step_m: float) -> list[int]:
    """Stations of the local minima, the least first; none within `APART_M` of a lesser one."""
    reach = max(1, round(APART_M / step_m))
    least = minimum_filter1d(values, 2 * reach + 1, mode="nearest")
    chosen: list[int] = []
    for station in np.flatnonzero((values == least) & np.isfinite(values)):
        if all(abs(int(station) - other) > reach for other in chosen):  # of equal ones the first
            chosen.append(int(station))
    return sorted(chosen, key=lambda station: values[station])[:MOST_PLACES]


def _highest(
    conductor: Conductor, at: Float[np.ndarray, " k"], survey: Survey, index: Int[np.ndarray, " m"]
) -> Float[np.ndarray, " k"]:
    """Of the vegetation within `CORRIDOR_M` of the wire, by station."""
    curve, top = conductor.fit.curve, np.full(len(at), -np.inf)
    for _, local in beside(curve, survey.cloud.xyz, index, CORRIDOR_M, 0.0):
        inside: Bool[np.ndarray, " c"] = (local[:, 0] >= 0) & (local[:, 0] <= curve.span_m)
        station = np.rint(local[inside, 0] / curve.span_m * (len(at) - 1)).astype(np.int64)
        np.maximum.at(top, station, local[inside, 2])
    return np.where(np.isfinite(top), top, np.nan)


def _notes(survey: Survey, found: _Indices, requirement: Requirement | None) -> list[str]:
    temperature = survey.temperature_c
    notes = [
        f"Sag and clearances are {STATE}"
        + (
            "; the conductors' temperature is not known."
            if temperature is None
            else f", with the conductors at {temperature:g} degrees Celsius."
        )
        + " At the greatest temperature, under ice or in wind they are less."
    ]
    if survey.cloud.sigma_m is None:
        notes.append(
            "The cloud states no standard deviations: those of the clearances hold the wire's part only."
        )
    notes += _left_out(survey, found)
    absent = [group for group in GROUPS if not len(found[group])]
    if absent:
        names = ["other things" if group == "other" else group for group in absent]
        notes.append(f"No points of the cloud count as {', '.join(names)}: nothing is said of these.")
    counts = np.bincount(survey.cloud.label, minlength=256)
    noise = [f"{counts[code]} of class {code}" for code in NO_THING if counts[code]]
    if noise:
        notes.append(f"Points that were not looked at: {', '.join(noise)}.")
    if requirement is not None:
        notes.append(
            f"Required: {requirement.distance_m:.2f} m to {', '.join(requirement.applies_to)} "
            f"({requirement.name}; {requirement.source}"
            + (f", {requirement.date})." if requirement.date else ").")
            + " Asked of phase conductors, not of shield wires."
        )
        notes += requirement.caveats
    return notes


def _left_out(survey: Survey, found: _Indices) -> list[str]:
    """What is not looked at in clouds from images, whose points are uncertain."""
    cloud = survey.cloud
    if cloud.sigma_m is None:
        return []
    notes = []
    counts = np.isin(cloud.label, [code for codes in CLASSES.values() for code in codes])
    counts &= cloud.wire == NO_WIRE
    loose = counts & (cloud.sigma_m > LOOSE_M)
    if loose.any():
        notes.append(
            f"{loose.sum():,} of {counts.sum():,} points are no obstacles to the clearances: their standard "
            f"deviation is more than {LOOSE_M:g} m. What they alone show may be nearer."
        )
    plants = counts & ~loose & np.isin(cloud.label, CLASSES["vegetation"])
    near = int(plants.sum()) - len(found["vegetation"])
    if near:
        notes.append(
            f"{near:,} points of vegetation within {NEAR_SUPPORT_M:g} m of supports and wires' ends are no "
            "obstacles to the clearances, as images do not tell them from the support: look there yourself."
        )
    return notes
