"""Pictures of a synthetic site by a z-buffer: some ten times as fast as the path tracer of `plnerf synth`.

The same bodies, textures and cameras under one sun and an even sky, with shadows but without light that is
reflected twice.  Solids fill a grid of `SIDE` x `SIDE` samples in each pixel.  Wires are no triangles here:
each sample takes the exact share of its width that the round wire covers, and hides it behind what is nearer.
For pictures in which surfaces, leaves and wires are where they are; not for how light makes them look.

Letters: v vertices, f faces, u and v places across the image, w = 1 / depth (0: nothing), S = SIDE.
World frame, metres.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np
from numba import njit
from raster_wires import draw, pieces

from plnerf.line.wire import Wire
from plnerf.synth.capture import View
from plnerf.synth.config import ImageConfig
from plnerf.synth.flight_config import CaptureConfig
from plnerf.synth.parts import Part, site_parts
from plnerf.synth.site import Site

SIDE = 3
ALUMINIUM = 0.27  # linear reflectance of wires whose colour is 1
NEAR_M = 0.3
SUN, SKY = 1.75, 0.55  # light of sun and sky on a white surface that faces them, 1 is white in sRGB
HORIZON, ZENITH = np.array([0.72, 0.82, 0.95]), np.array([0.25, 0.45, 0.85])
SHADOW_CELL_M, SHADOW_OFF_M = 0.12, 0.35
WHITE = np.float32(65535.0)


@dataclass(frozen=True, eq=False)
class Bodies:
    """Everything of a site but its wires; arrays in float32 relative to the world's origin."""

    vertices: np.ndarray  # v 3
    faces: np.ndarray  # f 3
    normal: np.ndarray  # f 3, either side
    colour: np.ndarray  # f 3, linear reflectance
    ground: np.ndarray  # f: which ground texture, or -1
    texels: np.ndarray  # linear reflectance of all textures and their reductions, uint16 of WHITE
    levels: np.ndarray  # rows: texture, first texel, columns, rows, x and y of its corner, texel's side
    sun: np.ndarray  # 3: unit vector towards it
    shadow: np.ndarray  # nearest to the sun: height along `sun`, by cells across it
    shadow_axes: np.ndarray  # 3 3: rows across the sun, across both, towards it
    shadow_corner: np.ndarray  # 2
    wires: tuple[Wire, ...]
    reflectance: tuple[float, ...]  # of each wire


def bodies_of(site: Site, image: ImageConfig) -> Bodies:
    """What `Camera.picture` draws of a site."""
    azimuth, elevation = math.radians(image.sun_azimuth_deg), math.radians(image.sun_elevation_deg)
    flat = math.cos(elevation)
    sun = np.array([math.cos(azimuth) * flat, math.sin(azimuth) * flat, math.sin(elevation)])
    parts = [part for part in site_parts(site) if not part.wire]
    firsts = np.cumsum([0, *(len(part.mesh.vertices) for part in parts)])
    vertices = np.concatenate([part.mesh.vertices for part in parts]).astype(np.float32)
    faces = np.concatenate([
        part.mesh.faces + first for part, first in zip(parts, firsts[:-1], strict=True)
    ]).astype(np.int32)
    corners = vertices[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    textures = [part for part in parts if isinstance(part.surface.colour, np.ndarray)]
    ground = np.concatenate([
        np.full(len(part.mesh.faces), textures.index(part) if part in textures else -1, np.int8)
        for part in parts
    ])  # fmt: skip
    texels, levels = _reductions(textures)
    axes = np.stack([np.cross([0.0, 0.0, 1.0], sun) / flat, np.zeros(3), sun])
    axes[1] = np.cross(sun, axes[0])
    casts = faces[ground < 0]
    used = np.unique(casts)
    on_sun = (vertices @ axes.T.astype(np.float32)).astype(np.float32)
    corner = on_sun[used, :2].min(0)
    size = np.ceil(np.ptp(on_sun[used, :2], axis=0) / SHADOW_CELL_M).astype(int) + 1
    on_sun[:, :2] = (on_sun[:, :2] - corner) / np.float32(SHADOW_CELL_M)
    on_sun[:, 2] += 1e4  # what is not 0 is there
    shadow = np.zeros((size[1], size[0]), np.float32)
    _fill(on_sun, casts, shadow, np.zeros((1, 1), np.int32))
    colour = np.concatenate([_face_colours(part) for part in parts]).astype(np.float32)
    return Bodies(
        vertices, faces, normal, colour, ground, texels, levels, sun.astype(np.float32), shadow - 1e4,
        axes.astype(np.float32), corner, tuple(wire for _, some in site.grouped for wire in some),
        tuple(ALUMINIUM * sum(config.colour) / 3 for config, some in site.grouped for _ in some),
    )  # fmt: skip


def picture(bodies: Bodies, view: View, capture: CaptureConfig) -> np.ndarray:
    """The view in linear light, 1 is white, h w 3."""
    camera = _camera(view, capture)
    nearest, face = _nearest(bodies, camera)
    light = np.empty((*nearest.shape, 3), np.float32)
    _shade(
        nearest, face, light, *camera, bodies.normal, bodies.colour, bodies.ground,
        bodies.texels, bodies.levels, bodies.sun, bodies.shadow, bodies.shadow_axes, bodies.shadow_corner,
    )  # fmt: skip
    lit = partial(_in_the_open, bodies.sun)
    for row in pieces(bodies.wires, view, float(camera[2]), camera[3], lit, bodies.reflectance):
        draw(light, nearest, *row)
    return _whole_pixels(light, capture)


def wires_only(bodies: Bodies, view: View, capture: CaptureConfig) -> np.ndarray:
    """The share of each pixel in which a wire is seen, h w."""
    camera = _camera(view, capture)
    nearest, _ = _nearest(bodies, camera)
    light = np.zeros((*nearest.shape, 3), np.float32)
    white = (1.0,) * len(bodies.wires)
    for row in pieces(bodies.wires, view, float(camera[2]), camera[3], _one, white):
        draw(light, nearest, *row)
    return _whole_pixels(light, capture)[..., 0]


def depth(bodies: Bodies, view: View, capture: CaptureConfig) -> np.ndarray:
    """Distance along the camera's axis of what each pixel's centre sees but wires, 0 for the sky, h w."""
    nearest, _ = _nearest(bodies, _camera(view, capture))
    w = nearest[SIDE // 2 :: SIDE, SIDE // 2 :: SIDE]
    return np.divide(1, w, out=np.zeros_like(w), where=w > 0)


Camera = tuple[np.ndarray, np.ndarray, np.float32, np.ndarray]
"""R_world_camera, centre, focal length and the middle of the image, in samples."""


def _camera(view: View, capture: CaptureConfig) -> Camera:
    middle = np.array([capture.width_px * SIDE / 2, capture.height_px * SIDE / 2], np.float32)
    R, centre = view.R_world_camera.astype(np.float32), view.centre.astype(np.float32)
    return R, centre, np.float32(capture.focal_px * SIDE), middle


def _nearest(bodies: Bodies, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """The greatest w of every sample, and whose it is."""
    width, height = (2 * camera[3]).astype(int)
    nearest, face = np.zeros((height, width), np.float32), np.full((height, width), -1, np.int32)
    _fill(_project(bodies.vertices, *camera), bodies.faces, nearest, face)
    return nearest, face


def _whole_pixels(light: np.ndarray, capture: CaptureConfig) -> np.ndarray:
    return cv2.resize(light, (capture.width_px, capture.height_px), interpolation=cv2.INTER_AREA)


def _one(normal: np.ndarray) -> np.ndarray:
    return np.ones(normal.shape[:-1])


def _in_the_open(sun: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Light of white surfaces without a shadow on them."""
    lit: np.ndarray = SUN * np.maximum(normal @ sun, 0.0) + SKY * (0.6 + 0.4 * normal[..., 2])
    return lit


def _face_colours(part: Part) -> np.ndarray:
    if part.surface.colour is None:
        assert part.mesh.colour is not None
        return part.mesh.colour[part.mesh.faces].mean(1)
    flat = (0.0, 0.0, 0.0) if isinstance(part.surface.colour, np.ndarray) else part.surface.colour
    return np.tile(flat, (len(part.mesh.faces), 1))


def _reductions(textures: Sequence[Part]) -> tuple[np.ndarray, np.ndarray]:
    """All ground textures, each followed by its halves, with where these lie."""
    texels, levels, first = [], [], 0
    for k, part in enumerate(textures):
        image, xy = np.asarray(part.surface.colour, np.float32), part.mesh.vertices[:, :2]
        low, side = xy.min(0), float(np.ptp(xy[:, 0])) / image.shape[1]
        while min(image.shape[:2]) >= 8:
            rows, columns = image.shape[:2]
            texels.append(np.rint(image * WHITE).astype(np.uint16).reshape(-1, 3))
            levels.append([k, first, columns, rows, *low, side])
            first += rows * columns
            image = cv2.resize(image, (columns // 2, rows // 2), interpolation=cv2.INTER_AREA)
            side *= 2
    return np.concatenate(texels), np.array(levels)


@njit(cache=True, fastmath=True)
def _project(points, R, centre, focal, middle):  # type: ignore[no-untyped-def]
    """u, v, w of points; w = 0 for those behind the camera."""
    found = np.zeros(points.shape, np.float32)
    for i in range(len(points)):
        x, y, z = points[i, 0] - centre[0], points[i, 1] - centre[1], points[i, 2] - centre[2]
        depth = R[0, 2] * x + R[1, 2] * y + R[2, 2] * z
        if depth > NEAR_M:
            w = np.float32(1) / depth
            found[i, 0] = (R[0, 0] * x + R[1, 0] * y + R[2, 0] * z) * w * focal + middle[0]
            found[i, 1] = (R[0, 1] * x + R[1, 1] * y + R[2, 1] * z) * w * focal + middle[1]
            found[i, 2] = w
    return found


@njit(cache=True, fastmath=True)
def _fill(seen, faces, nearest, face):  # type: ignore[no-untyped-def]
    """The greatest w of every sample, and whose it is where `face` is as large."""
    height, width = nearest.shape
    keep = face.shape == nearest.shape
    for k in range(len(faces)):
        a, b, c = seen[faces[k, 0]], seen[faces[k, 1]], seen[faces[k, 2]]
        if a[2] == 0 or b[2] == 0 or c[2] == 0:
            continue
        low_u, high_u = min(a[0], b[0], c[0]), max(a[0], b[0], c[0])
        low_v, high_v = min(a[1], b[1], c[1]), max(a[1], b[1], c[1])
        if high_u < 0.5 or high_v < 0.5 or low_u > width or low_v > height:
            continue
        area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        if area == 0:
            continue
        u0, u1 = max(0, math.ceil(low_u - 0.5)), min(width - 1, math.floor(high_u - 0.5))
        v0, v1 = max(0, math.ceil(low_v - 0.5)), min(height - 1, math.floor(high_v - 0.5))
        for v in range(v0, v1 + 1):
            y = v + np.float32(0.5) - a[1]
            for u in range(u0, u1 + 1):
                x = u + np.float32(0.5) - a[0]
                q = (x * (c[1] - a[1]) - y * (c[0] - a[0])) / area
                r = (y * (b[0] - a[0]) - x * (b[1] - a[1])) / area
                if q < 0 or r < 0 or q + r > 1:
                    continue
                w = a[2] + q * (b[2] - a[2]) + r * (c[2] - a[2])
                if w > nearest[v, u]:
                    nearest[v, u] = w
                    if keep:
                        face[v, u] = k


@njit(cache=True, fastmath=True)
def _shade(  # type: ignore[no-untyped-def]  # noqa: PLR0913
    nearest, face, light, R, centre, focal, middle, normal, colour, ground, texels, levels, sun, shadow,
    axes, corner,
):  # fmt: skip
    """The light of every sample but of wires."""
    height, width = nearest.shape
    for v in range(height):
        for u in range(width):
            x, y = (u + 0.5 - middle[0]) / focal, (v + 0.5 - middle[1]) / focal
            dx = R[0, 0] * x + R[0, 1] * y + R[0, 2]
            dy = R[1, 0] * x + R[1, 1] * y + R[1, 2]
            dz = R[2, 0] * x + R[2, 1] * y + R[2, 2]
            k = face[v, u]
            if k < 0:
                up = math.sqrt(max(0.0, dz / math.sqrt(x * x + y * y + 1)))
                for i in range(3):
                    light[v, u, i] = HORIZON[i] + (ZENITH[i] - HORIZON[i]) * up
                continue
            depth = 1 / nearest[v, u]
            px, py, pz = centre[0] + dx * depth, centre[1] + dy * depth, centre[2] + dz * depth
            nx, ny, nz = normal[k]
            side = -1.0 if nx * dx + ny * dy + nz * dz > 0 else 1.0
            facing = side * (nx * sun[0] + ny * sun[1] + nz * sun[2])
            lit = 0.0
            if facing > 0:
                s = (axes[0, 0] * px + axes[0, 1] * py + axes[0, 2] * pz - corner[0]) / SHADOW_CELL_M
                t = (axes[1, 0] * px + axes[1, 1] * py + axes[1, 2] * pz - corner[1]) / SHADOW_CELL_M
                along = axes[2, 0] * px + axes[2, 1] * py + axes[2, 2] * pz + SHADOW_OFF_M
                for j in range(4):
                    column, row = math.floor(s - 0.5 + j % 2), math.floor(t - 0.5 + j // 2)
                    share = (1 - abs(s - column - 0.5)) * (1 - abs(t - row - 0.5))
                    inside = 0 <= column < shadow.shape[1] and 0 <= row < shadow.shape[0]
                    if not inside or shadow[row, column] <= along:
                        lit += share
            amount = SUN * max(facing, 0.0) * lit + SKY * (0.6 + 0.4 * side * nz)
            if ground[k] < 0:
                for i in range(3):
                    light[v, u, i] = colour[k, i] * amount
                continue
            at = 0
            while levels[at, 0] != ground[k]:
                at += 1
            while at + 1 < len(levels) and levels[at + 1, 0] == ground[k] and levels[at, 6] < depth / focal:
                at += 1
            first, columns, rows = int(levels[at, 1]), int(levels[at, 2]), int(levels[at, 3])
            s = min(max((px - levels[at, 4]) / levels[at, 6] - 0.5, 0.0), columns - 1.001)
            t = min(max((py - levels[at, 5]) / levels[at, 6] - 0.5, 0.0), rows - 1.001)
            one = first + int(t) * columns + int(s)
            s, t = s - int(s), t - int(t)
            for i in range(3):
                low = texels[one, i] * (1 - s) + texels[one + 1, i] * s
                high = texels[one + columns, i] * (1 - s) + texels[one + columns + 1, i] * s
                light[v, u, i] = (low * (1 - t) + high * t) / WHITE * amount
