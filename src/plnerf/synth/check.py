"""What a configuration's numbers do not show: do wires clear the ground, are cameras in free air?

World frame, metres.  Every refusal is a ConfigError that names the thing, the place and what to change.
"""

from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import cKDTree

from plnerf.errors import ConfigError
from plnerf.synth.capture import View
from plnerf.synth.houses import inside_m
from plnerf.synth.insulators import insulators, jumpers, spacers
from plnerf.synth.meshes import Mesh
from plnerf.synth.pole import irons, wood
from plnerf.synth.site import Line, Site, Tower, radius_m
from plnerf.synth.tower import half_width_m, steel

Points = Float[np.ndarray, "_ 3"]
Collisions = Iterator[tuple[str, Bool[np.ndarray, " n"]]]
"""Bodies in words, and which cameras are inside of them or too close."""

KEEP_OFF_M = 0.3  # a camera is as large as this
EDGE_STEP_M = 0.15
APART_M = 1.0  # between the wires of one line and all of another


def check_wires(site: Site) -> None:
    """Refuse wires that touch the ground or each other, and supports whose clamps lie in the ground."""
    for line in site.lines:
        for tower in line.towers:
            _check_clamps(site, line, tower)
    lines = [(wire, wire.polyline(0.1)) for wire in site.wires]
    for wire, points in lines:
        room = points[:, 2] - site.ground.heights(points[:, 0], points[:, 1]) - radius_m(wire)
        lowest = int(room.argmin())
        if room[lowest] <= 0:
            along = float(site.route.stations_of(points[lowest][None])[0])
            raise ConfigError(
                f"synth: {wire.name} touches the ground {along:.1f} m from mid-span, by "
                f"{-room[lowest]:.2f} m. "
                "Raise it (height_m), reduce its sag_m or flatten the ground (rise_m, waves)."
            )
    _check_apart(site)


def _check_clamps(site: Site, line: Line, tower: Tower) -> None:
    spans = [span for _, span in line.beside(tower)]
    clamps = np.array((*tower.behind, *tower.ahead))
    names = [wire.name for span in spans for wire in span.wires]
    buried = clamps[:, 2] - site.ground.heights(clamps[:, 0], clamps[:, 1])
    if buried.min() <= 0:
        raise ConfigError(
            f"synth: the clamp of {names[int(buried.argmin())]} on support {tower.name} lies "
            f"{-buried.min():.2f} m inside the "
            "terrain. Raise the wire (height_m) or flatten the ground (rise_m, waves)."
        )


def _check_apart(site: Site) -> None:
    """Refuse lines whose wires come near to each other's wires or supports."""
    if len(site.lines) < 2:
        return
    wires = [
        np.concatenate([wire.polyline(0.2) for span in line.spans for wire in span.wires])
        for line in site.lines
    ]
    for i, own in enumerate(wires):
        for j, line in enumerate(site.lines):
            if i == j:
                continue
            towers = [tower for tower in line.towers if _reaches(tower, own)]
            bodies = [edge_points(mesh) for tower in towers for mesh in support_meshes(site, tower)]
            near = cKDTree(np.concatenate([wires[j], *bodies])).query(own, distance_upper_bound=APART_M)[0]
            if near.min() < APART_M:
                raise ConfigError(
                    f"synth: a wire of line {i + 1} comes within {near.min():.2f} m of line {j + 1}, but at "
                    f"least {APART_M:g} m are needed. Raise one of them, or move its middle_m."
                )


def _reaches(tower: Tower, points: Points) -> bool:
    """Whether any point is so near to the tower's axis that it may be at its body, arms or strings."""
    reach = max(abs(wire.across_m) for wire in tower.design.wires) + tower.design.support.foot_m + 4.0
    return bool((np.linalg.norm(points[:, :2] - tower.foot[:2], axis=1) < reach).any())


def check_cameras(site: Site, views: Sequence[View]) -> None:
    """Refuse cameras below the ground, in a tree, a house or a support, or at a wire.

    Views carry names, passes and centres; the message names the first view that collides, and with what.
    """
    _refuse(views, _collisions(site, np.array([view.centre for view in views])))


def check_growth(site: Site, views: Sequence[View]) -> None:
    """`check_cameras` of plants and houses alone."""
    _refuse(views, _growth(site, np.array([view.centre for view in views])))


def _refuse(views: Sequence[View], collisions: Collisions) -> None:
    for what, hit in collisions:
        if hit.any():
            i = int(hit.argmax())
            place = ", ".join(f"{value:.1f}" for value in views[i].centre)
            raise ConfigError(
                f"synth: the camera of image {views[i].name} (pass {views[i].flight_pass}) at ({place}) is "
                f"{what}. Move the pass (across_m, above_m, start, end), swing less (weave_m, heave_m, "
                "zigzag_m) or take the obstacle away."
            )


def _collisions(site: Site, centres: Points) -> Collisions:
    """Each body, in words, and which camera centres are inside of it or too close."""
    yield (
        "below the ground",
        centres[:, 2] < site.ground.heights(centres[:, 0], centres[:, 1]) + KEEP_OFF_M,
    )
    yield from _growth(site, centres)
    for line in site.lines:
        for tower in line.towers:
            if _reaches(tower, centres):
                yield from _of_tower(site, line, tower, centres)
    for wire in site.wires:
        yield f"at the wire {wire.name}", _near(wire.polyline(0.1), centres)
    between = spacers(site.spans)
    if between is not None:
        yield "at a spacer", _near(edge_points(between), centres)


def _growth(site: Site, centres: Points) -> Collisions:
    """Plants and houses."""
    for i, plant in enumerate(site.plants):
        away = centres - np.array(plant.foot)
        inside = np.hypot(away[:, 0], away[:, 1]) < plant.radius_m + KEEP_OFF_M
        yield f"inside {plant.kind} {i}", inside & (away[:, 2] < plant.height_m + KEEP_OFF_M)
    for house in site.houses:
        yield f"inside {house.name}", inside_m(house, centres) > -KEEP_OFF_M


def _of_tower(site: Site, line: Line, tower: Tower, centres: Points) -> Collisions:
    """A support and what it carries."""
    local = (centres - np.array(tower.foot)) @ tower.axes
    if tower.design.support.kind == "lattice":
        half = np.array([half_width_m(tower.design, max(0.0, z)) for z in local[:, 2]]) + KEEP_OFF_M
        within = (np.abs(local[:, :2]) < half[:, None]).all(axis=1) & (local[:, 2] < tower.height_m)
        yield f"inside the {tower.name} tower", within
    porcelain, metal = insulators(line, tower)
    carriers = [mesh for mesh in (porcelain, metal, jumpers(line, tower)) if mesh is not None]
    for body in [*support_meshes(site, tower), *carriers]:
        yield f"inside the {tower.name} support", _near(edge_points(body), centres)


def support_meshes(site: Site, tower: Tower) -> list[Mesh]:
    """The tower or pole itself."""
    if tower.design.support.kind == "lattice":
        return [steel(tower)]
    return [wood(site, tower), *irons(tower)]


def edge_points(mesh: Mesh, step_m: float = EDGE_STEP_M) -> Points:
    """Points on all edges of a mesh, at most `step_m` apart."""
    corners = mesh.vertices[mesh.faces]
    a = corners.reshape(-1, 3)
    b = np.roll(corners, -1, axis=1).reshape(-1, 3)
    count = np.ceil(np.linalg.norm(b - a, axis=1) / step_m).astype(int) + 1
    owner = np.repeat(np.arange(len(a)), count)
    within = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
    share = within / np.maximum(count[owner] - 1, 1)
    return a[owner] + share[:, None] * (b - a)[owner]


def _near(points: Points, centres: Points) -> np.ndarray:
    low, high = centres.min(axis=0) - KEEP_OFF_M, centres.max(axis=0) + KEEP_OFF_M
    close = points[((points > low) & (points < high)).all(axis=1)]
    if len(close) == 0:
        return np.zeros(len(centres), dtype=bool)
    distance, _ = cKDTree(close).query(centres, distance_upper_bound=2 * KEEP_OFF_M)
    return distance < KEEP_OFF_M
