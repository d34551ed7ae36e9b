"""Triton kernel of casting rays through pixels, the lens taken out: a ray of a batch for each lane.

The references are in plain torch: `pixel_rays` in `rays/rays.py` and, with the letters used here,
`undistort_plane` in `rays/lens.py`, where Newton's method takes some nine hundred ops.  As there and in
`cpu_lens.py`, a ray is computed in float64, whatever the type of the cameras.

What Triton compiles is marked no_type_check: a wrapper that checks annotations cannot be compiled.
"""

import math
from typing import no_type_check

import triton
import triton.language as tl
from jaxtyping import Float, Int
from torch import Tensor

from plnerf.ops.cuda_launch import contiguous, on_samples
from plnerf.ops.launch import refuse_gradients

_ITERATIONS, _LONGEST_STEP = 16, 1.0  # as the reference's
_WIDTH = 2 / math.sqrt(12)  # of a cone that a pixel is wide


@triton.jit
@no_type_check
def _number(of, at, there):
    """One number of a ray's camera or pixel; NaN where there is no such camera."""
    return tl.load(of + at, mask=there, other=float("nan")).to(tl.float64)


@triton.jit
@no_type_check
def _undistort(  # noqa: PLR0913 (a point and its lens, number by number)
    dx, dy, k1, k2, p1, p2, k3, ITERATIONS: tl.constexpr, LONGEST_STEP: tl.constexpr
):
    """`lens.undistort_plane`: where on the plane z = 1 lies what is seen at (dx, dy)."""
    x0, y0, step_x, step_y = dx * 0, dy * 0, dx, dy
    error = dx * dx + dy * dy
    for _ in range(ITERATIONS):
        longest = tl.maximum(step_x * step_x + step_y * step_y, LONGEST_STEP * LONGEST_STEP)
        shorten = LONGEST_STEP / tl.sqrt(longest)
        step_x, step_y = step_x * shorten, step_y * shorten
        x, y = x0 + step_x, y0 + step_y
        xx, yy, xy = x * x, y * y, 2 * x * y
        s, difference = xx + yy, xx - yy
        radial = 1 + s * (k1 + s * (k2 + s * k3))
        slope = k1 + s * (2 * k2 + s * (3 * k3))
        ex = x * radial + p1 * xy + p2 * (2 * s + difference) - dx
        ey = y * radial + p2 * xy + p1 * (2 * s - difference) - dy
        a = radial + s * slope + 4 * (p2 * x + p1 * y)
        bx = difference * slope + 2 * (p2 * x - p1 * y)
        by = xy * slope + 2 * (p1 * x + p2 * y)
        determinant = a * a - (bx * bx + by * by)
        size = ex * ex + ey * ey
        good = (a > 0) & (determinant > 0) & (size <= error)
        inverse = 1 / tl.where(good, determinant, 1.0)
        step_x = tl.where(good, (bx * ex + by * ey - a * ex) * inverse, step_x / 2)
        step_y = tl.where(good, (by * ex - bx * ey - a * ey) * inverse, step_y / 2)
        x0, y0, error = tl.where(good, x, x0), tl.where(good, y, y0), tl.where(good, size, error)
    return x0, y0


@triton.jit
@no_type_check
def _cast(  # noqa: PLR0913 (a kernel's arrays, one by one)
    R, centre, focal, principal, distortion, pixel, camera, origins, directions, radius, count, cameras,
    ITERATIONS: tl.constexpr, LONGEST_STEP: tl.constexpr, WIDTH: tl.constexpr, BLOCK: tl.constexpr,
):  # fmt: skip
    ray = tl.program_id(0).to(tl.int64) * BLOCK + tl.arange(0, BLOCK)
    there = ray < count
    c = tl.load(camera + ray, mask=there, other=0)
    known = there & (c >= 0) & (c < cameras)
    fx, fy = _number(focal, c * 2, known), _number(focal, c * 2 + 1, known)
    dx = (_number(pixel, ray * 2, there) - _number(principal, c * 2, known)) / fx
    dy = (_number(pixel, ray * 2 + 1, there) - _number(principal, c * 2 + 1, known)) / fy
    x, y = _undistort(
        dx, dy, _number(distortion, c * 5, known), _number(distortion, c * 5 + 1, known),
        _number(distortion, c * 5 + 2, known), _number(distortion, c * 5 + 3, known),
        _number(distortion, c * 5 + 4, known), ITERATIONS, LONGEST_STEP,
    )  # fmt: skip
    inverse = 1 / tl.sqrt(x * x + y * y + 1)
    for axis in tl.static_range(3):
        row = c * 9 + axis * 3
        along = _number(R, row, known) * x + _number(R, row + 1, known) * y + _number(R, row + 2, known)
        tl.store(directions + ray * 3 + axis, along * inverse, mask=there)
        tl.store(origins + ray * 3 + axis, _number(centre, c * 3 + axis, known), mask=there)
    tl.store(radius + ray, WIDTH * inverse / ((fx + fy) * 0.5), mask=there)


def cast_rays(
    R_scene_camera: Float[Tensor, "n 3 3"],
    centre: Float[Tensor, "n 3"],
    focal_px: Float[Tensor, "n 2"],
    principal_px: Float[Tensor, "n 2"],
    distortion: Float[Tensor, "n 5"],
    camera: Int[Tensor, " r"],
    pixel_px: Float[Tensor, "r 2"],
) -> tuple[Float[Tensor, "r 3"], Float[Tensor, "r 3"], Float[Tensor, " r"]]:
    """Origins, unit directions and cones' radii of rays through pixels; the fields are those of `Cameras`.

    The rays of a camera that does not exist are not numbers: to raise, the program would wait for the GPU.
    """
    refuse_gradients("cast_rays", R=R_scene_camera, centre=centre, focal=focal_px, pixel=pixel_px)
    given = contiguous(R_scene_camera, centre, focal_px, principal_px, distortion)
    rays = len(camera)
    found = centre.new_empty(rays, 3), centre.new_empty(rays, 3), centre.new_empty(rays)
    on_samples(
        _cast, *given, *contiguous(pixel_px), camera.contiguous(), *found, rays, len(centre),
        samples=rays, ITERATIONS=_ITERATIONS, LONGEST_STEP=_LONGEST_STEP, WIDTH=_WIDTH,
    )  # fmt: skip
    return found
