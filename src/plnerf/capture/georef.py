"""A reconstruction in metres on the earth: the similarity that its cameras' stated positions ask for.

Where the positions lie on a line they leave the turn about it free; then gravity has to say which way is up.
What held it is always reported.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from plnerf.capture.gravity import Gravity
from plnerf.capture.local_frame import LocalFrame, local_frame
from plnerf.capture.references import References
from plnerf.capture.similarity import RobustFit, robust_similarity
from plnerf.errors import CaptureError

ROLL_LIMIT_DEG = 1.0
"""Turn about the track known worse than this: 20 m beside it, things are 35 cm off."""
LEAST_TRUSTED = 0.5
"""Share of the cameras' positions that must agree: a few always do, with a reconstruction of any shape."""
SAME_M = 1e-3
SCALE_LIMIT = 0.2
"""Scale known worse than this, relatively: lengths in metres would be a guess."""


@dataclass(frozen=True, eq=False)
class Anchor:
    """A place that is known in the reconstruction and on the earth: a camera, or a control point."""

    name: str
    x: Float[np.ndarray, "3"]
    """In the reconstruction."""
    xyz: tuple[float, float, float]
    sigma_m: tuple[float, float, float]
    crs: str


@dataclass(frozen=True, eq=False)
class Georeference:
    """How a reconstruction lies on the earth, and how well."""

    frame: LocalFrame
    fit: RobustFit
    names: tuple[str, ...]
    """Images and control points that were compared, in the order of the fit's residuals."""
    source: str
    held_by: str
    """What holds the turn about the track, in words."""
    gravity_scatter_deg: float | None

    def summary(self) -> dict[str, Any]:
        """Plain values: residuals in metres (all, and those that were trusted), and what holds the turn."""
        off = np.linalg.norm(self.fit.residual, axis=1)
        flat = np.linalg.norm(self.fit.residual[:, :2], axis=1)
        trusted = self.fit.inlier
        roll = self.fit.roll_sigma_deg
        return {
            **self.frame.to_json(),
            "source": self.source,
            "positions": len(off),
            "positions_trusted": int(trusted.sum()),
            "not_trusted": [name for name, good in zip(self.names, trusted, strict=True) if not good],
            "residual_median_m": float(np.median(off[trusted])),
            "residual_worst_m": float(off[trusted].max()),
            "residual_horizontal_median_m": float(np.median(flat[trusted])),
            "residual_vertical_median_m": float(np.median(np.abs(self.fit.residual[trusted, 2]))),
            "metres_per_unit": self.fit.similarity.scale,
            "scale_sigma": self.fit.scale_sigma,
            "held_by": self.held_by,
            "roll_sigma_deg": None if np.isinf(roll) else roll,
            "gravity_scatter_deg": self.gravity_scatter_deg,
        }


def georeference(
    centres: Mapping[str, Float[np.ndarray, "3"]],
    references: References,
    gravity: Gravity | None = None,
    control: Sequence[Anchor] = (),
) -> Georeference:
    """The similarity from the reconstruction to metres east, north and up.

    centres: of the cameras that have a pose, by name.  control: further places that are known in both, whose
    CRS is then the survey's.  Raises CaptureError where too few are known in both, or they do not agree.
    """
    named = [name for name in centres if name in references.by_name]
    known = [(name, references.by_name[name]) for name in named]
    anchors = [Anchor(name, centres[name], ref.xyz, ref.sigma_m, references.crs) for name, ref in known]
    anchors += control
    if not anchors:
        raise CaptureError(
            f"None of the {len(centres)} images with a pose has a position from {references.source}. Give a "
            "geo.txt with positions, or go on without: lengths are then unscaled."
        )
    crs = anchors[-1].crs
    frame = local_frame(crs, np.array([anchor.xyz for anchor in anchors if anchor.crs == crs]))
    x = np.stack([anchor.x for anchor in anchors])
    y = np.concatenate([
        LocalFrame(anchor.crs, frame.origin).to_local(np.array([anchor.xyz])) for anchor in anchors
    ])
    sigma = np.array([anchor.sigma_m for anchor in anchors])
    if len(y) > 1 and np.ptp(y, axis=0).max() < SAME_M:
        raise CaptureError(
            f"All {len(y)} positions are the same, so that they hold no scale. The receiver stood still: "
            "give positions in geo.txt, or go on without: lengths are then unscaled."
        )
    fit = robust_similarity(x, y, sigma)
    if fit.scale_sigma > SCALE_LIMIT:
        extent = float(np.linalg.norm(np.ptp(y[fit.inlier], axis=0)))
        raise CaptureError(
            f"The positions lie within {extent:.3g} m and are good to {np.median(sigma):.2g} m, so that they "
            f"hold the scale to {fit.scale_sigma:.0%} only. Give positions further apart, or better ones "
            "(geo.txt, control points)."
        )
    if not control and fit.inlier.mean() < LEAST_TRUSTED:
        raise CaptureError(
            f"Of {len(y)} positions only {fit.inlier.sum()} agree with the reconstruction. Where they are as "
            "good as they say (geo.txt), it is bent or put together wrongly: take larger photos, or more of "
            "them, which share two thirds with the next."
        )
    held = "positions"
    if fit.roll_sigma_deg > ROLL_LIMIT_DEG and gravity is not None:
        fit, held = robust_similarity(x, y, sigma, gravity.up), f"positions and {gravity.source}"
    elif fit.roll_sigma_deg > ROLL_LIMIT_DEG:
        held = "positions alone, the roll is open"
    parts = [references.source] * bool(named) + [f"{len(control)} control points"] * bool(control)
    scatter = None if gravity is None else gravity.scatter_deg
    names = tuple(anchor.name for anchor in anchors)
    return Georeference(frame, fit, names, " and ".join(parts), held, scatter)
