"""What a configuration's numbers do not show: do wires clear the ground, are cameras in free air?

World frame, metres.  Every refusal is a ConfigError that names the thing, the place and what to change.
"""

from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Float
from scipy.spatial import cKDTree

from plnerf.errors import ConfigError
from plnerf.synth.capture import View
from plnerf.synth.houses import inside_m
from plnerf.synth.insulators import insulators, spacers
from plnerf.synth.meshes import Mesh
from plnerf.synth.pole import irons, wood
from plnerf.synth.span import Span, Tower, radius_m
from plnerf.synth.tower import half_width_m, steel

Points = Float[np.ndarray, "_ 3"]

KEEP_OFF_M = 0.3  # a camera is as large as this
EDGE_STEP_M = 0.15


def check_wires(span: Span) -> None:
    """Refuse wires that touch the ground and supports whose clamps lie in it."""
    for tower in span.towers:
        clamps = np.array(tower.attachments)
        buried = clamps[:, 2] - span.ground.heights(clamps[:, 0], clamps[:, 1])
        if buried.min() <= 0:
            name = span.wires[int(buried.argmin())].name
            raise ConfigError(
                f"synth: the clamp of {name} on support {tower.name} lies {-buried.min():.2f} m inside the "
                "terrain. Raise the wire (height_m) or flatten the ground (rise_m, waves)."
            )
    for wire in span.wires:
        points = wire.polyline(0.1)
        room = points[:, 2] - span.ground.heights(points[:, 0], points[:, 1]) - radius_m(wire)
        lowest = int(room.argmin())
        if room[lowest] <= 0:
            x, y, _ = points[lowest]
            along = span.along[0] * x + span.along[1] * y
            raise ConfigError(
                f"synth: {wire.name} touches the ground {along:.1f} m from mid-span, by "
                f"{-room[lowest]:.2f} m. "
                "Raise it (height_m), reduce its sag_m or flatten the ground (rise_m, waves)."
            )


def check_cameras(span: Span, views: Sequence[View]) -> None:
    """Refuse cameras below the ground, in a tree, a house or a support, or at a wire.

    Views carry names, passes and centres; the message names the first view that collides, and with what.
    """
    centres = np.array([view.centre for view in views])
    for what, hit in _collisions(span, centres):
        if hit.any():
            i = int(hit.argmax())
            place = ", ".join(f"{value:.1f}" for value in centres[i])
            raise ConfigError(
                f"synth: the camera of image {views[i].name} (pass {views[i].flight_pass}) at ({place}) is "
                f"{what}. Move the pass (across_m, above_m, start, end), swing less (weave_m, heave_m, "
                "zigzag_m) or take the obstacle away."
            )


def _collisions(span: Span, centres: Points) -> Iterator[tuple[str, np.ndarray]]:
    """Each body, in words, and which camera centres are inside of it or too close."""
    yield (
        "below the ground",
        centres[:, 2] < span.ground.heights(centres[:, 0], centres[:, 1]) + KEEP_OFF_M,
    )
    for i, plant in enumerate(span.plants):
        away = centres - np.array(plant.foot)
        inside = np.hypot(away[:, 0], away[:, 1]) < plant.radius_m + KEEP_OFF_M
        yield f"inside {plant.kind} {i}", inside & (away[:, 2] < plant.height_m + KEEP_OFF_M)
    for house in span.houses:
        yield f"inside {house.name}", inside_m(house, centres) > -KEEP_OFF_M
    for tower in span.towers:
        local = (centres - np.array(tower.foot)) @ _line_axes(span)
        if span.config.support.kind == "lattice":
            half = np.array([half_width_m(span.config, max(0.0, z)) for z in local[:, 2]]) + KEEP_OFF_M
            within = (np.abs(local[:, :2]) < half[:, None]).all(axis=1) & (local[:, 2] < tower.height_m)
            yield f"inside the {tower.name} tower", within
        porcelain, metal = insulators(span, tower)
        carriers = [metal] if porcelain is None else [porcelain, metal]
        for body in [*support_meshes(span, tower), *carriers]:
            yield f"inside the {tower.name} support", _near(edge_points(body), centres)
    for wire in span.wires:
        yield f"at the wire {wire.name}", _near(wire.polyline(0.1), centres)
    between = spacers(span)
    if between is not None:
        yield "at a spacer", _near(edge_points(between), centres)


def support_meshes(span: Span, tower: Tower) -> list[Mesh]:
    """The tower or pole itself."""
    if span.config.support.kind == "lattice":
        return [steel(span, tower)]
    return [wood(span, tower), *irons(span, tower)]


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


def _line_axes(span: Span) -> Float[np.ndarray, "3 3"]:
    """Columns: along the line, across it, up."""
    ux, uy = span.along
    return np.array([[ux, -uy, 0.0], [uy, ux, 0.0], [0.0, 0.0, 1.0]])
