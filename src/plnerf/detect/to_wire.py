"""A candidate as a `Wire` of the LineFrame: the boundary between a window's frame and what later rooms use.

Letters: s in [0, 1] from the first to the last plane of the fit; theta as in `parabola.py`.
"""

import numpy as np
from jaxtyping import Float

from plnerf.detect.candidate import Candidate
from plnerf.detect.config import CertaintyConfig
from plnerf.detect.parabola import curve_points
from plnerf.detect.views import Views
from plnerf.detect.windows import Window
from plnerf.line.base import Base
from plnerf.line.curve import LEAST_BEND_M, bend_of_sag
from plnerf.line.ends import Evidence, Open
from plnerf.line.frame import LineFrame
from plnerf.line.wire import Wire

OPEN = Open("not searched beyond what the images show")
PLACES = 20
"""Places along a wire at which its uncertainty is evaluated."""


def wire_of(
    candidate: Candidate,
    ends: tuple[int, int],
    window: Window,
    x: Float[np.ndarray, " i"],
    footprint: float,
    frame: LineFrame,
    config: CertaintyConfig,
) -> Wire:
    """The wire between two planes of a window, its base along the window; its id is to be given later.

    x: planes of the fit; footprint: width of a pixel on the wire; both in the window's units.
    """
    low, high = float(x[ends[0]]), float(x[ends[1]])
    T = transport_matrix(*((end - x[0]) / (x[-1] - x[0]) for end in (low, high)))
    covariance = T @ candidate.covariance @ T.T
    sigma = worst_sigma(covariance)
    unit = window.unit_m(frame)
    theta = unit * (T @ candidate.theta)
    theta[2:4] += frame.from_scene(window.origin)[2]
    sag, aside = theta[4:]
    J = unit * np.eye(6)
    bend = max(np.hypot(sag, aside), LEAST_BEND_M)
    J[4, 4:], J[5, 4:] = unit / bend * np.array([sag, aside]), unit / bend**2 * np.array([-aside, sag])
    # The candidate is a parabola; the wire is the catenary of the same ends and the same sag.
    theta[5] = np.arctan2(aside, max(sag, LEAST_BEND_M))
    theta[4] = bend_of_sag(theta, unit * (high - low), sag)
    feet = frame.from_scene(window.to_scene(np.array([[low, 0.0, 0.0], [high, 0.0, 0.0]])))
    seen = [float(np.clip(x[plane], low, high)) for plane in candidate.seen]
    return Wire(
        id=0,
        base=Base(*feet[:, :2]),
        theta=theta,
        covariance=J @ covariance @ J.T,
        ends=(OPEN, OPEN),
        evidence=Evidence(
            source=f"{candidate.images} images",
            count=candidate.images,
            coverage=(seen[1] - seen[0]) / (high - low),
            longest_gap_m=unit * max(seen[0] - low, high - seen[1]),
            certain=is_known(candidate, ends, x, footprint, unit, config),
            reach_m=unit * max(config.reach_sigmas * sigma, config.reach_px * footprint),
            seen_m=((unit * (seen[0] - low), unit * (seen[1] - low)),),
        ),
    )


def known_ends(
    candidate: Candidate,
    ends: tuple[int, int],
    x: Float[np.ndarray, " i"],
    footprint: float,
    config: CertaintyConfig,
) -> tuple[int, int]:
    """The ends moved towards the stretch that was seen, as far as the place of the wire is not certain there.

    footprint: as of `wire_of`.
    """
    sigma = sigmas_along(candidate.covariance, (x - x[0]) / (x[-1] - x[0]))
    unknown = np.flatnonzero(sigma > config.certain_px * footprint)
    first, last = candidate.seen
    low = unknown[(unknown >= ends[0]) & (unknown < first)] + 1
    high = unknown[(unknown > last) & (unknown <= ends[1])] - 1
    return int(low.max(initial=ends[0])), int(high.min(initial=ends[1]))


def certain_stretch(
    candidate: Candidate,
    ends: tuple[int, int],
    x: Float[np.ndarray, " i"],
    footprint: float,
    unit: float,
    config: CertaintyConfig,
) -> tuple[int, int]:
    """The ends moved to where a wire is certain that is not certain over all of it, if that is long enough.

    unit: of the window, in metres; the rest as of `known_ends`.
    """
    sigma = sigmas_along(candidate.covariance, (x - x[0]) / (x[-1] - x[0]))
    first, last = ends
    while last - first >= config.least_planes:
        if is_known(candidate, (first, last), x, footprint, unit, config):
            return first, last
        first, last = (first + 1, last) if sigma[first] > sigma[last] else (first, last - 1)
    return ends


def is_known(
    candidate: Candidate,
    ends: tuple[int, int],
    x: Float[np.ndarray, " i"],
    footprint: float,
    unit: float,
    config: CertaintyConfig,
) -> bool:
    """Whether the place of a wire is certain over half of it or more."""
    sigma = usual_sigma(between(candidate.covariance, ends, x))
    return unit * sigma <= max(unit * config.certain_px * footprint, config.certain_m)


def is_certain(
    candidate: Candidate, views: Views, x: Float[np.ndarray, " i"], config: CertaintyConfig
) -> bool:
    """Whether the views fix the place of a line over half of where they show it, or more."""
    footprint = typical_footprint(views, candidate.theta, x, config)
    return usual_sigma(between(candidate.covariance, candidate.seen, x)) <= config.certain_px * footprint


def between(
    covariance: Float[np.ndarray, "6 6"], ends: tuple[int, int], x: Float[np.ndarray, " i"]
) -> Float[np.ndarray, "6 6"]:
    """The covariance of the part of a line between two planes."""
    T = transport_matrix(*((x[end] - x[0]) / (x[-1] - x[0]) for end in ends))
    return T @ covariance @ T.T


def transport_matrix(low: float, high: float) -> Float[np.ndarray, "6 6"]:
    """Maps theta to that of the same parabola between s = low and s = high; linear."""
    offsets = [[1 - s, s, 0.0, 0.0, 0.0, 4 * s * (1 - s)] for s in (low, high)]
    heights = [[0.0, 0.0, 1 - s, s, -4 * s * (1 - s), 0.0] for s in (low, high)]
    return np.array([*offsets, *heights, *((high - low) ** 2 * np.eye(6)[4:])])


def worst_sigma(covariance: Float[np.ndarray, "6 6"]) -> float:
    """Standard deviation across the wire, in its least certain direction at its least certain place."""
    return float(sigmas_along(covariance, np.linspace(0.0, 1.0, PLACES)).max())


def usual_sigma(covariance: Float[np.ndarray, "6 6"]) -> float:
    """Standard deviation across the wire, the median along it: ends that few views show count for little."""
    return float(np.median(sigmas_along(covariance, np.linspace(0.0, 1.0, PLACES))))


def sigmas_along(
    covariance: Float[np.ndarray, "6 6"], s: Float[np.ndarray, " m"]
) -> Float[np.ndarray, " m"]:
    """Standard deviation across the wire at some places, each in its least certain direction."""
    J = np.zeros((len(s), 2, 6))
    J[:, 0, 0] = J[:, 1, 2] = 1 - s
    J[:, 0, 1] = J[:, 1, 3] = s
    J[:, 0, 5] = 4 * s * (1 - s)
    J[:, 1, 4] = -J[:, 0, 5]
    return np.sqrt(np.linalg.eigvalsh(J @ covariance @ J.transpose(0, 2, 1))[:, -1])


def typical_footprint(
    views: Views, theta: Float[np.ndarray, "6"], x: Float[np.ndarray, " i"], config: CertaintyConfig
) -> float:
    """Median width of a pixel on the curve, over planes, of the nearest views; in the window's units."""
    y, z = curve_points(theta, np.linspace(0, 1, len(x)))
    points = np.stack([x, y, z], 1)
    distance = np.linalg.norm(points[:, None] - views.centre[None], axis=2) / views.focal[:, 0]
    nearest = max(3, int(len(views.centre) * config.nearest_views))
    return float(np.median(np.sort(distance, 1)[:, :nearest]))
