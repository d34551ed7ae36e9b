"""Draws wires into a photo: lit cylinders, by samples that are rays, through the photo's lens.

Letters: q pixels, k x k samples in each; r radius; p the axis's nearest vertex and t its direction there, v a
ray, all in camera axes.  Between two vertices the axis is straight to far less than a thousandth of a pixel.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import gaussian_filter
from scipy.spatial import cKDTree

from plnerf.synth.hang_choose import HungWire
from plnerf.synth.hang_config import DrawConfig
from plnerf.synth.hang_depth import Depth
from plnerf.synth.hang_light import Light
from plnerf.synth.hang_views import PhotoView


@dataclass(frozen=True, eq=False)
class Axis:
    """A wire's axis as one photo shows it."""

    hung: HungWire
    local: Float[np.ndarray, "n 3"]
    tangent: Float[np.ndarray, "n 3"]
    pixel: Float[np.ndarray, "n 2"]
    half_px: Float[np.ndarray, " n"]
    """Half of the width."""
    end: Bool[np.ndarray, " n"]
    """The wire's own first and last vertex."""


@dataclass(frozen=True, eq=False)
class Layer:
    """What wires cover of a tile, and the light that comes from there."""

    alpha: Float[np.ndarray, "h w"]
    light: Float[np.ndarray, "h w 3"]
    """Linear, times `alpha`."""


Box = tuple[int, int, int, int]
"""Left, top, right and bottom of a tile in pixels; it may reach beyond the photo."""


def axis_in(view: PhotoView, hung: HungWire, config: DrawConfig) -> Axis | None:
    """The axis where it lies in a photo or near to it; None where it does not."""
    wire = hung.wire
    assert wire.diameter_m is not None
    s = np.linspace(0, wire.base.length_m, config.vertices)
    points = wire.points(s)
    tangent = np.gradient(points, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    pixel, z, ahead = view.project(points)
    half = 0.5 * wire.diameter_m * float(view.focal_px.max()) * 1.5 / np.where(ahead, z, 1.0) + 1
    near = ahead & view.inside(pixel, 64.0)
    if not near.any():
        return None
    end = np.zeros(len(s), np.bool_)
    end[[0, -1]] = True
    local, turned = view.local(points[near]), tangent[near] @ view.R_world_camera
    return Axis(hung, local, turned, pixel[near], half[near], end[near])


def tiles(view: PhotoView, axes: Sequence[Axis], config: DrawConfig) -> list[Box]:
    """The tiles of a photo that wires cross."""
    size = config.tile_px
    across, down = -(-view.width // size), -(-view.height // size)
    hit = np.zeros((down, across), np.bool_)
    for axis in axes:
        reach = float(axis.half_px.max()) + 4
        for dx in (-reach, reach):
            for dy in (-reach, reach):
                at = np.floor((axis.pixel + np.array([dx, dy])) / size).astype(int)
                use = (at >= 0).all(1) & (at < (across, down)).all(1)
                hit[at[use, 1], at[use, 0]] = True
    return [
        (size * x, size * y, min(size * (x + 1), view.width), min(size * (y + 1), view.height))
        for y, x in np.argwhere(hit).tolist()
    ]


def draw_tile(
    view: PhotoView, depth: Depth, axes: Sequence[Axis], light: Light, box: Box, config: DrawConfig
) -> Layer:
    """All wires of a tile, nearer ones over farther ones, each hidden where the scene is nearer."""
    left, top, right, bottom = box
    alpha, colour = np.zeros((bottom - top, right - left)), np.zeros((bottom - top, right - left, 3))
    far_first = sorted(axes, key=lambda axis: -float(np.median(axis.local[:, 2])))
    for axis in far_first:
        at = _pixels_near(axis, box)
        if not len(at):
            continue
        vertex = _nearest(axis, at, box)
        cover, sent = _sampled(view, axis, at, vertex, light, config)
        plane = view.plane(at + 0.5)
        shown = axis.local[vertex, 2] < depth.at(plane) * (1 + config.behind)
        cover, sent = cover * shown, sent * shown[:, None]
        row, column = at[:, 1] - top, at[:, 0] - left
        alpha[row, column] += cover - alpha[row, column] * cover
        colour[row, column] = colour[row, column] * (1 - cover)[:, None] + sent
    return Layer(alpha, colour)


def blurred(layer: Layer, sigma_px: float) -> Layer:
    """The layer as a lens shows it whose blur, the pixel's own width included, is `sigma_px`."""
    own = np.sqrt(max(sigma_px**2 - 1 / 12, 0.0))
    if own < 0.05:
        return layer
    light = gaussian_filter(layer.light, (own, own, 0), mode="constant")
    return Layer(gaussian_filter(layer.alpha, own, mode="constant"), light)


def _pixels_near(axis: Axis, box: Box) -> Int[np.ndarray, "q 2"]:
    """Pixels (column, row) of the tile that the wire may touch."""
    left, top, right, bottom = box
    mask = np.zeros((bottom - top, right - left), np.uint8)
    reach = float(axis.half_px.max())
    use = ((axis.pixel > (left - reach, top - reach)) & (axis.pixel < (right + reach, bottom + reach))).all(1)
    at = np.flatnonzero(use)
    if not len(at):
        return np.zeros((0, 2), np.int64)
    for part in np.split(at, np.flatnonzero(np.diff(at) > 1) + 1):
        grown = np.arange(max(0, part[0] - 1), min(len(axis.pixel), part[-1] + 2))
        line = np.rint(axis.pixel[grown] - (left, top) - 0.5).astype(np.int32)
        thick = 2 * int(np.ceil(axis.half_px[part].max())) + 3
        cv2.polylines(mask, [line.reshape(-1, 1, 2)], False, 1, thickness=thick)
    row, column = np.nonzero(mask)
    return np.stack([column + left, row + top], 1)


def _nearest(axis: Axis, at: Int[np.ndarray, "q 2"], box: Box) -> Int[np.ndarray, " q"]:
    """The vertex nearest to each pixel's centre."""
    near = ((axis.pixel > np.array(box[:2]) - 96) & (axis.pixel < np.array(box[2:]) + 96)).all(1)
    some = np.flatnonzero(near)
    found: Int[np.ndarray, " q"] = some[cKDTree(axis.pixel[some]).query(at + 0.5)[1]]
    return found


def _within_pixels(
    view: PhotoView, at: Int[np.ndarray, "q 2"], inner: Float[np.ndarray, "m 2"]
) -> Float[np.ndarray, "n 2"]:
    """Places of m samples in each of q pixels on the plane z = 1.

    The lens is straight within a pixel, to some 1e-5 of its width, and is asked thrice for each.
    """
    middle = at + 0.5
    found = view.plane(np.stack([middle, middle + np.array([0.5, 0.0]), middle + np.array([0.0, 0.5])]))
    by_x, by_y = 2 * (found[1] - found[0]), 2 * (found[2] - found[0])
    x, y = (inner - 0.5).T[..., None]
    plane = found[0][:, None] + x * by_x[:, None] + y * by_y[:, None]
    flat: Float[np.ndarray, "n 2"] = plane.reshape(-1, 2)
    return flat


def _sampled(
    view: PhotoView,
    axis: Axis,
    at: Int[np.ndarray, "q 2"],
    vertex: Int[np.ndarray, " q"],
    light: Light,
    config: DrawConfig,
) -> tuple[Float[np.ndarray, " q"], Float[np.ndarray, "q 3"]]:
    """Share of each pixel that the wire covers, and the mean light of its samples."""
    assert axis.hung.wire.diameter_m is not None
    r, k = axis.hung.wire.diameter_m / 2, config.samples
    cell = (np.arange(k) + 0.5) / k
    inner = np.stack(np.meshgrid(cell, cell), -1).reshape(-1, 2)
    plane = _within_pixels(view, at, inner)
    v = np.column_stack([plane, np.ones(len(plane))])
    v /= np.linalg.norm(v, axis=1, keepdims=True)
    of = np.repeat(vertex, k * k)
    p, t = axis.local[of], axis.tangent[of]
    across = np.cross(v, t)
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-12)
    q = (p * across).sum(1) / r  # the axis's signed distance from the ray, in radii
    hit = np.abs(q) < 1
    if axis.end[vertex].any():  # the flat ends of the cylinder: nothing beyond them
        vt, vp, pt = (v * t).sum(1), (v * p).sum(1), (p * t).sum(1)
        along = (vt * vp - pt) / np.maximum(1 - vt**2, 1e-12)
        first = of == 0 if axis.end[0] else np.zeros(len(of), np.bool_)
        last = of == len(axis.end) - 1 if axis.end[-1] else np.zeros(len(of), np.bool_)
        hit &= ~(first & (along < 0)) & ~(last & (along > 0))
    light_of = np.zeros((len(q), 3))
    if hit.any():
        v, t, m, q = v[hit], t[hit], across[hit], q[hit]
        facing = -(v - (v * t).sum(1, keepdims=True) * t)
        facing /= np.linalg.norm(facing, axis=1, keepdims=True)
        # The ray passes the axis at -q m: there the surface's normal is that and what is left towards it.
        normal = -q[:, None] * m + np.sqrt(1 - q**2)[:, None] * facing
        R = view.R_world_camera
        light_of[hit] = light.on(normal @ R.T, -v @ R.T, axis.hung.material)
    return hit.reshape(-1, k * k).mean(1), light_of.reshape(-1, k * k, 3).mean(1)
