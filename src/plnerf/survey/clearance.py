"""How near the wires come to the ground, to vegetation, to buildings and to all else, as surveyed.

Letters: k stations along a wire; s along the wire's base from its first end; LineFrame, metres, z up.

The variance of a distance is that of the wire along the line to the obstacle, from the covariance of its
curve, plus that of the obstacle's point: as the cloud states it, and by how far apart its points are where it
states none or a plant is the obstacle (`sampling.py`).  A shift along the wire does not change the distance
to first order, since the line to the obstacle is square to the wire.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import minimum_filter1d

from plnerf.errors import SurveyError
from plnerf.findings import Finding, harms, note
from plnerf.line.clearances import (
    GROUPS,
    IN_WORDS,
    Clearances,
    Crossing,
    Group,
    Place,
    Profile,
    Requirement,
    WireClearance,
)
from plnerf.line.cloud import GROUND, NO_WIRE, Cloud
from plnerf.line.line import Span
from plnerf.line.survey import Survey
from plnerf.line.wire import Wire
from plnerf.survey.config_ground import ClearanceConfig
from plnerf.survey.config_obstacles import ObstacleConfig
from plnerf.survey.crossings import find_crossings, variance_towards
from plnerf.survey.ground_section import ground_under
from plnerf.survey.obstacles import (
    CLASSES,
    NO_THING,
    Nearest,
    beside,
    beyond_ends_m,
    doubted_plants,
    near_polyline,
    nearest_along,
    obstacles,
    shared_structures,
    stations,
)
from plnerf.survey.possible import about_possible, find_possible, possible_points
from plnerf.survey.sampling import end_sigma_m
from plnerf.survey.thresholds import AboveTableError, requirement
from plnerf.survey.unseen_ground import about_unknown_heights, may_be_less_m

STATE, KIND, CROSSES = "state of the line", "clearances", "crossing lines"
REQUIRED = "required clearance"
"""Kinds of findings.  The first says at what load and temperature sag and clearances hold."""
_Indices = dict[Group, Int[np.ndarray, " _"]]


def measure_clearances(survey: Survey, config: ClearanceConfig) -> tuple[Clearances, tuple[Finding, ...]]:
    """Distances of every wire to every group of the cloud's classes (`obstacles.rules`), and what a reader
    must know of them.  A wire with an open end is measured up to it.

    Without a requirement, and with a finding, where the line lies above the altitudes of its table.  Raises
    SurveyError for a survey without scale, in which a clearance would be a number without meaning.
    """
    if survey.frame.unit != "m":
        raise SurveyError(
            f"The survey {survey.source} has no scale, so that clearances in metres cannot be measured. Give "
            "the photos' positions or control points, and survey again."
        )
    required, above = None, []
    try:
        required = requirement(survey, config.voltage_kv, config.thresholds, config.clearance_m)
    except AboveTableError as error:
        above = [harms(REQUIRED, f"Nothing is judged. {error}")]
    found = obstacles(survey, config.obstacles)
    shared = shared_structures(survey)
    doubted = possible_points(survey, config)
    plants = doubted_plants(survey, doubted["vegetation"], config.obstacles)
    wires, maybe = list[WireClearance](), list[Place]()
    for span in survey.spans:
        sure, unsure = (_beside_span(span, survey.cloud, some, config) for some in (found, doubted))
        for wire in span.wires:
            measured = _measure(span, wire, survey.cloud, sure, shared, config)
            wires.append(_limited(measured, wire, survey.cloud, plants, config))
            for group, near in _near(wire, survey.cloud, unsure, shared, config).items():
                maybe += _places(span, wire, survey.cloud, group, near, unsure[group], config)
    possible = find_possible(survey, wires, maybe, config)
    clearances = Clearances(tuple(wires), required, crossings=find_crossings(survey), possible=possible)
    return clearances, (*above, *_findings(survey, found, doubted, clearances, config.obstacles))


def _beside_span(span: Span, cloud: Cloud, found: _Indices, config: ClearanceConfig) -> _Indices:
    """Those of the points that any of the span's wires, or the spacing at what is beside it, asks for: so the
    time of a wire depends on its own surroundings, and not on the whole cloud."""
    margin = config.sampling.reach_m + max(config.obstacles.reach_m, config.ground.side_m, config.corridor_m)
    lines = np.concatenate([wire.polyline(1.0) for wire in span.wires])
    return {group: near_polyline(lines, cloud.xyz, index, margin) for group, index in found.items()}


def _near(
    wire: Wire, cloud: Cloud, found: _Indices, shared: set[int], config: ClearanceConfig
) -> dict[Group, Nearest]:
    """Of each group what is nearest beside the wire's stations."""
    at, reach_m = stations(wire, config.station_m), config.obstacles.reach_m
    beyond_m = beyond_ends_m(wire, cloud, shared, reach_m)
    return {group: nearest_along(wire, at, cloud.xyz, found[group], reach_m, beyond_m) for group in GROUPS}


def _measure(
    span: Span, wire: Wire, cloud: Cloud, found: _Indices, shared: set[int], config: ClearanceConfig
) -> WireClearance:
    at = stations(wire, config.station_m)
    points, sigma = wire.points(at), wire.sigma_at(at)
    near = _near(wire, cloud, found, shared, config)
    ground_z, ground_sigma = ground_under(wire, at, cloud.xyz, found["ground"], cloud.sigma_m, config.ground)
    profile = Profile(
        wire=wire.id,
        s_m=at,
        points=points,
        sigma_z_m=sigma[:, 1],
        ground_z=ground_z,
        vegetation_z=_highest(wire, at, cloud, found["vegetation"], config.corridor_m),
        distance_m={group: np.where(one.index < 0, np.nan, one.distance_m) for group, one in near.items()},
    )
    vertical, no_vertical, height = None, None, points[:, 2] - ground_z
    unknown_m = may_be_less_m(at, height, points[:, 2], config.ground)
    if unknown_m > 0:
        no_vertical = f"ground was not seen below {unknown_m:.1f} m of it, where it may be less"
    elif np.isfinite(height).any():
        lowest = int(np.nanargmin(height))
        vertical = Place(
            wire.id, span.id, wire.kind, "ground", GROUND, "vertical",
            distance_m=float(points[lowest, 2] - ground_z[lowest]),
            sigma_m=float(np.hypot(sigma[lowest, 1], ground_sigma[lowest])),
            s_m=float(at[lowest]),
            on_wire=points[lowest],
            on_obstacle=np.array([*points[lowest, :2], ground_z[lowest]]),
        )  # fmt: skip
    places = {group: _places(span, wire, cloud, group, near[group], found[group], config) for group in GROUPS}
    return WireClearance(wire.id, span.id, wire.kind, places, vertical, profile, no_vertical)


def _limited(
    one: WireClearance, wire: Wire, cloud: Cloud, doubted: Int[np.ndarray, " _"], config: ClearanceConfig
) -> WireClearance:
    """With its distances to plants as upper limits, if a doubted plant is nearer.  doubted: indices."""
    reach_m = config.obstacles.reach_m
    some = near_polyline(wire.polyline(1.0), cloud.xyz, doubted, reach_m)
    near = nearest_along(wire, stations(wire, config.station_m), cloud.xyz, some, reach_m, (0.0, 0.0))
    hidden_m, least = float(near.distance_m.min()), one.least("vegetation")
    if least is None or least.distance_m <= hidden_m:
        return one
    limited = tuple(place.limit(hidden_m) for place in one.places["vegetation"])
    return replace(one, places={**one.places, "vegetation": limited})


def _places(
    span: Span, wire: Wire, cloud: Cloud, group: Group, near: Nearest, beside: Int[np.ndarray, " m"],
    config: ClearanceConfig,
) -> tuple[Place, ...]:  # fmt: skip
    """The nearest obstacles of those within `apart_m` along the wire; of these the nearest ones.

    beside: indices of the group's points.
    """
    found = []
    for station in _lowest(near.distance_m, wire.base.length_m / (len(near.s_m) - 1), config):
        s, i = near.s_m[station : station + 1], near.index[station]
        on_wire, obstacle = wire.points(s)[0], cloud.xyz[i]
        towards = (on_wire - obstacle) / max(float(near.distance_m[station]), 1e-9)
        of_wire = float(np.sqrt(variance_towards(wire, float(s[0]), towards)))
        of_point = end_sigma_m(cloud, beside, int(i), config.sampling, group=group, towards=towards)
        place = Place(
            wire.id, span.id, wire.kind, group, int(cloud.label[i]), "distance",
            distance_m=float(near.distance_m[station]),
            sigma_m=float(np.hypot(of_wire, of_point)),
            s_m=float(s[0]),
            on_wire=on_wire,
            on_obstacle=obstacle.copy(),
        )  # fmt: skip
        found.append(place)
    return tuple(found)


def _lowest(values: Float[np.ndarray, " k"], step_m: float, config: ClearanceConfig) -> list[int]:
    """Stations of the local minima, the least first; none within `apart_m` of a lesser one."""
    reach = max(1, round(config.apart_m / step_m))
    least = minimum_filter1d(values, 2 * reach + 1, mode="nearest")
    chosen: list[int] = []
    for station in np.flatnonzero((values == least) & np.isfinite(values)):
        if all(abs(int(station) - other) > reach for other in chosen):  # of equal ones the first
            chosen.append(int(station))
    return sorted(chosen, key=lambda station: values[station])[: config.max_places]


def _highest(
    wire: Wire, at: Float[np.ndarray, " k"], cloud: Cloud, index: Int[np.ndarray, " m"], corridor_m: float
) -> Float[np.ndarray, " k"]:
    """Height of the highest vegetation within the corridor at each station; NaN where there is none."""
    length, top = wire.base.length_m, np.full(len(at), -np.inf)
    for _, local in beside(wire, cloud.xyz, index, corridor_m, (0.0, 0.0)):
        inside: Bool[np.ndarray, " c"] = (local[:, 0] >= 0) & (local[:, 0] <= length)
        station = np.rint(local[inside, 0] / length * (len(at) - 1)).astype(np.int64)
        np.maximum.at(top, station, local[inside, 2])
    return np.where(np.isfinite(top), top, np.nan)


def _findings(
    survey: Survey, found: _Indices, doubted: _Indices, clearances: Clearances, config: ObstacleConfig
) -> list[Finding]:
    temperature = survey.temperature_c
    findings = [
        note(
            STATE,
            f"Sag and clearances are {clearances.state}"
            + (
                "; the conductors' temperature is not known."
                if temperature is None
                else f", with the conductors at {temperature:g} degrees Celsius."
            )
            + " At the greatest temperature, under ice or in wind clearances are less.",
        )
    ]
    if survey.cloud.sigma_m is None:
        findings.append(
            note(
                KIND,
                "The cloud states no standard deviations: how far obstacles reach between its points is "
                "taken from the points' spacing.",
            )
        )
    findings += [*about_possible(clearances.possible), *_left_out(survey.cloud, found, doubted, config)]
    findings += about_unknown_heights(clearances)
    absent = [IN_WORDS[group] for group in GROUPS if not len(found[group])]
    if absent:
        findings.append(
            note(
                KIND,
                f"The cloud has no points of {', '.join(absent)} as obstacles to the wires: no distance to "
                "these is stated, which does not mean that there are none.",
            )
        )
    counts = np.bincount(survey.cloud.label, minlength=256)
    noise = [f"{counts[code]:,} of class {code}" for code in NO_THING if counts[code]]
    if noise:
        findings.append(note(KIND, f"Points that are no obstacles by their class: {', '.join(noise)}."))
    if clearances.crossings:
        findings.append(note(CROSSES, _of_crossings(survey, clearances)))
    if clearances.requirement is not None:
        findings += _of_requirement(clearances.requirement)
        if len(survey.lines) > 1:
            several = (
                f"The same clearance is required of the phase conductors of all {len(survey.lines)} lines, "
                "whatever their voltages."
            )
            findings.append(harms(REQUIRED, several, "Judge those of another voltage yourself."))
    return findings


def _of_crossings(survey: Survey, clearances: Clearances) -> str:
    """Which lines cross, and how near their wires come to each other."""
    line_of = {wire.id: line.id for line in survey.lines for wire in line.wires}
    least: dict[tuple[int, int], Crossing] = {}
    for one in clearances.crossings:
        least.setdefault((line_of[one.upper], line_of[one.lower]), one)
    parts = [
        f"line {above} crosses over line {below}, {one.distance_m:.2f} m from wire {one.upper} to wire "
        f"{one.lower} at the nearest"
        for (above, below), one in least.items()
    ]
    said = "; ".join(parts)
    return f"{said[:1].upper()}{said[1:]}. No requirement is applied between lines."


def _left_out(
    cloud: Cloud, found: _Indices, doubted: _Indices, config: ObstacleConfig
) -> list[Finding]:
    """Which points of clouds from images do not count, because they are uncertain."""
    if cloud.sigma_m is None:
        return []
    findings = []
    counts = np.isin(cloud.label, [code for codes in CLASSES.values() for code in codes])
    counts &= cloud.wire == NO_WIRE
    loose = counts & (cloud.sigma_m > config.max_sigma_m)
    if loose.any():
        findings.append(
            harms(
                KIND,
                f"{loose.sum():,} of {counts.sum():,} points are no obstacles to the clearances: their "
                f"standard deviation is more than {config.max_sigma_m:g} m. What they alone show may be "
                "nearer.",
            )
        )
    plants = counts & ~loose & np.isin(cloud.label, CLASSES["vegetation"])
    near = int(plants.sum()) - len(found["vegetation"]) - len(doubted["vegetation"])
    if near:
        findings.append(
            harms(
                KIND,
                f"{near:,} points of vegetation within {config.plant_support_m:g} m of structures and of the "
                "wires' ends on them are no obstacles to the clearances: they are not green, or few images "
                "see them, and images do not separate them from the structure.",
                "Look there yourself.",
            )
        )
    return findings


def _of_requirement(required: Requirement) -> list[Finding]:
    dated = f", {required.date}" if required.date else ""
    text = (
        f"Required: {required.distance_m:.2f} m to {', '.join(required.applies_to)} ({required.name}; "
        f"{required.source}{dated}). It applies to phase conductors only."
    )
    return [note(REQUIRED, text), *(note(REQUIRED, caveat) for caveat in required.caveats)]
