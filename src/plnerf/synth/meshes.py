"""Triangle meshes of simple bodies, and the PLY file that carries them to the renderer.

Vertices in metres, faces counter-clockwise from outside.  uv: u around a tube (0..1), v in metres along it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int


@dataclass(frozen=True)
class Mesh:
    """Triangles; `smooth` asks for normals shared between faces."""

    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    uv: Float[np.ndarray, "v 2"] | None = None
    colour: Float[np.ndarray, "v 3"] | None = None  # linear reflectance per vertex
    smooth: bool = False


def up(height_m: float) -> Float[np.ndarray, "3"]:
    """The vector that lifts a point by `height_m`."""
    return np.array([0.0, 0.0, height_m])


def join(meshes: Sequence[Mesh]) -> Mesh:
    """One mesh of several; all or none of them carry uv, and likewise colour."""
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    uvs = [mesh.uv for mesh in meshes if mesh.uv is not None]
    colours = [mesh.colour for mesh in meshes if mesh.colour is not None]
    return Mesh(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate([mesh.faces + start for mesh, start in zip(meshes, starts[:-1], strict=True)]),
        np.concatenate(uvs) if len(uvs) == len(meshes) else None,
        np.concatenate(colours) if len(colours) == len(meshes) else None,
        meshes[0].smooth,
    )


def tube(axis: Float[np.ndarray, "n 3"], radius: Float[np.ndarray, "n"] | float, sides: int = 12) -> Mesh:
    """A round tube along a polyline, open at its ends.

    The polygon's area equals the circle's, so that a thin wire covers what a round one would.
    """
    n = len(axis)
    tangent = np.gradient(axis, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    helper = np.array([0.0, 0.0, 1.0]) if abs(tangent[0, 2]) < 0.9 else np.array([1.0, 0.0, 0.0])
    side = np.cross(tangent, helper)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    above = np.cross(side, tangent)
    angle = 2 * np.pi * np.arange(sides + 1) / sides  # the seam is doubled: u runs 0..1
    fair = np.sqrt(2 * np.pi / (sides * np.sin(2 * np.pi / sides)))
    r = np.broadcast_to(np.asarray(radius, dtype=float), (n,))[:, None, None] * fair
    ring = np.cos(angle)[None, :, None] * side[:, None] + np.sin(angle)[None, :, None] * above[:, None]
    vertices = (axis[:, None] + r * ring).reshape(-1, 3)
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(axis, axis=0), axis=1))])
    u, v = np.meshgrid(angle / (2 * np.pi), along)
    return Mesh(
        vertices, _quads(n, sides + 1)[:, ::-1], np.stack([u.ravel(), v.ravel()], axis=1), smooth=True
    )


def lathe(profile: Float[np.ndarray, "n 2"], centre: Float[np.ndarray, "3"], sides: int = 20) -> Mesh:
    """A body of revolution about the vertical through `centre`; profile rows are (radius, height), rising."""
    angle = 2 * np.pi * np.arange(sides + 1) / sides
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    xy = profile[:, None, :1] * ring[None]
    z = np.broadcast_to(profile[:, None, 1:], (*xy.shape[:2], 1))
    vertices = np.concatenate([xy, z], axis=2).reshape(-1, 3) + centre
    return Mesh(vertices, _quads(len(profile), sides + 1), smooth=False)


def beam(
    a: Float[np.ndarray, "3"],
    b: Float[np.ndarray, "3"],
    n1: Float[np.ndarray, "3"],
    width_m: float,
    thick_m: float,
) -> Mesh:
    """A straight box from a to b: `width_m` along n1 (starting at the axis), `thick_m` across it."""
    d = (b - a) / np.linalg.norm(b - a)
    n1 = n1 - d * float(n1 @ d)
    n1 = n1 / np.linalg.norm(n1)
    n2 = np.cross(d, n1)
    corners = np.array([[0, 0], [width_m, 0], [width_m, thick_m], [0, thick_m]])
    offset = corners[:, :1] * n1 + corners[:, 1:] * n2
    vertices = np.concatenate([a + offset, b + offset])
    sides = [[i, (i + 1) % 4, 4 + (i + 1) % 4, 4 + i] for i in range(4)]
    quads = np.array([*sides, [3, 2, 1, 0], [4, 5, 6, 7]])
    return Mesh(vertices, np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]))


def angle_bar(
    a: Float[np.ndarray, "3"], b: Float[np.ndarray, "3"], outward: Float[np.ndarray, "3"], width_m: float
) -> Mesh:
    """An L profile, as in lattice towers; its edge runs from a to b, its legs away from `outward`."""
    d = (b - a) / np.linalg.norm(b - a)
    inward = -(outward - d * float(outward @ d))
    if np.linalg.norm(inward) < 1e-6:
        inward = np.cross(d, np.array([0.0, 0.0, 1.0]) if abs(d[2]) < 0.9 else np.array([1.0, 0.0, 0.0]))
    inward = inward / np.linalg.norm(inward)
    side = np.cross(d, inward)
    thick = max(0.008, 0.11 * width_m)
    return join([beam(a, b, inward + side, width_m, thick), beam(a, b, inward - side, width_m, thick)])


def grid(x_m: Float[np.ndarray, "n"], y_m: Float[np.ndarray, "m"], z_m: Float[np.ndarray, "m n"]) -> Mesh:
    """A height field; uv runs 0..1 from (x[0], y[0]) to (x[-1], y[-1])."""
    x, y = np.meshgrid(x_m, y_m)
    u, v = np.meshgrid(np.linspace(0, 1, len(x_m)), np.linspace(0, 1, len(y_m)))
    vertices = np.stack([x.ravel(), y.ravel(), z_m.ravel()], axis=1)
    return Mesh(vertices, _quads(len(y_m), len(x_m)), np.stack([u.ravel(), v.ravel()], axis=1), smooth=True)


def without(mesh: Mesh, x_m: tuple[float, float], y_m: tuple[float, float]) -> Mesh:
    """The mesh less the faces whose centre lies in the rectangle, and less the vertices they alone used."""
    centre = mesh.vertices[mesh.faces].mean(axis=1)
    low, high = np.array([x_m[0], y_m[0]]), np.array([x_m[1], y_m[1]])
    inside = ((centre[:, :2] > low) & (centre[:, :2] < high)).all(axis=1)
    used, faces = np.unique(mesh.faces[~inside], return_inverse=True)
    uv = None if mesh.uv is None else mesh.uv[used]
    colour = None if mesh.colour is None else mesh.colour[used]
    return Mesh(mesh.vertices[used], faces.reshape(-1, 3), uv, colour, mesh.smooth)


def _quads(rows: int, columns: int) -> Int[np.ndarray, "f 3"]:
    """Two triangles per cell of a rows x columns vertex grid, counter-clockwise as columns x rows."""
    i = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    lower = np.stack([i, i + 1, i + columns + 1], axis=1)
    upper = np.stack([i, i + columns + 1, i + columns], axis=1)
    return np.concatenate([lower, upper])


def write_ply(mesh: Mesh, path: Path) -> None:
    """Binary PLY with optional s, t and vertex colours (r, g, b as floats)."""
    columns = [mesh.vertices]
    names = ["x", "y", "z"]
    if mesh.uv is not None:
        columns.append(mesh.uv)
        names += ["s", "t"]
    if mesh.colour is not None:
        columns.append(mesh.colour)
        names += ["r", "g", "b"]
    table = np.ascontiguousarray(np.concatenate(columns, axis=1), dtype="<f4")
    faces = np.zeros(len(mesh.faces), dtype=[("count", "u1"), ("index", "<i4", 3)])
    faces["count"] = 3
    faces["index"] = mesh.faces
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"element vertex {len(table)}",
        *(f"property float {name}" for name in names),
        f"element face {len(faces)}",
        "property list uchar int vertex_indices",
        "end_header",
    ]
    path.write_bytes("\n".join(header).encode() + b"\n" + table.tobytes() + faces.tobytes())
