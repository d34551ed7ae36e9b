"""truth.json: what is exactly where in a synthetic scene.  World frame, metres, z up, everywhere."""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np

from plnerf.line.catenary import lowest
from plnerf.line.curve import vertical_sag
from plnerf.line.wire import Wire
from plnerf.synth.capture import View
from plnerf.synth.config import SceneConfig
from plnerf.synth.hints import hints_of
from plnerf.synth.near_plants import PLANTS_RULE, Leaves, NearLeaf
from plnerf.synth.seen import OBSERVABLE_RULE, SEEN_RULE
from plnerf.synth.site import Line, Plant, Site, Tower

FORMAT_VERSION = 1
GENERATOR = "plnerf synth 1"
POLYLINE_STEP_M = 0.25
MASK_COVERAGE = 0.1  # of a pixel's area, seen

Stretches = Sequence[tuple[float, float]]


@dataclass(frozen=True)
class Shows:
    """What the images show of each conductor, in their order."""

    seen: Sequence[Stretches]
    observable: Sequence[Stretches]


def truth_of(
    site: Site,
    config: SceneConfig,
    views: Sequence[View],
    plants: Sequence[Leaves],
    shows: Shows | None = None,
) -> dict[str, object]:
    """The content of truth.json; `views` are the true ones, `plants` stand in the site's order."""
    noisy = config.capture.pose_noise_m > 0 or config.capture.pose_noise_deg > 0
    true_poses = [
        {"name": view.name, "T_world_camera": view.T_world_camera_opengl().tolist()} for view in views
    ]
    return {
        "format_version": FORMAT_VERSION,
        "scene": config.name,
        "generator": GENERATOR,
        "world": "local east-north-up, metres, z up, origin on the ground at mid-span",
        "unit": "m",
        "seed": site.config.seed,
        "config": asdict(config),
        "images": len(views),
        "wire_mask_rule": (
            f"255 where a conductor or shield wire fills {MASK_COVERAGE:.0%} or more of the pixel, "
            "by 36 samples, one in each cell of a 6 x 6 grid; insulators, clamps and dampers are not wires"
        ),
        "depth_rule": "along the camera's z axis at the pixel's centre, uint16 millimetres; "
        "0: sky, or further than 65.535 m",
        "seen_rule": SEEN_RULE,
        "observable_rule": OBSERVABLE_RULE,
        "plants_rule": PLANTS_RULE,
        "pose_rule": "the images are taken at the poses of transforms.json"
        if not noisy
        else "the images are taken at `poses`, OpenGL camera-to-world as in transforms.json, whose own are "
        "off by config.capture.pose_noise_m and pose_noise_deg (normal, each axis)",
        **({"poses": true_poses} if noisy else {}),
        "catenary": "z(s) = z0 + p (cosh((s - s0)/p) - 1), s: horizontal distance from a along direction; "
        "where swing_deg is stated the curve is a catenary of p_m in the plane through a and b that is "
        "turned by so much to the left of upright about the direction",
        "conductors": _conductors(site, shows),
        "towers": [_tower(line, tower) for line in site.lines for tower in line.towers],
        "houses": [{k: v for k, v in asdict(house).items() if k != "seed"} for house in site.houses],
        "hints": hints_of(site, config.capture),
        "ground": _ground(site),
        "vegetation": [_plant(*one) for one in zip(site.plants, plants, strict=True)],
    }


def _conductors(site: Site, shows: Shows | None) -> list[dict[str, object]]:
    owners = [(line, span) for line in site.lines for span in line.spans for _ in span.wires]
    rows = []
    for i, ((line, span), wire) in enumerate(zip(owners, site.wires, strict=True)):
        row = _conductor(wire)
        row |= {"line": line.number, "span": span.number}
        row |= (
            {}
            if shows is None
            else {
                "seen_m": list(shows.seen[i]),
                "observable_m": list(shows.observable[i]),
            }
        )
        row["polyline"] = np.round(wire.polyline(POLYLINE_STEP_M), 6).tolist()
        rows.append(row)
    return rows


def _conductor(wire: Wire) -> dict[str, object]:
    D, h, p = wire.plane
    (x, y), (ux, uy), z = wire.base.a.tolist(), wire.base.u.tolist(), wire.theta[2:4].tolist()
    curve: dict[str, object] = {"p_m": p}
    if wire.swing_rad:
        s, height = wire.lowest  # between its ends
        across = float(wire.at(np.array([s]))[0, 0])
        curve |= {"swing_deg": math.degrees(wire.swing_rad)}
        curve |= {"lowest": (x + ux * s - uy * across, y + uy * s + ux * across, height)}
    else:
        s0, below = lowest(D, h, p)  # of the whole curve: on a slope outside the span
        z0 = z[0] + below
        curve |= {"s0_m": s0, "z0_m": z0, "lowest": (x + ux * s0, y + uy * s0, z0)}
    return {
        "name": wire.name,
        "kind": wire.kind,
        "diameter_m": wire.diameter_m,
        "a": (x, y, z[0]),
        "b": (*wire.base.b.tolist(), z[1]),
        "direction": (ux, uy),
        "span_m": wire.base.length_m,
        **curve,
        "sag_m": vertical_sag(wire.theta, wire.base.length_m),
        "length_m": wire.length_m,
    }


def _tower(line: Line, tower: Tower) -> dict[str, object]:
    inner = len(line.beside(tower)) == 2
    return {
        "name": tower.name,
        "kind": tower.design.support.kind,
        "foot": tower.foot,
        "height_m": tower.height_m,
        "attachments": tower.attachments,
        "line": line.number,
        "number": line.towers.index(tower) + 1,
        "structure": tower.config.kind,
        "line_angle_deg": tower.config.turn_deg if inner else None,
    }


def _ground(site: Site) -> dict[str, object]:
    """Heights at 1 m steps along the first line, and at the same steps 5 m and 10 m to either side."""
    first, last = site.route.stations_m[0] - 5, site.route.stations_m[-1] + 5
    along = np.arange(-np.floor(-first), np.floor(last) + 1)
    rows = []
    for across in (-10.0, -5.0, 0.0, 5.0, 10.0):
        x, y = np.array([site.at(float(distance), across) for distance in along]).T
        points = np.stack([x, y, site.ground.heights(x, y)], axis=1)
        rows.append({"across_m": across, "points": np.round(points, 4).tolist()})
    return {"rule": "1 m steps along the line, 0 at mid-span; across_m to the left positive", "rows": rows}


def _plant(plant: Plant, leaves: Leaves) -> dict[str, object]:
    """A plant; a near one with its clearance, the least distance from leaf to conductor surface."""
    found: dict[str, object] = {
        "kind": plant.kind,
        "foot": plant.foot,
        "radius_m": plant.radius_m,
        "height_m": plant.height_m,
    }
    if leaves:
        found |= {
            "clearance_m": round(leaves[0].clearance_m, 4),
            "nearest_conductor": leaves[0].conductor,
        }
        if leaves[0].observable is not None:
            found["observable"] = leaves[0].observable
        found["leaves"] = {
            name: [_leaf(one) for one in leaves if one.conductor == name]
            for name in dict.fromkeys(one.conductor for one in leaves)
        }
    return found


def _leaf(leaf: NearLeaf) -> list[float]:
    shown = [] if leaf.observable is None else [float(leaf.observable)]
    return [*(round(x, 3) for x in leaf.leaf.tolist()), round(leaf.clearance_m, 3), *shown]
