"""The equations once more, in float64 numpy with plain loops, sharing no code with what they check.

Letters as in the files under test: n points, L levels, F features, S intervals, t or s the S+1 edges.
"""

import itertools

import numpy as np


def hash_encode(
    x: np.ndarray, table: np.ndarray, levels: int, coarsest: int, finest: int, log2_table: int, cubic: bool
) -> np.ndarray:
    """Instant-NGP section 3: (n, 3) points and the table (rows, F) to (n, L F)."""
    entries, start, columns = 2**log2_table, 0, []
    for level in range(levels):
        growth = (finest / coarsest) ** (1 / (levels - 1)) if levels > 1 else 1.0
        n = round(coarsest * growth**level)
        dense = (n + 1) ** 3 <= entries
        column = np.zeros((len(x), table.shape[1]))
        for p, point in enumerate(x):
            cell = [min(max(int(np.floor(value * n)), 0), n - 1) for value in point]
            fraction = [value * n - i for value, i in zip(point, cell, strict=True)]
            for corner in itertools.product((0, 1), repeat=3):
                share = 1.0
                for u, upper in zip(fraction, corner, strict=True):
                    s = 3 * u**2 - 2 * u**3 if cubic else u
                    share *= s if upper else 1 - s
                i, j, k = (c + d for c, d in zip(cell, corner, strict=True))
                if dense:
                    row = i + j * (n + 1) + k * (n + 1) ** 2
                else:
                    row = (i ^ (j * 2654435761) ^ (k * 805459861)) % entries
                column[p] += share * table[start + row]
        columns.append(column)
        start += (n + 1) ** 3 if dense else entries
    return np.concatenate(columns, 1)


def cone_moments(t0: float, t1: float, radius: float) -> tuple[float, float, float]:
    """Mean distance, variance along and variance across the axis of a uniform cone between t0 and t1.

    Integrals over the disc of radius `radius` t at every t, by Gauss-Legendre quadrature (exact here).
    """
    nodes, weights = np.polynomial.legendre.leggauss(8)
    t = (t0 + t1) / 2 + (t1 - t0) / 2 * nodes
    area = weights * t**2
    mean = (t0 + t1) / 2 + (t1 - t0) / 2 * (area * nodes).sum() / area.sum()
    along = (area * (t - mean) ** 2).sum() / area.sum()
    across = (area * (radius * t) ** 2 / 4).sum() / area.sum()  # of one coordinate of a disc: r^2 / 4
    return float(mean), float(along), float(across)


def weights(sigma: np.ndarray, t: np.ndarray) -> np.ndarray:
    """NeRF 2020 eq. 3 by marching: what is left of the ray's light, interval by interval."""
    left, out = 1.0, []
    for density, a, b in zip(sigma, t[:-1], t[1:], strict=True):
        passed = np.exp(-density * (b - a))
        out.append(left * (1 - passed))
        left *= passed
    return np.array(out)


def outer_measure(s: np.ndarray, s_other: np.ndarray, w_other: np.ndarray) -> np.ndarray:
    """Mip-NeRF 360 eq. 12: the weights of all intervals that share more than a point with each of s."""
    bounds = []
    for a, b in itertools.pairwise(s):
        pairs = zip(s_other[:-1], s_other[1:], w_other, strict=True)
        bounds.append(sum(w for c, d, w in pairs if c < b and d > a))
    return np.array(bounds)


def distortion(s: np.ndarray, w: np.ndarray) -> float:
    """Mip-NeRF 360 eq. 15, the double sum as it stands."""
    middle = (s[1:] + s[:-1]) / 2
    total = sum(w[i] * w[j] * abs(middle[i] - middle[j]) for i in range(len(w)) for j in range(len(w)))
    return float(total + sum(w[i] ** 2 * (s[i + 1] - s[i]) for i in range(len(w))) / 3)


def contract(x: np.ndarray) -> np.ndarray:
    """Mip-NeRF 360 eq. 10 with the L-infinity norm, for one point."""
    m = np.abs(x).max()
    return x if m <= 1 else (2 - 1 / m) * x / m


def blurred(s: np.ndarray, w: np.ndarray, edges: np.ndarray, h: float) -> np.ndarray:
    """Weight between edges of a histogram blurred by a box of half width h: interval by interval, the area
    of a trapezoid."""
    out = np.zeros(len(edges) - 1)
    nodes, shares = np.polynomial.legendre.leggauss(2)  # exact for pieces that are straight
    for weight, a, b in zip(w, s[:-1], s[1:], strict=True):
        knots = np.sort(np.concatenate([edges, [a - h, a + h, b - h, b + h]]))
        for low, high in itertools.pairwise(knots):
            middle = (low + high) / 2
            j = np.searchsorted(edges, middle) - 1
            if not 0 <= j < len(out):
                continue
            for node, share in zip(nodes, shares, strict=True):
                x = middle + (high - low) / 2 * node
                overlap = max(0.0, min(b, x + h) - max(a, x - h))
                out[j] += share * (high - low) / 2 * weight / (b - a) * overlap / (2 * h)
    return out


def dilated(s: np.ndarray, w: np.ndarray, h: float) -> np.ndarray:
    """Integral over each interval of the largest density within h, piece by piece of constant value."""
    density = w / np.diff(s)
    knots = np.unique(np.clip(np.concatenate([s, s - h, s + h]), s[0], s[-1]))
    out = np.zeros(len(w))
    for low, high in itertools.pairwise(knots):
        x = (low + high) / 2
        near = [p for p, a, b in zip(density, s[:-1], s[1:], strict=True) if a - h <= x <= b + h]
        out[np.searchsorted(s, x) - 1] += max(near) * (high - low)
    return out
