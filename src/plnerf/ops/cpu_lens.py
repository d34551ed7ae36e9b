"""Numba kernel of casting rays through pixels, the lens taken out.

The references are in plain torch: `pixel_rays` in `rays/rays.py` and, with the letters used here,
`undistort_plane` in `rays/lens.py`.  A ray is computed in float64, whatever the type of the cameras: it costs
nothing beside fetching its camera.

What Numba compiles is marked no_type_check: a wrapper that checks annotations cannot be compiled.
"""

import math
from typing import NamedTuple, no_type_check

import numpy as np
from jaxtyping import Float, Int
from torch import Tensor

from plnerf.ops.kernel_cache import INNER, njit
from plnerf.ops.launch import arrays, launch

_ITERATIONS, _LONGEST_STEP = 16, 1.0  # as the reference's
_CONVERGED = 1e-15  # of a step on the plane z = 1


class CastRays(NamedTuple):
    """Origins, unit directions and cones' radii of r rays in the scene frame."""

    origins: Float[Tensor, "r 3"]
    directions: Float[Tensor, "r 3"]
    radius: Float[Tensor, " r"]


@njit(cache=True, error_model="numpy", **INNER)
@no_type_check
def _undistort(d, distortion):
    k1, k2, k3 = distortion[0], distortion[1], distortion[4]
    if k1 == 0 and k2 == 0 and k3 == 0 and distortion[2] == 0 and distortion[3] == 0:
        return d
    p = complex(distortion[3], distortion[2])
    z, step, error = 0j, d, d.real * d.real + d.imag * d.imag
    for _ in range(_ITERATIONS):
        length = math.sqrt(step.real * step.real + step.imag * step.imag)
        if length > _LONGEST_STEP:
            step = step * (_LONGEST_STEP / length)
        there = z + step
        s = there.real * there.real + there.imag * there.imag
        radial = 1 + s * (k1 + s * (k2 + s * k3))
        slope = k1 + s * (2 * k2 + s * (3 * k3))
        square = there * there
        e = there * radial + 2 * p * s + p.conjugate() * square - d
        a = radial + s * slope + 4 * (p.real * there.real + p.imag * there.imag)
        b = square * slope + 2 * p * there
        determinant = a * a - (b.real * b.real + b.imag * b.imag)
        size = e.real * e.real + e.imag * e.imag
        if a > 0 and determinant > 0 and size <= error:
            z, error = there, size
            step = (b * e.conjugate() - a * e) * (1 / determinant)
        else:
            step = step * 0.5
        if abs(step.real) + abs(step.imag) < _CONVERGED:
            break
    return z


@njit(cache=True, error_model="numpy")
@no_type_check
def _cast(  # noqa: PLR0913 (a kernel's arrays, one by one)
    R, centre, focal, principal, distortion, camera, pixel, origins, directions, radius, start, stop
):
    width = 2 / math.sqrt(12.0)
    for ray in range(start, stop):
        c = camera[ray]
        fx, fy = np.float64(focal[c, 0]), np.float64(focal[c, 1])  # `float` would keep float32
        x = (pixel[ray, 0] - np.float64(principal[c, 0])) / fx
        y = (pixel[ray, 1] - np.float64(principal[c, 1])) / fy
        z = _undistort(complex(x, y), distortion[c])
        x, y = z.real, z.imag
        inverse = 1 / math.sqrt(x * x + y * y + 1)
        for axis in range(3):
            directions[ray, axis] = (R[c, axis, 0] * x + R[c, axis, 1] * y + R[c, axis, 2]) * inverse
            origins[ray, axis] = centre[c, axis]
        radius[ray] = width * inverse / ((fx + fy) * 0.5)


def cast_rays(
    R_scene_camera: Float[Tensor, "n 3 3"],
    centre: Float[Tensor, "n 3"],
    focal_px: Float[Tensor, "n 2"],
    principal_px: Float[Tensor, "n 2"],
    distortion: Float[Tensor, "n 5"],
    camera: Int[Tensor, " r"],
    pixel_px: Float[Tensor, "r 2"],
) -> CastRays:
    """Rays through pixels of cameras; the fields are those of `Cameras`.  IndexError for no such camera."""
    if len(camera) and not 0 <= int(camera.min()) <= int(camera.max()) < len(centre):
        raise IndexError(f"Camera indices must lie in 0 to {len(centre) - 1}, but go beyond.")
    rays = len(camera)
    out = CastRays(centre.new_empty(rays, 3), centre.new_empty(rays, 3), centre.new_empty(rays))
    cameras = arrays(R_scene_camera, centre, focal_px, principal_px, distortion)
    launch(
        _cast, *cameras, camera.contiguous().numpy(), *arrays(pixel_px), *arrays(*out),
        rays=rays, samples=rays, ns=150.0,
    )  # fmt: skip
    return out
