"""A run's curves as catenaries of the world, refitted to its images and cut at their ends.

Letters: as in `catenary.py`; the base lies along the scene's x axis, over all curves.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from plnerf.detect.curves import Curve
from plnerf.scene.scene import Scene
from plnerf.scene.transforms import Frames
from plnerf.survey.fit import Base, jacobian
from plnerf.survey.refine.refine import refine

DIAMETER_M = 0.03
"""Of conductors, 1 to 5 cm."""


@dataclass(frozen=True, eq=False)
class Line:
    """A catenary between its ends, world units."""

    base: Base
    q: Float[np.ndarray, "5"]
    covariance: Float[np.ndarray, "5 5"]


@dataclass(frozen=True)
class Held:
    """Where a support holds the wires."""

    x: float
    """Along the line, scene frame."""
    sigma_m: float
    """Standard deviation of it."""


@dataclass(frozen=True, eq=False)
class Refit:
    """A curve before and after."""

    before: Line
    after: Line
    """The same as before where `refused` says why."""
    images: int
    refused: str | None
    end_sigma: tuple[float, float] = (0.0, 0.0)
    """Standard deviation of each end's place; 0 where the images end before the wire."""


def refit_curves(
    scene: Scene,
    curves: Sequence[Curve],
    metre: float,
    held: tuple[Held | None, Held | None] = (None, None),
    tell: Callable[[int, int], object] = lambda done, of: None,
) -> tuple[list[Refit], float]:
    """One for each curve, and the images' motion in pixels.

    A curve states one standard deviation, that of its least certain point in its least certain direction: it
    stands for all of them before.  metre: its length in the unit of the world, whose z is up.  held: by the
    first and the last support; there a wire ends, even where its curve ends before: the images are asked of
    the curve alone.
    """
    if not curves:
        return [], 0.0
    frames = scene.frames
    first, last = min(curve.ends[0] for curve in curves), max(curve.ends[1] for curve in curves)
    base = Base(np.array([first, 0.0]), np.array([1.0, 0.0]), last - first)
    before = [of_curve(curve, base) for curve in curves]
    found = refine(
        scene, base, before, [curve.reach for curve in curves], DIAMETER_M * metre * frames.scale, tell
    )
    first_sigma, last_sigma = (0.0 if one is None else metre * one.sigma_m for one in held)
    rows = []
    for curve, q, one in zip(curves, before, found.wires, strict=True):
        low, high = (end if at is None else at.x for end, at in zip(curve.ends, held, strict=True))
        old = cut(base, q, np.eye(5) * curve.sigma**2, (low, high), frames)
        new = old if one.refused else cut(base, one.q, one.covariance, (low, high), frames)
        rows.append(Refit(old, new, one.views, one.refused, (first_sigma, last_sigma)))
    return rows, found.motion_px


def of_curve(curve: Curve, base: Base) -> Float[np.ndarray, "5"]:
    """q of a curve over the whole base; the scene frame."""
    ends = curve.points(base.o[0] + np.array([0.0, base.length_m]))
    return np.array([*ends[:, 1], *ends[:, 2], curve.z[2] * base.length_m**2 / 4])


def cut(
    base: Base, q: Float[np.ndarray, "5"], covariance: Float[np.ndarray, "5 5"],
    ends: tuple[float, float], frames: Frames,
) -> Line:  # fmt: skip
    """The same wire between two places of the scene's x axis, in world units."""
    low, high = (end - base.o[0] for end in ends)
    share = ((high - low) / base.length_m) ** 2

    def at_ends(p: Float[np.ndarray, "5"]) -> Float[np.ndarray, "5"]:
        yz = base.at(p, np.array([low, high]))
        return np.array([*yz[:, 0], *yz[:, 1], p[4] * share])

    J = jacobian(at_ends, q)
    origin = frames.to_world(np.array([[base.o[0] + low, 0.0, 0.0]]))[0]
    along = frames.R_scene_world[0, :2] / np.linalg.norm(frames.R_scene_world[0, :2])
    return Line(
        Base(origin[:2], along, (high - low) / frames.scale),
        at_ends(q) / frames.scale + [0, 0, origin[2], origin[2], 0],
        J @ covariance @ J.T / frames.scale**2,
    )
