"""Whether a plant may stand nearer to a wire than the nearest that is found, because images do not show it.

The least distance to plants is that to what was matched.  A crown that few images have in their frames, or
from places far from each other, leaves no points; neither does anything show past it.  So the air nearer to
the wire than the nearest plant is sampled, down to the ground: where enough images see through too little of
it, the distance is an upper limit.  So it is where what may be a plant is nearer (`clearance.py`).

Letters: k stations along a wire, a directions across it, r distances from it.  LineFrame, metres.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float

from plnerf.findings import Finding, harms, note
from plnerf.line.clearances import Clearances, Profile, WireClearance
from plnerf.line.survey import Survey
from plnerf.line.wire import Wire
from plnerf.survey.config_ground import CoverageConfig
from plnerf.survey.stereo.witnesses import Sight, witnesses

LEAST = "nearest plants"
"""Kind of the finding."""


def with_air_seen(
    clearances: Clearances, survey: Survey, sights: Sequence[Sight], config: CoverageConfig
) -> tuple[Clearances, list[Finding]]:
    """With how much of the air nearer than the nearest plant was seen, of each wire; as they are without
    images."""
    if not sights:
        return clearances, []
    by_id = {wire.id: wire for wire in survey.wires}
    wires = tuple(_of_wire(one, by_id[one.wire], sights, config) for one in clearances.wires)
    return replace(clearances, wires=wires), _about(wires, config)


def upper_limits(survey: Survey) -> dict[tuple[int, int], float]:
    """The lines and spans with a phase conductor whose nearest plant is an upper limit, and how near what was
    not found may be."""
    if survey.clearances is None:
        return {}
    least = {one.wire: p for one in survey.clearances.wires if (p := one.least("vegetation")) and p.at_most}
    found: dict[tuple[int, int], float] = {}
    for line in survey.lines:
        for span in line.spans:
            hidden = [least[one.id].hidden_m for one in span.wires if one.id in least and one.kind == "phase"]
            if hidden:
                found[line.id, span.id] = min(hidden)
    return found


def _of_wire(
    one: WireClearance, wire: Wire, sights: Sequence[Sight], config: CoverageConfig
) -> WireClearance:
    least = one.least("vegetation")
    if least is None:
        return one
    places, weights = air_around(wire, one.profile, least.distance_m, config)
    if not len(places):
        return one
    seen, past = witnesses(places, np.zeros(len(places)), sights, config.witnesses)
    share = float(np.average(seen + past >= config.min_images, weights=weights))
    known = (replace(place, air_seen=share) for place in one.places["vegetation"])
    marked = tuple(place.limit(0.0) if share < config.least_share else place for place in known)
    return replace(one, places={**one.places, "vegetation": marked})


def air_around(
    wire: Wire, profile: Profile, reach_m: float, config: CoverageConfig
) -> tuple[Float[np.ndarray, "p 3"], Float[np.ndarray, " p"]]:
    """Places beside and below a wire nearer to it than `reach_m` and clear of the ground, and the volume that
    each stands for, in any unit."""
    length = wire.base.length_m
    s = (np.arange(n := max(1, min(config.most_stations, math.ceil(length / config.step_m)))) + 0.5) / n
    angle = np.linspace(-np.pi / 2, np.pi / 2, config.directions)  # 0: straight down
    r = (np.arange(config.directions) + 0.5) / config.directions * reach_m
    aside = np.array([-wire.base.u[1], wire.base.u[0], 0.0])
    across = np.sin(angle)[:, None] * aside - np.cos(angle)[:, None] * np.array([0.0, 0.0, 1.0])
    at = wire.points(s * length)[:, None, None] + r[:, None] * across[:, None]
    lowest = _ground(profile, s * length, config) + config.above_ground_m
    clear: Bool[np.ndarray, "k a r"] = at[..., 2] > lowest[:, None, None]
    return at[clear], np.broadcast_to(r, clear.shape)[clear]


def _ground(
    profile: Profile, s_m: Float[np.ndarray, " k"], config: CoverageConfig
) -> Float[np.ndarray, " k"]:
    """Height of the ground below stations, between those where it is known; far below the wire if nowhere."""
    known = np.isfinite(profile.ground_z)
    if not known.any():
        height: Float[np.ndarray, " k"] = np.interp(s_m, profile.s_m, profile.points[:, 2])
        return height - config.unknown_drop_m
    return np.interp(s_m, profile.s_m[known], profile.ground_z[known])


def _about(wires: Sequence[WireClearance], config: CoverageConfig) -> list[Finding]:
    least = [place for one in wires if (place := one.least("vegetation")) is not None and place.at_most]
    unseen = [place for place in least if place.air_seen is not None and place.air_seen < config.least_share]
    low = [place for place in least if place not in unseen]
    findings = []
    if unseen:
        listed = ", ".join(f"wire {place.wire}: {place.air_seen:.0%}" for place in unseen)
        findings.append(harms(
            LEAST,
            "Plants may stand nearer than the nearest that are found, whose distances are upper limits: of "
            f"the air nearer to the wire {config.min_images} images or more see less than "
            f"{config.least_share:.0%} ({listed}).",
            "See under Coverage, and take more images there, nearer to each other.",
        ))  # fmt: skip
    if low:
        listed = ", ".join(f"wire {place.wire}: {place.hidden_m:.1f} m" for place in low)
        findings.append(note(
            LEAST,
            "Nearer than the nearest plant that is found there may be others, low ones that do not stand out "
            "from the ground's scatter or green ones that too few images show. The distances are upper "
            f"limits, and plants may be as near as this: {listed}.",
        ))  # fmt: skip
    return findings
