"""Curves in space where the chains of two views meet: what a search begins with.

With its camera each chain of an image spans a surface, in which the line lies that was seen as the chain; the
surfaces that two views have of one line meet in it.  Those of different lines meet too, somewhere: the other
views tell (line matching by pairs, as Schmid and Zisserman, "The geometry and matching of lines and curves
over multiple views", IJCV 2000, do it with epipolar geometry).

Letters: n views, c chains, m pairs of chains.  A curve is theta = (y_A, y_B, z_A, z_B, b, d), see
`parabola.py`; window frame.
"""

from typing import no_type_check

import numpy as np
from jaxtyping import Float, Int

from plnerf.detect.chain_pairs import pairs_that_may_meet
from plnerf.detect.chains import Chains
from plnerf.detect.config_lines import ChainConfig
from plnerf.detect.views import NEAREST, Views, seen_places
from plnerf.ops.kernel_cache import inlined, njit
from plnerf.ops.threads import share

SAMPLES = 9
"""Places along a chain at which its surface is cut by the other's."""
LEAST = 3
"""A curve needs so many of these places to be cut."""
GOLDEN = (5**0.5 - 1) / 2
"""Multiples of it, less their whole parts, are spread evenly, however many are taken."""
STEPS = 3
"""Steps of Newton's method from the middle of a chain: few, because chains are nearly straight."""


def curves_where_chains_meet(
    chains: Chains,
    views: Views,
    x: Float[np.ndarray, " i"],
    low: Float[np.ndarray, "2"],
    high: Float[np.ndarray, "2"],
    config: ChainConfig,
) -> Float[np.ndarray, "m 6"]:
    """The curves between the first and the last plane x in which chains of two views meet.

    low, high: y and z between which they must lie where both views show them.
    """
    pairs = pairs_that_may_meet(
        chains, views, partners(views, (x[0], *low), (x[-1], *high), config), config.spare
    )
    limits = (config.least_angle, config.spare, config.least_length)
    shape = (config.max_askew, config.max_slope, config.max_sag, config.bend_prior)
    box = (low[0], high[0], low[1], high[1])
    curves = np.full((len(pairs), 6), np.nan)
    share(meets, chains, views, pairs, (x[0], x[-1]), box, limits, shape, curves, of=len(pairs))
    return curves[np.isfinite(curves[:, 0])]


def partners(
    views: Views, low: tuple[float, ...], high: tuple[float, ...], config: ChainConfig
) -> Int[np.ndarray, "n k"]:
    """For each view some that see places in common with it, at a good angle; -1 for none: (n, k).

    low, high: x, y and z between which the places lie.

    One after another, each the first that shows what those before it show too seldom: surfaces of two views
    meet at a small angle in a line that runs between them, and no one partner serves all places.  Those that
    share most places with a view are its neighbours, at the smallest angles that count as good, and find
    fewer wires.  Each takes the others in an order of its own, in which neighbours of a flight are far apart:
    the first images of a long flight would all be of a part that shows a wire elsewhere too thin.
    """
    scattered = np.argsort(np.arange(len(views.R)) * GOLDEN % 1.0)
    axes = [np.linspace(*side) for side in zip(low, high, config.places, strict=True)]
    places = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    seen = seen_places(views, places)
    across = places[None, :, 1:] - views.centre[:, None, 1:]
    y, z = np.moveaxis(across / np.linalg.norm(across, axis=2, keepdims=True), 2, 0)
    out = np.full((len(seen), config.partners), -1)
    for n, found in enumerate(out):
        own = np.flatnonzero(seen[n])
        sine = y[n, own] * z[:, own] - z[n, own] * y[:, own]
        shown = seen[:, own] & (np.abs(sine) >= config.good_angle)
        wanted, order = np.full(len(own), config.often), (scattered + n) % len(seen)
        for k in range(config.partners):
            gains = (shown & (wanted > 0)).any(1)
            first = int(order[gains[order].argmax()])
            if not gains[first]:
                break
            found[k] = first
            wanted -= shown[first]
            shown[first] = False
    return out


@njit(cache=True, error_model="numpy")
@no_type_check
def meets(chains, views, pairs, ends, box, limits, shape, out, start, stop):  # noqa: PLR0913 (a kernel's arrays, one by one)
    """The curve of each pair of chains (m, 2), between two places x, into out (m, 6); NaN stays for none."""
    least_angle, spare, least_length = limits
    centre, rays, owner = views.centre, np.empty((SAMPLES, 3)), -1
    points, last = np.empty((SAMPLES, 3)), -1
    for m in range(start, stop):
        a, b = pairs[m, 0], pairs[m, 1]
        if a != last:
            owner, last = chains.owner[a], a
            lines_of_sight(chains, views, a, rays)
        n, count = chains.owner[b], 0
        origin = turned(
            views.R, n, centre[owner, 0] - centre[n, 0], centre[owner, 1] - centre[n, 1],
            centre[owner, 2] - centre[n, 2],
        )  # fmt: skip
        for k in range(SAMPLES):
            if count + SAMPLES - k < LEAST:
                break
            ray = turned(views.R, n, rays[k, 0], rays[k, 1], rays[k, 2])
            depth = depth_of(chains, b, origin, ray, least_angle, spare)
            if depth <= 0:
                continue
            x, y = centre[owner, 0] + depth * rays[k, 0], centre[owner, 1] + depth * rays[k, 1]
            z = centre[owner, 2] + depth * rays[k, 2]
            points[count, 0], points[count, 1], points[count, 2] = x, y, z
            count += ends[0] <= x <= ends[1] and box[0] <= y <= box[1] and box[2] <= z <= box[3]
        if count >= LEAST and abs(points[count - 1, 0] - points[0, 0]) >= least_length:
            curve_through(points[:count], ends, shape, out[m])


@njit(cache=True, error_model="numpy")
@no_type_check
def lines_of_sight(chains, views, a, rays):
    """Into rays (SAMPLES, 3): those through places along a chain, of depth 1."""
    n, R, along, bend, ends = chains.owner[a], views.R, chains.along, chains.bend, chains.ends
    u, v = along[a, 0], along[a, 1]
    for k in range(SAMPLES):
        t = ends[a, 0] + (ends[a, 1] - ends[a, 0]) * k / (SAMPLES - 1)
        across = bend[a, 0] + t * (bend[a, 1] + t * bend[a, 2])
        x, y = t * u - across * v, t * v + across * u
        for axis in range(3):
            rays[k, axis] = R[n, 0, axis] * x + R[n, 1, axis] * y + R[n, 2, axis]


@inlined(error_model="numpy")
@no_type_check
def turned(R, n, x, y, z):
    """A vector in the axes of camera n."""
    return (
        R[n, 0, 0] * x + R[n, 0, 1] * y + R[n, 0, 2] * z,
        R[n, 1, 0] * x + R[n, 1, 1] * y + R[n, 1, 2] * z,
        R[n, 2, 0] * x + R[n, 2, 1] * y + R[n, 2, 2] * z,
    )


@inlined(error_model="numpy")
@no_type_check
def depth_of(chains, b, origin, ray, least_angle, spare):
    """The depth at which a ray meets the surface of a chain, in its camera's axes; -1 where it does not."""
    u, v = chains.along[b, 0], chains.along[b, 1]
    p0, p1, p2 = chains.bend[b, 0], chains.bend[b, 1], chains.bend[b, 2]
    begin, end = chains.ends[b, 0], chains.ends[b, 1]
    beyond = spare * (end - begin)
    (o0, o1, o2), (r0, r1, r2) = origin, ray
    t, depth = 0.5 * (begin + end), -1.0
    for _ in range(STEPS):
        # The plane through the camera and the chain's tangent at t.
        slope = p1 + 2 * p2 * t
        n0, n1, n2 = -v - slope * u, u - slope * v, -(p0 - p2 * t * t)
        across = n0 * r0 + n1 * r1 + n2 * r2
        size = (n0 * n0 + n1 * n1 + n2 * n2) * (r0 * r0 + r1 * r1 + r2 * r2)
        if across * across < least_angle * least_angle * size:
            return -1.0
        depth = -(n0 * o0 + n1 * o1 + n2 * o2) / across
        z = o2 + depth * r2
        if depth <= NEAREST or z <= NEAREST:
            return -1.0
        t = (u * (o0 + depth * r0) + v * (o1 + depth * r1)) / z
        if t < begin - 3 * beyond or t > end + 3 * beyond:
            return -1.0
    return depth if begin - beyond <= t <= end + beyond else -1.0


@njit(cache=True, error_model="numpy")
@no_type_check
def curve_through(points, ends, shape, theta):
    """Into theta (6,): the curve nearest to points (k, 3), left as it is where no wire has its shape.

    A short piece does not show how it bends: its sag is drawn to 0 by a prior, and wind comes later.
    """
    max_askew, max_slope, max_sag, bend_prior = shape
    count, middle = len(points), 0.0
    for k in range(count):
        middle += points[k, 0] / count
    x2, x3, x4, y0, z0, xy, xz, x2z = 0.0, 0.0, bend_prior, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(count):
        x, y, z = points[k, 0] - middle, points[k, 1], points[k, 2]
        x2 += x * x
        x3 += x * x * x
        x4 += x * x * x * x
        y0 += y / count
        z0 += z / count
        xy += x * y
        xz += x * z
        x2z += x * x * z
    # z = level + slope x + bend x^2: the normal equations; x is about its mean.
    bend = (x2z - x2 * z0 - x3 * xz / x2) / (x4 - x2 * x2 / count - x3 * x3 / x2)
    slope, level, askew = (xz - x3 * bend) / x2, z0 - x2 * bend / count, xy / x2
    length = ends[1] - ends[0]
    if abs(askew) > max_askew or abs(slope) > max_slope or abs(bend) * length > 4 * max_sag:
        return
    begin, end = ends[0] - middle, ends[1] - middle
    theta[0], theta[1] = y0 + askew * begin, y0 + askew * end
    theta[2], theta[3] = level + begin * (slope + bend * begin), level + end * (slope + bend * end)
    theta[4], theta[5] = bend * length * length / 4, 0.0
