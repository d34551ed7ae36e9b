"""Wires of `raster.py`: thinner than a sample, drawn by the exact share of it that they cover.

Letters as there: u and v places across the image in samples, w = 1 / depth.
"""

import math
from collections.abc import Callable, Sequence

import numpy as np
from numba import njit

from plnerf.line.wire import Wire
from plnerf.synth.capture import View
from plnerf.synth.site import radius_m

STEP_M = 0.25  # between the points of a wire's polyline
PIECE = 40  # points that are drawn in one go
NEAR_M = 0.3


def pieces(
    wires: Sequence[Wire],
    view: View,
    focal: float,
    middle: np.ndarray,
    light: Callable[[np.ndarray], np.ndarray],
    reflectance: Sequence[float],
) -> list[tuple[np.ndarray, ...]]:
    """The arguments of `draw`, the farthest piece first.  light: of surfaces by their normals;
    reflectance: of each wire."""
    found: list[tuple[float, tuple[np.ndarray, ...]]] = []
    profile = np.linspace(-1, 1, 21)
    for wire, share in zip(wires, reflectance, strict=True):
        points = wire.polyline(STEP_M)
        local = (points - view.centre) @ view.R_world_camera
        before = np.flatnonzero(local[:, 2] > NEAR_M)
        runs = np.split(before, np.flatnonzero(np.diff(before) > 1) + 1)
        w = 1 / np.where(local[:, 2] > NEAR_M, local[:, 2], 1.0)
        seen = np.column_stack([local[:, :2] * w[:, None] * focal + middle, w])
        along = np.gradient(points, axis=0)
        side = np.cross(along, view.centre - points)
        side /= np.linalg.norm(side, axis=1, keepdims=True)
        face = np.cross(side, along)
        face /= np.linalg.norm(face, axis=1, keepdims=True)
        n = profile[:, None] * side[:, None] + np.sqrt(1 - profile**2)[:, None] * face[:, None]
        bright, half = share * light(n), focal * radius_m(wire) * w
        on_image = (side @ view.R_world_camera)[:, :2]
        for run in runs:
            for first in range(0, len(run) - 1, PIECE):
                part = run[first : first + PIECE + 1]
                found.append((w[part].mean(), (seen[part], half[part], on_image[part], bright[part])))
    return [rows for _, rows in sorted(found, key=lambda one: one[0])]


@njit(cache=True)
def draw(light, nearest, seen, half, side, amount):  # type: ignore[no-untyped-def]
    """One piece of a wire over what is behind it."""
    size = (nearest.shape[1], nearest.shape[0])
    for k in range(len(seen) - 1):
        a, b = seen[k], seen[k + 1]
        du, dv = b[0] - a[0], b[1] - a[1]
        length = math.hypot(du, dv)
        if length < 1e-9:
            continue
        m = 0 if abs(du) >= abs(dv) else 1  # the axis of the image along which it is followed
        begin, end, slope = min(a[m], b[m]), max(a[m], b[m]), (b[1 - m] - a[1 - m]) / (b[m] - a[m])
        normal = (-dv / length, du / length)
        turned = 1.0 if normal[0] * side[k, 0] + normal[1] * side[k, 1] > 0 else -1.0
        stretch = math.sqrt(1 + slope * slope)
        for i in range(max(0, math.ceil(begin - 0.5)), min(size[m], math.ceil(end - 0.5))):
            t = (i + 0.5 - a[m]) / (b[m] - a[m])
            w, h = a[2] + t * (b[2] - a[2]), half[k] + t * (half[k + 1] - half[k])
            middle = a[1 - m] + t * (b[1 - m] - a[1 - m])
            reach = (h + 0.5) * stretch
            first, last = math.ceil(middle - reach - 0.5), math.floor(middle + reach - 0.5)
            for j in range(max(0, first), min(size[1 - m] - 1, last) + 1):
                u, v = (i, j) if m == 0 else (j, i)
                off = turned * ((u + 0.5 - a[0]) * normal[0] + (v + 0.5 - a[1]) * normal[1])
                low, high = max(off - 0.5, -h), min(off + 0.5, h)
                if high <= low or w <= nearest[v, u]:
                    continue
                share, at = high - low, ((low + high) / 2 / h + 1) * 10
                bright = amount[k, int(at)] if at < 20 else amount[k, 20]
                for c in range(3):
                    light[v, u, c] += share * (bright - light[v, u, c])
