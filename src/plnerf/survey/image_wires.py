"""Conductors of a scene from its images: curves that were found there, refitted, and cut at their supports.

Letters as in `catenary.py`; the base of the search lies along the scene's x axis over the whole box.
"""

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import uniform_filter1d

from plnerf.errors import SurveyError
from plnerf.scene.scene import Scene
from plnerf.scene.transforms import Frames
from plnerf.survey.catenary import Base, CatenaryFit
from plnerf.survey.model import Conductor, Kind
from plnerf.survey.refine import SAMPLES, Refined, refine
from plnerf.wires.curves import Curve

STEEPEST_UP = 1e-3
"""1 - cosine of the angle that the world's z may lean from up."""
STILL_THERE = 0.5
"""Of the usual share of images that show a wire where it is: beyond its supports fewer do."""
AVERAGED = 9
"""Samples along a wire over which that share is averaged."""
ABOVE_ALL = 0.6
"""A wire is a shield wire where it hangs above all others by this share of their extent in height."""


def conductors_in_images(
    scene: Scene,
    curves: Sequence[Curve],
    diameter_m: float,
    tell: Callable[[int, int], object] = lambda done, of: None,
) -> list[Conductor]:
    """One conductor for each curve that the views fix, in world units, the highest first.

    diameter_m: of the wires, about, in world units.  Raises SurveyError where the world's z is not up.
    """
    frames = scene.frames
    if 1 - frames.R_scene_world[2, 2] > STEEPEST_UP:
        raise SurveyError(
            "Sag needs a world with z up, but this scene's up direction is "
            f"{frames.R_scene_world[2].round(3).tolist()}. Turn its poses, or make them by `plnerf capture`."
        )
    certain = [curve for curve in curves if curve.certain]
    if not certain:
        return []
    low, high = (float(corner[0]) for corner in scene.box)
    base = Base(np.array([low, 0.0]), np.array([1.0, 0.0]), high - low)
    start = [of_curve(curve, base) for curve in certain]
    reach = [2 * curve.reach for curve in certain]
    refined = refine(scene, base, start, reach, diameter_m * frames.scale, tell)
    ends = supports(refined, base)
    order = sorted(range(len(certain)), key=lambda w: -float(base.at(refined[w].q, middle_of(ends[w]))[0, 1]))
    heights = [float(base.at(refined[w].q, middle_of(ends[w]))[0, 1]) for w in order]
    rows = []
    for k, w in enumerate(order):
        one, between = refined[w], ends[w]
        covariance = np.eye(5) * certain[w].sigma ** 2
        before = cut(base, start[w], covariance, between, frames, one)
        after = cut(base, one.q, one.covariance, between, frames, one)
        gaps = stretches_without(one, base, between)
        rows.append(
            Conductor(
                id=k + 1, span=0, kind=kind_of(k, heights), fit=before if one.refused else after,
                coverage=1 - float(sum(gaps)) / (between[1] - between[0]),
                longest_gap_m=float(max(gaps, default=0.0)) / frames.scale, evidence=one.sightings,
                source=f"{one.views} images", before=before,
                note=f"not refitted to the images: {one.refused}" if one.refused else None,
            )
        )  # fmt: skip
    return rows


def of_curve(curve: Curve, base: Base) -> Float[np.ndarray, "5"]:
    """q of a curve over the whole base."""
    ends = curve.points(base.o[0] + np.array([0.0, base.length_m]))
    return np.array([*ends[:, 1], *ends[:, 2], curve.z[2] * base.length_m**2 / 4])


def middle_of(between: tuple[float, float]) -> Float[np.ndarray, "1"]:
    """As an array of one."""
    return np.array([(between[0] + between[1]) / 2])


def supports(refined: Sequence[Refined], base: Base) -> list[tuple[float, float]]:
    """From where to where each wire hangs: the stretch over which images show it about as often as they do
    in its middle.

    Of all stretches that for which the sum of (share of images - half of what is usual) is the largest; as
    all wires of a span hang from the same supports, a wire's end is the median of all.
    """
    s = np.linspace(0, base.length_m, SAMPLES)
    found = []
    for one in refined:
        share = np.where(one.tried > 0, one.seen / np.maximum(one.tried, 1), 0.0)
        usual = float(np.median(share[one.tried > 0])) if (one.tried > 0).any() else 1.0
        gain = np.where(one.tried > 0, share - STILL_THERE * usual, 0.0)
        sums = np.concatenate([[0.0], np.cumsum(gain)])
        lowest = np.minimum.accumulate(sums)
        last = int(np.argmax(sums - lowest))
        first = int(np.argmin(sums[: last + 1]))
        found.append((s[min(first, SAMPLES - 2)], s[max(last - 1, first + 1) if last < SAMPLES else -1]))
    low, high = np.median(np.array(found), axis=0)
    return [(float(low), float(high))] * len(refined)


def stretches_without(one: Refined, base: Base, between: tuple[float, float]) -> list[float]:
    """Lengths along the base, between its ends, over which no image shows a wire."""
    s = np.linspace(0, base.length_m, SAMPLES)
    inside = (s >= between[0]) & (s <= between[1])
    bare: Bool[np.ndarray, " k"] = uniform_filter1d(one.seen[inside].astype(float), 3) <= 0
    edges = np.flatnonzero(np.diff(np.concatenate([[0], bare.astype(int), [0]])))
    step = base.length_m / (SAMPLES - 1)
    return [float((b - a) * step) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def cut(
    base: Base, q: Float[np.ndarray, "5"], covariance: Float[np.ndarray, "5 5"],
    between: tuple[float, float], frames: Frames, one: Refined,
) -> CatenaryFit:  # fmt: skip
    """The same wire between its supports, in world units."""
    low, high = between
    part = Base(base.o + low * base.u, base.u, high - low)

    def ends(p: Float[np.ndarray, "5"]) -> Float[np.ndarray, "5"]:
        yz = base.at(p, np.array([low, high]))
        return np.array([*yz[:, 0], *yz[:, 1], p[4] * ((high - low) / base.length_m) ** 2])

    J = np.stack([(ends(q + h) - ends(q - h)) / 2e-6 for h in 1e-6 * np.eye(5)], 1)
    origin = frames.to_world(np.array([[*part.o, 0.0]]))[0]
    along = frames.R_scene_world[0, :2] / np.linalg.norm(frames.R_scene_world[0, :2])
    scaled = ends(q) / frames.scale + [0, 0, origin[2], origin[2], 0]
    return CatenaryFit(
        Base(origin[:2], along, part.length_m / frames.scale), scaled, J @ covariance @ J.T / frames.scale**2,
        np.ones(one.sightings, bool), one.rms / frames.scale, one.rms / frames.scale,
    )  # fmt: skip


def kind_of(place: int, heights: Sequence[float]) -> Kind:
    """Of the highest wire, by how far it hangs above the rest."""
    if place or len(heights) < 3:
        return "phase"
    return "shield" if heights[0] - heights[1] > ABOVE_ALL * (heights[1] - heights[-1]) else "phase"
