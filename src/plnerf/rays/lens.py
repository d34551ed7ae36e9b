"""The lens backwards: from where a point is seen to where it lies on the plane z = 1.

Letters: z = x + iy the point, d where the lens moves it, e = f(z) - d; p = p2 + i p1, s = |z|^2,
R = 1 + k1 s + k2 s^2 + k3 s^3.  As complex numbers OpenCV's five-parameter model and its derivatives by z and
by conj(z) are
    f(z) = z R + 2 p s + conj(p) z^2,    a = R + s R' + 4 Re(conj(p) z)  (real),    b = z^2 R' + 2 p z
so that Newton's step is (b conj(e) - a e)/(a^2 - |b|^2).  The lens is invertible around the middle of the
image as far as a > |b|: both eigenvalues of the Jacobian, a + |b| and a - |b|, are positive.
"""

import torch
from jaxtyping import Float
from torch import Tensor

ITERATIONS = 16
"""The corner of a wide lens takes six; the rest halves steps at the edge of where it is invertible."""
LONGEST_STEP = 1.0
"""On the plane z = 1; from far beyond the edge too, some steps are left for coming close to it."""


def undistort_plane(
    distorted: Float[Tensor, "*n 2"], distortion: Float[Tensor, "*n 5"]
) -> Float[Tensor, "*n 2"]:
    """Points on the plane z = 1 that the lens (k1 k2 p1 p2 k3) maps to the given ones.

    A step is taken if it stays where the lens is invertible and comes nearer, else it is halved.  Where the
    lens maps no such point to the given one (its polynomial folds back before the image's corner), the result
    is a point a little inside the edge of the invertible part, on that side: finite, and about as far as the
    lens can be believed.  Computed in float64, without reading the values: nothing waits for a GPU.
    """
    k1, k2, p1, p2, k3 = distortion.double().unbind(-1)
    dx, dy = distorted.double().unbind(-1)
    x0, y0, step_x, step_y = torch.zeros_like(dx), torch.zeros_like(dx), dx, dy  # in the middle f(z) = z
    error = dx * dx + dy * dy
    for _ in range(ITERATIONS):
        shorten = LONGEST_STEP * (step_x * step_x + step_y * step_y).clamp_min(LONGEST_STEP**2).rsqrt()
        step_x, step_y = step_x * shorten, step_y * shorten
        x, y = x0 + step_x, y0 + step_y
        xx, yy, xy = x * x, y * y, 2 * x * y
        s, difference = xx + yy, xx - yy  # of z^2: difference + i xy
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
        inverse = 1 / torch.where(good, determinant, 1)
        newton_x = (bx * ex + by * ey - a * ex) * inverse
        newton_y = (by * ex - bx * ey - a * ey) * inverse
        x0, y0, error = torch.where(good, x, x0), torch.where(good, y, y0), torch.where(good, size, error)
        step_x = torch.where(good, newton_x, step_x / 2)
        step_y = torch.where(good, newton_y, step_y / 2)
    return torch.stack([x0, y0], -1).to(distorted.dtype)
