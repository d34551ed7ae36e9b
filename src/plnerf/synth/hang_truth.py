"""truth.json of hung wires: the exact catenaries, where photos show them, and the photos' first poses."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np

from plnerf.line.catenary import lowest, sag
from plnerf.synth.hang_choose import HungWire, Place
from plnerf.synth.hang_config import HangConfig
from plnerf.synth.hang_sights import Sights
from plnerf.synth.seen import stretches

FORMAT_VERSION = 1
GENERATOR = "plnerf hang 1"
STATIONS = 400
"""Places along a wire at which photos are asked for it."""
PROFILE_EVERY = 10
"""Every so many of these are written to the profile."""
POLYLINE = 400
"""Pieces of a polyline."""


def truth_of(
    hung: Sequence[HungWire], place: Place, config: HangConfig, scene: str, unit: str
) -> dict[str, object]:
    """The content of truth.json.  scene: where the photos come from; unit: of its lengths, "m" or "unscaled".

    Keys end in `_m` in either unit.
    """
    choose = config.choose
    return {
        "format_version": FORMAT_VERSION,
        "generator": GENERATOR,
        "scene": scene,
        "world": "that of the scene the wires were hung in, turned upright: z up",
        "unit": unit,
        "seed": config.seed,
        "config": asdict(config),
        "images": len(place.views),
        "seen_rule": (
            f"seen_m: stretches (s from a along direction) that at least {choose.least_images} photos show, "
            "not hidden by the scene, whose planes of wire and camera span "
            f"{choose.least_angle_deg:g} degrees; looked at in {STATIONS} places"
        ),
        "profile_rule": (
            "for places s_m along the wire: the number of photos that show it, the angle their planes span, "
            "and the greatest and the median width in them (0: in none)"
        ),
        "pose_rule": "`poses` are those that the wires were drawn by, OpenGL camera-to-world; the photos' "
        "own are to be found again",
        "poses": [
            {"name": view.name, "T_world_camera": view.T_world_camera_opengl().tolist()}
            for view in place.views
        ],
        "catenary": "z(s) = z0 + p (cosh((s - s0)/p) - 1), s: horizontal distance from a along direction",
        "conductors": [_conductor(one, place) for one in hung],
        "towers": [],
    }


def _conductor(one: HungWire, place: Place) -> dict[str, object]:
    wire = one.wire
    assert wire.diameter_m is not None
    D, h, p = wire.plane
    (x, y), (ux, uy), z = wire.base.a.tolist(), wire.base.u.tolist(), wire.theta[2:4].tolist()
    s0, below = lowest(D, h, p)
    z0 = z[0] + below
    s = np.linspace(0, wire.base.length_m, STATIONS)
    seen = place.sights(wire.points(s))
    good = seen.observable(place.choose.least_images, place.choose.least_angle_deg)
    return {
        "name": wire.name,
        "kind": wire.kind,
        "group": one.group,
        "material": one.material,
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
        "seen_m": stretches(s, good),
        "images": _images(s, seen, wire.diameter_m, place),
        "profile": _profile(s, seen, wire.diameter_m),
        "polyline": np.round(wire.points(np.linspace(0, wire.base.length_m, POLYLINE + 1)), 7).tolist(),
    }


def _images(s: np.ndarray, seen: Sights, diameter: float, place: Place) -> list[dict[str, object]]:
    """The photos that show a wire: in which stretches, and how wide (10, 50 and 90 % of its places)."""
    found: list[dict[str, object]] = []
    for k, view in enumerate(place.views):
        if seen.seen[k].any():
            width = np.quantile(diameter * seen.px_per_unit[k, seen.seen[k]], (0.1, 0.5, 0.9))
            found.append({
                "name": view.name,
                "seen_m": stretches(s, seen.seen[k]),
                "width_px": np.round(width, 2).tolist(),
            })  # fmt: skip
    return found


def _profile(s: np.ndarray, seen: Sights, diameter: float) -> dict[str, object]:
    at = slice(0, None, PROFILE_EVERY)
    width = np.where(seen.seen, diameter * seen.px_per_unit, np.nan)[:, at]
    none = ~np.isfinite(width).any(0)
    width[:, none] = 0.0
    return {
        "s_m": np.round(s[at], 6).tolist(),
        "images": seen.images[at].tolist(),
        "angle_deg": np.round(seen.angle_deg[at], 2).tolist(),
        "widest_px": np.round(np.nanmax(width, 0), 2).tolist(),
        "median_px": np.round(np.nanmedian(width, 0), 2).tolist(),
    }


def summary_of(folder: Path) -> str:
    """A line about each wire of a folder of `plnerf hang`."""
    truth = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
    unit = "m" if truth["unit"] == "m" else "units"
    lines = []
    for wire in truth["conductors"]:
        widths = [image["width_px"][1] for image in wire["images"]]
        length = sum(high - low for low, high in wire["seen_m"])
        lines.append(
            f"{wire['name']} ({wire['material']}): in {len(widths)} of {truth['images']} photos, "
            f"{min(widths):.1f} to {max(widths):.1f} px wide (the photos' medians), observable over "
            f"{length:.3g} of {wire['span_m']:.3g} {unit}"
        )
    return "\n".join(lines)
