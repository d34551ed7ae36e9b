"""A survey drawn in space: wires as curves, structures, names with sag, clearances, what was not seen.

Each kind of thing is a node of the scene of its own, below which its parts are, so that it can be hidden.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
import viser
from jaxtyping import Float

from plnerf.line.cloud import TOWER
from plnerf.line.coverage import Coverage
from plnerf.line.line import Line, Structure
from plnerf.line.stations import Stretch, chains
from plnerf.line.survey import Survey
from plnerf.line.wire import Wire
from plnerf.report.colours import CLASSES, KINDS, MARK, rgb
from plnerf.report.figures import Units
from plnerf.report.nearest import Nearest, by_need, worst
from plnerf.view.display_frame import DisplayFrame

CURVE_STEP_M = 0.5
"""Between a curve's points, which are joined by straight lines: d^2 / 8p = 0.05 mm for p = 600 m."""
WIRE_PX, MAST_PX, MARK_PX = 3.0, 4.0, 2.5
RED, AMBER, GREEN = (200, 30, 30), (225, 140, 20), (60, 150, 80)
OPACITY = 0.35
LEAST_ASIDE_M = 2.0
ABOVE_MAST = 0.1
"""How far above a structure its name stands, as a share of its height: names of wires stand at its top."""

Part = Literal["wires", "structures", "names", "clearances", "coverage"]


@dataclass(frozen=True, eq=False)
class Ribbon:
    """A stretch of a corridor, with the colour of what was seen of it."""

    corners: Float[np.ndarray, "4 3"]
    colour: tuple[int, int, int]


def draw_line(
    scene: viser.SceneApi, survey: Survey, frame: DisplayFrame
) -> dict[Part, viser.SceneNodeHandle]:
    """Draws all of it; returns the nodes by which each part can be hidden, of those that have something."""
    units = Units(survey.frame.unit)
    parts: dict[Part, viser.SceneNodeHandle] = {}

    def part(name: Part) -> str:
        if name not in parts:
            parts[name] = scene.add_frame(f"/line/{name}", show_axes=False)
        return f"/line/{name}"

    for number, wire in enumerate(survey.wires):
        curve = frame.to_viewer(wire.polyline(CURVE_STEP_M))
        part("wires")
        segments(scene, wire_node(wire), curve, rgb(KINDS[wire.kind][1]), WIRE_PX)
        share = (0.5, 0.35, 0.65, 0.2, 0.8)[number % 5]  # names beside each other would hide each other
        at = curve[round(share * (len(curve) - 1))]
        label(scene, f"{part('names')}/wire {wire.id}", wire_name(wire, units), at)
    for one in survey.structures:
        mast = frame.to_viewer(np.stack([one.foot, one.top]))
        segments(scene, f"{part('structures')}/{one.id}", mast, rgb(CLASSES[TOWER][1]), MAST_PX)
        above = mast[1] + ABOVE_MAST * (mast[1] - mast[0])
        label(scene, f"{part('names')}/structure {one.id}", structure_name(one, units), above)
    for number, (text, at) in enumerate(span_names(survey, units)):
        label(scene, f"{part('names')}/span {number}", text, frame.to_viewer(at))
    for number, place in enumerate(clearances_shown(survey)):
        name = f"{part('clearances')}/{number}"
        gap = frame.to_viewer(np.stack([place.place.on_wire, place.place.on_obstacle]))
        segments(scene, name, gap, RED if place.standing == "short" else rgb(MARK), MARK_PX)
        share = (0.35, 0.5, 0.65)[number % 3]  # neighbours would cover each other
        label(scene, f"{name}/text", clearance_name(place, units), (1 - share) * gap[0] + share * gap[1])
    for number, ribbon in enumerate(ribbons(survey)):
        scene.add_mesh_simple(
            f"{part('coverage')}/{number}", frame.to_viewer(ribbon.corners),
            np.array([[0, 1, 2], [0, 2, 3]]), color=ribbon.colour, opacity=OPACITY, side="double",
            flat_shading=True, cast_shadow=False, receive_shadow=False,
        )  # fmt: skip
    return parts


def wire_node(wire: Wire) -> str:
    """The name of a wire's node."""
    return f"/line/wires/{wire.id}"


def segments(
    scene: viser.SceneApi, name: str, curve: Float[np.ndarray, "v 3"], colour: tuple[int, int, int], px: float
) -> viser.SceneNodeHandle:
    """A polyline of some pixels' width, whatever its distance."""
    pairs = np.stack([curve[:-1], curve[1:]], 1)
    return scene.add_line_segments(name, pairs, colour, thickness=px, thickness_units="screen")


def label(scene: viser.SceneApi, name: str, text: str, at: Float[np.ndarray, "3"]) -> viser.SceneNodeHandle:
    """A text at a place."""
    return scene.add_label(name, text, position=at, font_screen_scale=1.1, anchor="bottom-center")


def wire_name(wire: Wire, units: Units) -> str:
    """Its number and its sag; of a wire without one its number alone."""
    sag = wire.sag
    return f"wire {wire.id}" + (f" · sag {units.interval_with_unit(sag)}" if sag is not None else "")


def structure_name(one: Structure, units: Units) -> str:
    """Its number, its kind if that is known, and its height."""
    kind = "" if one.kind == "unknown" else f" · {one.kind}"
    return f"structure {one.name or one.id}{kind} · {units.with_unit(one.height_m, 1)} high"


def span_names(survey: Survey, units: Units) -> Iterator[tuple[str, Float[np.ndarray, "3"]]]:
    """The length of each span between two structures, and a place above its wires."""
    for span in survey.spans:
        lengths = [wire.span_m for wire in span.wires if wire.span_m is not None]
        if not lengths:
            continue
        middles = np.concatenate([wire.points(np.array([wire.base.length_m / 2])) for wire in span.wires])
        top = middles.mean(0)
        top[2] = middles[:, 2].max() + 0.02 * lengths[0].value
        yield f"span {span.id} · {units.with_unit(float(np.mean([one.value for one in lengths])), 1)}", top


def clearances_shown(survey: Survey) -> list[Nearest]:
    """The worst to each group, and all that are closer than required."""
    rows = by_need(survey)
    chosen = worst(rows)
    return chosen + [one for one in rows if one.standing == "short" and one not in chosen]


def clearance_name(one: Nearest, units: Units) -> str:
    """The distance with its 95 % interval, to what, and the verdict if there is one."""
    verdict = f" · {one.verdict}" if one.verdict is not None else ""
    return f"{one.sign}{units.interval_with_unit(one.distance)} to {one.to}{verdict}"


def ribbons(survey: Survey) -> Iterator[Ribbon]:
    """Below each stretch of a span's wires: green where ground and air were seen, else amber or red."""
    by_span = {(one.line, one.span): one for one in survey.coverage}
    for line in survey.lines:
        for chain in chains(line):
            for stretch in chain:
                found = by_span.get((line.id, stretch.span.id))
                if found is not None:
                    yield from _ribbons(survey, line, stretch, found)


def _ribbons(survey: Survey, line: Line, stretch: Stretch, found: Coverage) -> Iterator[Ribbon]:
    local = np.concatenate([
        stretch.base.local(wire.points(np.linspace(0, wire.base.length_m, 9))) for wire in stretch.span.wires
    ])  # fmt: skip
    low, high = float(local[:, 1].min()), float(local[:, 1].max())
    aside = max(LEAST_ASIDE_M, 0.1 * (high - low))
    z = _ground_z(survey, stretch)
    unseen = found.no_ground.astype(int) + found.no_air.astype(int)
    for k, count in enumerate(unseen):
        ends = np.array([found.from_m[k], found.to_m[k], found.to_m[k], found.from_m[k]]) - stretch.from_m
        y = np.array([low - aside, low - aside, high + aside, high + aside])
        corners = stretch.base.place(ends, np.stack([y, np.full(4, z)], 1))
        yield Ribbon(corners, (GREEN, AMBER, RED)[count])


def _ground_z(survey: Survey, stretch: Stretch) -> float:
    """The ground's height below a span's wires where it is known, else below all of them."""
    ids = {wire.id for wire in stretch.span.wires}
    rows = survey.clearances.wires if survey.clearances is not None else ()
    known = [one.profile.ground_z for one in rows if one.wire in ids]
    heights = np.concatenate(known) if known else np.empty(0)
    if np.isfinite(heights).any():
        return float(np.nanmedian(heights))
    return min(wire.lowest[1] for wire in stretch.span.wires) - LEAST_ASIDE_M
