"""Gabled houses: where they stand, and their walls, roofs and windows as meshes.

House axes: x along the ridge, y across it, z above the floor, metres.  Colours are linear reflectance.
"""

import math

import numpy as np
from jaxtyping import Float

from plnerf.synth.meshes import Mesh, beam, grid, join, up
from plnerf.synth.site import House, Site

WALLS = ((0.55, 0.50, 0.42), (0.30, 0.13, 0.085), (0.42, 0.40, 0.38), (0.60, 0.57, 0.50))  # plaster, brick
ROOFS = ((0.20, 0.065, 0.04), (0.075, 0.072, 0.075), (0.16, 0.075, 0.05))
EAVE_OUT_M = 0.45  # how far the roof reaches beyond the walls
ACROSS_M = (16.5, 20.0)  # from the line to the house's middle


def place_houses(site: Site, rng: np.random.Generator) -> tuple[House, ...]:
    """Houses in a row on each side in turn, the first behind the road, gables or eaves to the line."""
    houses = []
    half, count = site.config.span_length_m / 2, site.config.houses
    for i in range(count):
        side = -1.0 if i % 2 == 0 else 1.0
        per_side = (count + 1 - i % 2) // 2
        along = site.config.terrain.centre_m + half * (2 * (i // 2 + rng.uniform(0.3, 0.7)) / per_side - 1)
        x, y = site.at(along, side * rng.uniform(*ACROSS_M))
        width, eaves = rng.uniform(6.4, 7.6), rng.uniform(2.6, 3.1)
        length = rng.uniform(8.5, 10.5)
        ridge = eaves + width / 2 * math.tan(math.radians(rng.uniform(36.0, 43.0)))
        turned = site.config.line_azimuth_deg + rng.choice([0.0, 90.0]) + rng.uniform(-4.0, 4.0)
        houses.append(
            House(f"house {i + 1}", site.ground.point(x, y), turned, length, width, eaves, ridge,
                  int(rng.integers(2**31)))
        )  # fmt: skip
    return tuple(houses)


def inside_m(house: House, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
    """How deep points lie inside the house's hull of walls and roof (negative: outside, not a distance)."""
    local = (points - np.array(house.foot)) @ _turn(house)
    slope = (house.ridge_m - house.eaves_m) / (house.width_m / 2)
    roof = house.ridge_m - slope * np.abs(local[:, 1]) - local[:, 2]
    ends = house.length_m / 2 + EAVE_OUT_M - np.abs(local[:, 0])
    sides = house.width_m / 2 + EAVE_OUT_M - np.abs(local[:, 1])
    return np.minimum(np.minimum(roof, ends), sides)


def walls(house: House) -> Mesh:
    """Four walls with gables, down into the ground so that none floats on a slope."""
    rng = np.random.default_rng([house.seed, 0])
    colour = np.array(WALLS[int(rng.integers(len(WALLS)))])
    x, y = house.length_m / 2, house.width_m / 2
    corners = np.array([[-x, -y], [x, -y], [x, y], [-x, y]])
    low = np.column_stack([corners, np.full(4, -1.5)])
    high = np.column_stack([corners, np.full(4, house.eaves_m)])
    gables = np.array([[-x, 0, house.ridge_m], [x, 0, house.ridge_m]])
    faces = [
        quad for i in range(4) for quad in ((i, (i + 1) % 4, 4 + (i + 1) % 4), (i, 4 + (i + 1) % 4, 4 + i))
    ]
    faces += [(5, 6, 9), (7, 4, 8)]
    mesh = Mesh(np.concatenate([low, high, gables]), np.array(faces))
    chimney_at = np.array([house.length_m * 0.22, -0.6, house.ridge_m - 1.4])
    chimney = beam(chimney_at, chimney_at + up(2.1), np.array([1.0, 0, 0]), 0.6, 0.5)
    return _placed(house, _painted(mesh, colour), _painted(chimney, np.array([0.26, 0.12, 0.085])))


def roof(house: House) -> Mesh:
    """Two slopes of tiles, each tile's colour its own."""
    rng = np.random.default_rng([house.seed, 1])
    base = np.array(ROOFS[int(rng.integers(len(ROOFS)))])
    x, y = house.length_m / 2 + EAVE_OUT_M, house.width_m / 2 + EAVE_OUT_M
    slope = (house.ridge_m - house.eaves_m) / (house.width_m / 2)
    slopes = []
    for sign in (1.0, -1.0):
        along = np.linspace(-x, x, round(2 * x / 0.3) + 1)
        across = np.linspace(0, y, round(y / 0.33) + 1)[:: 1 if sign > 0 else -1] * sign
        heights = house.ridge_m + 0.12 - slope * np.abs(np.meshgrid(along, across)[1])
        tiles = grid(along, across, heights)
        spread = rng.uniform(0.86, 1.12, (len(tiles.faces) // 2, 1)).repeat(3, axis=0)
        spread = np.concatenate([spread, spread])  # a tile is the same cell's two triangles
        corners = tiles.vertices[tiles.faces].reshape(-1, 3)
        slopes.append(Mesh(corners, np.arange(len(corners)).reshape(-1, 3), colour=base * spread))
    under = [Mesh(mesh.vertices - up(0.1), mesh.faces[:, ::-1], colour=mesh.colour) for mesh in slopes]
    return _placed(house, *slopes, *under)


def windows(house: House) -> tuple[Mesh, Mesh]:
    """Panes (glass) and their frames with the door (painted wood)."""
    x, y = house.length_m / 2, house.width_m / 2
    panes: list[Mesh] = []
    frames: list[Mesh] = []
    spots = [(sign * y, at, 1.5, 1.0) for sign in (1, -1) for at in (-0.62 * x, 0.05 * x, 0.62 * x)]
    for across, at, height, wide in spots:
        out = np.array([0.0, math.copysign(1.0, across), 0.0])
        _window(np.array([at, across, height]), out, wide, 1.2, panes, frames)
    for sign in (1.0, -1.0):
        out = np.array([sign, 0.0, 0.0])
        _window(np.array([sign * x, -0.45 * y, 1.5]), out, 1.0, 1.2, panes, frames)
        _window(np.array([sign * x, 0.0, house.eaves_m + 0.9]), out, 0.9, 1.0, panes, frames)
    door = beam(
        np.array([x - 0.02, 0.5 * y, 0.0]),
        np.array([x - 0.02, 0.5 * y, 2.1]),
        np.array([0, 1.0, 0]),
        1.0,
        -0.08,
    )
    white = np.array([0.62, 0.62, 0.60])
    painted = [_painted(frame, white) for frame in frames]
    return _placed(house, *panes), _placed(house, *painted, _painted(door, np.array([0.10, 0.16, 0.11])))


def _window(
    at: Float[np.ndarray, "3"],
    out: Float[np.ndarray, "3"],
    wide_m: float,
    high_m: float,
    panes: list[Mesh],
    frames: list[Mesh],
) -> None:
    """A pane 3 cm before the wall in a frame of four bars and a mullion."""
    side = np.cross(out, up(1.0))

    def bar(a: Float[np.ndarray, "2"], b: Float[np.ndarray, "2"], thick: float, depth: float) -> Mesh:
        low, high = at + side * a[0] + up(a[1]), at + side * b[0] + up(b[1])
        d = (high - low) / np.linalg.norm(high - low)
        across = np.cross(d, out)
        return beam(low - across * thick / 2 - out * 0.05, high - across * thick / 2 - out * 0.05, across,
                    thick, depth)  # fmt: skip

    w, h = wide_m / 2, high_m / 2
    middle_low, middle_high = np.array([0.0, -h]), np.array([0.0, h])
    panes.append(_boxed(bar(middle_low, middle_high, wide_m, 0.08), out))
    for a, b in (
        ((-w, -h), (w, -h)),
        ((-w, h), (w, h)),
        ((-w, -h), (-w, h)),
        ((w, -h), (w, h)),
        ((0, -h), (0, h)),
    ):
        frames.append(_boxed(bar(np.array(a), np.array(b), 0.07, 0.11), out))


def _boxed(mesh: Mesh, out: Float[np.ndarray, "3"]) -> Mesh:
    """The bar, mirrored where needed so that its depth points outwards."""
    centre = mesh.vertices.mean(axis=0)
    start = mesh.vertices[:1]
    depth = float((centre - start[0]) @ out)
    if depth >= 0:
        return mesh
    flip = np.eye(3) - 2 * np.outer(out, out)
    return Mesh((mesh.vertices - start) @ flip + start, mesh.faces[:, ::-1])


def _painted(mesh: Mesh, colour: Float[np.ndarray, "3"]) -> Mesh:
    return Mesh(mesh.vertices, mesh.faces, None, np.tile(colour, (len(mesh.vertices), 1)), mesh.smooth)


def _turn(house: House) -> Float[np.ndarray, "3 3"]:
    """Columns: the house's axes in the world."""
    c, s = math.cos(math.radians(house.azimuth_deg)), math.sin(math.radians(house.azimuth_deg))
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _placed(house: House, *meshes: Mesh) -> Mesh:
    """One mesh, in the world."""
    mesh = join(meshes)
    vertices = mesh.vertices @ _turn(house).T + np.array(house.foot)
    return Mesh(vertices, mesh.faces, mesh.uv, mesh.colour, mesh.smooth)
