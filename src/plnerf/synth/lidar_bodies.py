"""What returns a scanner's light: points on every body of a site, dense enough that no beam slips between.

World frame, metres; t targets, each with what it is, as an index into `KINDS`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from plnerf.line.base import Base
from plnerf.line.hang import Point
from plnerf.line.wire import Wire
from plnerf.synth.build import build_site
from plnerf.synth.foliage import plant_meshes
from plnerf.synth.houses import roof, walls
from plnerf.synth.insulators import insulators
from plnerf.synth.lidar_config import Boom, LidarScene, boom_middle
from plnerf.synth.meshes import Mesh, join, tube
from plnerf.synth.site import Line, Site
from plnerf.synth.tower import steel

KINDS = ("ground", "wire", "steel", "leaf", "building", "boom")
RETURNS = (0.97, 0.75, 0.6, 0.35, 1.0, 0.95)
"""Chance that a beam that meets a target of each kind returns light from it."""
SOLID = (True, False, False, False, True, False)
"""Whether nothing below it returns light."""
TARGET_STEP_M = 0.06
"""Spacing of targets on surfaces."""
WIRE_STEP_M = 0.05


@dataclass(frozen=True, eq=False)
class Targets:
    """Points that return light."""

    at: Float[np.ndarray, "t 3"]
    kind: Int[np.ndarray, " t"]


@dataclass(frozen=True, eq=False)
class Bodies:
    """The surfaces that clearances are measured to."""

    leaves: Float[np.ndarray, "l 3"]
    buildings: Float[np.ndarray, "b 3"]
    boom: Float[np.ndarray, "c 3"]


def lidar_site(scene: LidarScene) -> Site:
    """The site of the flight, on which suspension strings lean: wires and clamps are moved along the line.

    Raises ConfigError where it cannot stand.
    """
    site = build_site(scene.span)
    line, along = site.lines[0], np.array([*site.along, 0.0])
    reach = scene.span.support.string_length_m * np.tan(np.radians(scene.lean_deg))
    reach = reach * [wire.insulator == "string" for wire in line.config.wires]
    towers = tuple(
        replace(
            tower,
            held=_moved(tower.held, far, along),
            behind=_moved(tower.behind, far, along),
            ahead=_moved(tower.ahead, far, along),
        )
        for tower, far in zip(line.towers, reach, strict=True)
    )
    spans = []
    for k, span in enumerate(line.spans):
        wires = tuple(
            replace(wire, base=Base(wire.base.a + first * along[:2], wire.base.b + last * along[:2]))
            for wire, first, last in zip(span.wires, reach[k], reach[k + 1], strict=True)
        )
        spans.append(replace(span, towers=(towers[k], towers[k + 1]), wires=wires))
    return replace(site, lines=(replace(line, towers=towers, spans=tuple(spans)), *site.lines[1:]))


def _moved(
    places: Sequence[Point], far_m: Float[np.ndarray, " w"], along: Float[np.ndarray, "3"]
) -> tuple[Point, ...]:
    """Places of the wires in turn, or none."""
    moved = (np.array(at) + far * along for at, far in zip(places, far_m, strict=False))
    return tuple((float(x), float(y), float(z)) for x, y, z in moved)


def still_bodies(site: Site, scene: LidarScene, rng: np.random.Generator) -> tuple[Targets, Bodies]:
    """All but the ground and the wires of the spans, which move."""
    steels = [steel(tower) for tower in _main(site).towers[1:3]]
    steels += [mesh for tower in _main(site).towers[1:3] for mesh in insulators(_main(site), tower) if mesh]
    leaves = [plant_meshes(plant)[1] for plant in site.plants]
    houses = [mesh for house in site.houses for mesh in (walls(house), roof(house))]
    crane = boom_mesh(site, scene.boom)
    centres = [mesh.vertices.reshape(-1, 4, 3).mean(1) for mesh in leaves]
    parts = {
        "steel": [sampled(join([Mesh(mesh.vertices, mesh.faces) for mesh in steels]), rng)],
        "leaf": centres,
        "building": [sampled(Mesh(mesh.vertices, mesh.faces), rng) for mesh in houses],
        "boom": [sampled(crane, rng)],
    }
    none = np.zeros((0, 3))
    at = {name: np.concatenate([none, *some]) for name, some in parts.items()}
    kind = np.concatenate([np.full(len(some), KINDS.index(name)) for name, some in at.items()])
    bodies = Bodies(
        np.concatenate([none, *(mesh.vertices for mesh in leaves)]), at["building"], at["boom"]
    )
    return Targets(np.concatenate(list(at.values())), kind), bodies


def boom_mesh(site: Site, boom: Boom) -> Mesh:
    """The boom alone."""
    middle, azimuth = np.array(boom_middle(site, boom)), math.radians(boom.azimuth_deg)
    half = boom.length_m / 2 * np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
    return tube(np.array([middle - half, middle + half]), boom.radius_m)


def sampled(mesh: Mesh, rng: np.random.Generator) -> Float[np.ndarray, "t 3"]:
    """Points spread evenly, at random, over a mesh's faces."""
    a, b, c = mesh.vertices[mesh.faces].transpose(1, 0, 2)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    count = rng.poisson(area / TARGET_STEP_M**2)
    face = np.repeat(np.arange(len(area)), count)
    u, v = rng.random((2, len(face), 1))
    flip = u + v > 1
    u, v = np.where(flip, 1 - u, u), np.where(flip, 1 - v, v)
    points: Float[np.ndarray, "t 3"] = a[face] + u * (b - a)[face] + v * (c - a)[face]
    return points


def hung(wire: Wire, scene: LidarScene, strip: int | None) -> Float[np.ndarray, "v 3"]:
    """Points along a wire as it hangs during a strip; None: on average over all strips."""
    count = max(2, math.ceil(wire.base.length_m / WIRE_STEP_M)) + 1
    s = np.linspace(0.0, wire.base.length_m, count)
    if strip is None:
        states = [hung(wire, scene, k) for k in range(len(scene.scan.across_m))]
        mean: Float[np.ndarray, "v 3"] = np.mean(states, axis=0)
        return mean
    theta = wire.theta.copy()
    theta[5] += math.radians(scene.wind.gust_deg[strip])
    moved = Wire(wire.id, wire.base, theta, wire.covariance, wire.ends, wire.evidence)
    t, (one, other) = s / wire.base.length_m, scene.wind.uneven
    bow = float(theta[4]) * math.sin(theta[5])
    aside = bow * (one * np.sin(2 * np.pi * t) + other * np.sin(3 * np.pi * t))
    return wire.base.place(s, moved.at(s) + np.stack([aside, np.zeros(count)], 1))


def _main(site: Site) -> Line:
    return site.lines[0]
