"""truth.json: what is exactly where in a synthetic span.  World frame, metres, z up, everywhere."""

from collections.abc import Sequence
from dataclasses import asdict

import numpy as np
from scipy.spatial import cKDTree

from plnerf.line.catenary import lowest, sag
from plnerf.line.wire import Wire
from plnerf.synth.capture import View
from plnerf.synth.config import SceneConfig
from plnerf.synth.foliage import plant_meshes
from plnerf.synth.hints import hints_of
from plnerf.synth.seen import SEEN_RULE
from plnerf.synth.span import Plant, Span, radius_m

FORMAT_VERSION = 1
GENERATOR = "plnerf synth 1"
POLYLINE_STEP_M = 0.25
MASK_COVERAGE = 0.1  # of a pixel's area, seen
CLEARANCE_RANGE_M = 40.0  # around mid-span; further off, along the span and so far across:
CLEARANCE_ACROSS_M = 18.0

Stretches = Sequence[tuple[float, float]]


def truth_of(
    span: Span, config: SceneConfig, views: Sequence[View], seen: Sequence[Stretches] | None = None
) -> dict[str, object]:
    """The content of truth.json.

    `views` are the true ones.  `seen` lists for each conductor the stretches that the images show.
    """
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
        "seed": span.config.seed,
        "config": asdict(config),
        "images": len(views),
        "wire_mask_rule": (
            f"255 where a conductor or shield wire fills {MASK_COVERAGE:.0%} or more of the pixel, "
            "by 36 samples, one in each cell of a 6 x 6 grid; insulators, clamps and dampers are not wires"
        ),
        "depth_rule": "along the camera's z axis at the pixel's centre, uint16 millimetres; "
        "0: sky, or further than 65.535 m",
        "seen_rule": SEEN_RULE,
        "pose_rule": "the images are taken at the poses of transforms.json"
        if not noisy
        else "the images are taken at `poses`, OpenGL camera-to-world as in transforms.json, whose own are "
        "off by config.capture.pose_noise_m and pose_noise_deg (normal, each axis)",
        **({"poses": true_poses} if noisy else {}),
        "catenary": "z(s) = z0 + p (cosh((s - s0)/p) - 1), s: horizontal distance from a along direction",
        "conductors": [
            _conductor(wire, None if seen is None else seen[i]) for i, wire in enumerate(span.wires)
        ],
        "towers": [
            {
                "name": tower.name,
                "kind": span.config.support.kind,
                "foot": tower.foot,
                "height_m": tower.height_m,
                "attachments": tower.attachments,
            }
            for tower in span.towers
        ],
        "houses": [{k: v for k, v in asdict(house).items() if k != "seed"} for house in span.houses],
        "hints": hints_of(span, config.capture),
        "ground": _ground(span),
        "vegetation": _vegetation(span),
    }


def _conductor(wire: Wire, seen: Stretches | None) -> dict[str, object]:
    D, h, p = wire.plane
    (x, y), (ux, uy), z = wire.base.a.tolist(), wire.base.u.tolist(), wire.theta[2:4].tolist()
    s0, below = lowest(D, h, p)  # of the whole curve: on a slope outside the span
    z0 = z[0] + below
    return {
        "name": wire.name,
        "kind": wire.kind,
        "diameter_m": wire.diameter_m,
        "a": (x, y, z[0]),
        "b": (*wire.base.b.tolist(), z[1]),
        "direction": (ux, uy),
        "span_m": D,
        "p_m": p,
        "s0_m": s0,
        "z0_m": z0,
        "lowest": (x + ux * s0, y + uy * s0, z0),
        "sag_m": sag(D, h, p),
        "length_m": wire.length_m,
        **({} if seen is None else {"seen_m": list(seen)}),
        "polyline": np.round(wire.polyline(POLYLINE_STEP_M), 6).tolist(),
    }


def _ground(span: Span) -> dict[str, object]:
    """Heights at 1 m steps along the line, and at the same steps 5 m and 10 m to either side."""
    half = span.config.span_length_m / 2 + 5
    along = np.arange(-np.floor(half), np.floor(half) + 1)
    rows = []
    for across in (-10.0, -5.0, 0.0, 5.0, 10.0):
        x, y = np.array([span.at(float(distance), across) for distance in along]).T
        points = np.stack([x, y, span.ground.heights(x, y)], axis=1)
        rows.append({"across_m": across, "points": np.round(points, 4).tolist()})
    return {"rule": "1 m steps along the line, 0 at mid-span; across_m to the left positive", "rows": rows}


def _beside(span: Span, plant: Plant) -> bool:
    (ux, uy), (x, y, _) = span.along, plant.foot
    return abs(ux * x + uy * y) < span.config.span_length_m / 2 and abs(ux * y - uy * x) < CLEARANCE_ACROSS_M


def _vegetation(span: Span) -> list[dict[str, object]]:
    """Every plant; near ones with their clearance: the least distance from leaf to conductor surface."""
    axes = [wire.polyline(0.02) for wire in span.wires]
    radii = np.repeat([radius_m(wire) for wire in span.wires], [len(axis) for axis in axes])
    tree = cKDTree(np.concatenate(axes))

    def entry(plant: Plant) -> dict[str, object]:
        found: dict[str, object] = {
            "kind": plant.kind,
            "foot": plant.foot,
            "radius_m": plant.radius_m,
            "height_m": plant.height_m,
        }
        if np.hypot(*plant.foot[:2]) < CLEARANCE_RANGE_M or _beside(span, plant):
            distance, nearest = tree.query(plant_meshes(plant)[1].vertices)
            best = int(np.argmin(distance))
            owners = np.cumsum([len(axis) for axis in axes])
            owner = int(np.searchsorted(owners, nearest[best], side="right"))
            found["clearance_m"] = round(float(distance[best] - radii[nearest[best]]), 4)
            found["nearest_conductor"] = span.wires[owner].name
        return found

    return [entry(plant) for plant in span.plants]
