"""Conductors of a run: its curves, refitted to the images, judged by the points of wires its field shows.

Letters: n points on wires, world frame; s along a wire's base, as in `catenary.py`.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from plnerf.errors import SurveyError
from plnerf.scene.transforms import Frames
from plnerf.survey.fit import CatenaryFit
from plnerf.survey.kinds import kinds
from plnerf.survey.model import Conductor
from plnerf.survey.refine.curves import Line, Refit

STEEPEST_UP = 1e-3
"""1 - cosine of the angle that the world's z may lean from up."""
NEAR_M = 0.25
"""A point this near is on the wire."""
STEP_M = 0.25
"""Length of the pieces of a wire that are with a point or without."""
HALF_SPAN_M = 20.0
"""What half of an unscaled scene's box stands for, so that its lengths have an order of magnitude."""


def conductors_of_curves(
    refits: Sequence[Refit],
    frames: Frames,
    points: Float[np.ndarray, "n 3"],
) -> list[Conductor]:
    """One conductor for each curve, the highest first."""
    metre = metre_of(frames)
    fits = [_fit(one.after, metre, points, one.end_sigma) for one in refits]
    heights = [float(fit.base.at(fit.q, np.array([fit.base.length_m / 2]))[0, 1]) for fit in fits]
    order = np.argsort(heights)[::-1].tolist()
    fits, refits = [fits[k] for k in order], [refits[k] for k in order]
    rows = []
    for k, (fit, kind) in enumerate(zip(fits, kinds(fits, [int(f.inlier.sum()) for f in fits]), strict=True)):
        mine, one = points[fit.inlier], refits[k]
        gaps = _gaps(fit, mine, STEP_M * metre)
        rows.append(
            Conductor(
                id=k + 1, span=0, kind=kind, fit=fit,
                coverage=1 - sum(gaps) / fit.base.length_m, longest_gap_m=max(gaps, default=0.0),
                evidence=len(mine), source=f"{one.images} images, and {len(mine):,} points of the field",
                note=" ".join(_notes(one, len(mine))) or None,
                before=_fit(one.before, metre, points, one.end_sigma),
            )
        )  # fmt: skip
    return rows


def _notes(one: Refit, points: int) -> list[str]:
    notes = [] if points else ["The field shows no point of it."]
    return notes + ([f"It is not refitted to the images: {one.refused}."] if one.refused else [])


def require_upright(frames: Frames) -> None:
    """Raises SurveyError where the world's z is not up."""
    if not is_upright(frames):
        raise SurveyError(
            "Sag needs a world with z up, but this scene's up direction is "
            f"{frames.R_scene_world[2].round(3).tolist()}. Turn its poses, or make them by `plnerf capture`."
        )


def is_upright(frames: Frames) -> bool:
    """Whether the world's z is up."""
    return bool(1 - frames.R_scene_world[2, 2] <= STEEPEST_UP)


def metre_of(frames: Frames) -> float:
    """A metre in world units; in an unscaled scene what stands for one."""
    return 1.0 if frames.unit == "m" else 1 / (frames.scale * HALF_SPAN_M)


def _fit(
    line: Line, metre: float, points: Float[np.ndarray, "n 3"], of_end: tuple[float, float]
) -> CatenaryFit:
    """A line, and which of the points lie on it."""
    local = line.base.local(points)
    off = local[:, 1:] - line.base.at(line.q, local[:, 0])
    inlier = (np.abs(off) <= NEAR_M * metre).all(1) & (local[:, 0] >= 0) & (local[:, 0] <= line.base.length_m)
    rms = np.sqrt((off[inlier] ** 2).mean(0)) if inlier.any() else np.zeros(2)
    return CatenaryFit(line.base, line.q, line.covariance, inlier, float(rms[0]), float(rms[1]), of_end)


def _gaps(fit: CatenaryFit, mine: Float[np.ndarray, "k 3"], step: float) -> list[float]:
    """Lengths of the stretches without a point."""
    count = max(1, int(fit.base.length_m / step))
    piece = np.clip((fit.base.local(mine)[:, 0] / fit.base.length_m * count).astype(int), 0, count - 1)
    bare = np.ones(count, int)
    bare[piece] = 0
    edges = np.flatnonzero(np.diff(np.concatenate([[0], bare, [0]])))
    return [float(b - a) * fit.base.length_m / count for a, b in zip(edges[::2], edges[1::2], strict=True)]
