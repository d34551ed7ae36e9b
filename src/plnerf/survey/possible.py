"""What may be near to a wire, though too few images show it to count, or it may be a structure of the line
that was not found: a reader must look at it.

LineFrame, metres.
"""

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Int

from plnerf.findings import Finding, harms
from plnerf.line.clearances import GROUPS, SIGMAS, Group, Place, Possible, WireClearance
from plnerf.line.survey import Survey
from plnerf.survey.config_ground import ClearanceConfig
from plnerf.survey.crossarm_zone import in_crossarm_zone
from plnerf.survey.obstacles import is_shown, obstacles
from plnerf.survey.open_ends import at_open_end

POSSIBLE = "possible obstacles"
"""Kind of the finding."""


def possible_points(survey: Survey, config: ClearanceConfig) -> dict[Group, Int[np.ndarray, " _"]]:
    """Indices of the points that only too few images see, by group; none of clouds that are not of images."""
    found = obstacles(survey, config.obstacles, possible=True)
    found["ground"] = found["ground"][:0]  # ground is not judged
    return found


def find_possible(
    survey: Survey,
    wires: Sequence[WireClearance],
    places: Sequence[Place],
    config: ClearanceConfig,
) -> tuple[Possible, ...]:
    """Of the places at points that too few images see, those that would be the nearest to their wire: each
    thing once, where it is nearest, the nearest first."""
    cloud = survey.cloud
    if cloud.seen is None or cloud.past is None:
        return ()
    by_wire = {one.wire: one for one in wires}
    kept: list[Place] = []
    for place in sorted(places, key=lambda place: place.distance_m):
        if not _matters(place, by_wire[place.wire]):
            continue
        if all(np.linalg.norm(place.on_obstacle - one.on_obstacle) > config.apart_m for one in kept):
            kept.append(place)
    found, shown = [], is_shown(cloud, config.obstacles)
    for place in kept[: config.obstacles.max_possible]:
        i = int(np.flatnonzero((cloud.xyz == place.on_obstacle).all(1))[0])
        plant, at = place.to == "vegetation", np.array([i])
        end = plant and bool(at_open_end(survey, at, config.obstacles)[0])
        arm = plant and not end and bool(in_crossarm_zone(survey, at, config.obstacles)[0])
        alone = plant and not end and not arm and bool(shown[i])
        found.append(Possible(place, int(cloud.seen[i]), int(cloud.past[i]), end, arm, alone))
    return tuple(found)


def _matters(place: Place, known: WireClearance) -> bool:
    """Whether it is nearer than what counts in its group by more than both may be off; where nothing counts
    in the group, nearer than anything that does."""
    stated = [known.least(group) for group in ([place.to] if known.places[place.to] else GROUPS)]
    return all(
        one is None or place.distance_m < one.distance_m - SIGMAS * math.hypot(place.sigma_m, one.sigma_m)
        for one in stated
    )


def about_possible(found: Sequence[Possible]) -> list[Finding]:
    """What a reader must know of them; nothing where there are none."""
    if not found:
        return []
    nearest = found[0].place
    at = f"{nearest.distance_m:.2f} m from wire {nearest.wire}"
    things = "Something" if len(found) == 1 else f"{len(found)} things"
    near, each = ("", "It") if len(found) == 1 else ("the nearest ", "Each")
    few = any(not (one.at_open_end or one.at_structure or one.floats) for one in found)
    why = ", or ".join(
        ["too few images show it, or no more than see past it"] * few
        + ["it stands at an open end and may be a structure that was not found"]
        * any(one.at_open_end for one in found)
        + ["it stands beside a structure, about as high as its wires, and may be a part of it"]
        * any(one.at_structure for one in found)
        + ["it is thin and in the air, and may be a wire that was not found"]
        * any(one.floats for one in found)
    )
    what = f"{things} may be nearer to a wire than what counts, {near}{at}. {each} has no verdict, "
    what += f"because {why}."
    return [harms(POSSIBLE, what, "Look at their pictures, under Clearances.")]
