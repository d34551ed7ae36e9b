"""A reconstruction in metres on the earth: the similarity that its cameras' stated positions ask for.

Where the positions lie on a line they leave the turn about it free; then gravity has to say which way is up.
What held it is always reported.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from jaxtyping import Bool, Float

from plnerf.capture.accuracy import Offset, PointResidual, Role, accuracy, common_offset
from plnerf.capture.gravity import Gravity
from plnerf.capture.heights import ELLIPSOID, datum_height_m, heights_of, missing_grids, with_heights
from plnerf.capture.local_frame import GEOGRAPHIC, LocalFrame, local_frame
from plnerf.capture.references import Reference, References
from plnerf.capture.similarity import INLIER_SIGMAS, RobustFit, robust_similarity
from plnerf.errors import CaptureError

ROLL_LIMIT_DEG = 1.0
"""Turn about the track known worse than this: 20 m beside it, things are 35 cm off."""
LEAST_TRUSTED = 0.5
"""Share of the cameras' positions that must agree: a few always do, with a reconstruction of any shape."""
SAME_M = 1e-3
SCALE_LIMIT = 0.2
"""Scale known worse than this, relatively: lengths in metres would be a guess."""


LEAST_TRUSTED_CONTROL = 0.5
"""Share of the control points that must agree with the rest, or the scene is not where they say."""

LEAST_POOR_M = 1.0
"""Standard deviation of heights from which on they may be off alike: they are no heights of RTK."""


class ControlError(CaptureError):
    """Control points and all else contradict each other."""


@dataclass(frozen=True, eq=False)
class Anchor:
    """A place that is known in the reconstruction and on the earth: a camera, or a control point."""

    name: str
    x: Float[np.ndarray, "3"]
    """In the reconstruction."""
    xyz: tuple[float, float, float]
    sigma_m: tuple[float, float, float]
    crs: str
    role: Literal["position", Role] = "position"
    """The position of a camera; a control point, which holds the scene; a check point, which does not."""


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
    points: tuple[PointResidual, ...] = ()
    """Control and check points."""
    positions_off: Offset | None = None
    """By how much the cameras' stated positions differ from what control points say, if all do alike."""
    checks_off: Offset | None = None
    """The same of check points."""

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
            "control": accuracy([point for point in self.points if point.role == "control"]),
            "check": accuracy([point for point in self.points if point.role == "check"]),
            "points": [point.to_json() for point in self.points],
            "positions_off": None if self.positions_off is None else self.positions_off.words,
            "check_points_off": None if self.checks_off is None else self.checks_off.words,
        }


def georeference(
    centres: Mapping[str, Float[np.ndarray, "3"]],
    references: References,
    gravity: Gravity | None = None,
    control: Sequence[Anchor] = (),
) -> Georeference:
    """The similarity from the reconstruction to metres east, north and up.

    centres: of the cameras that have a pose, by name.  control: control and check points, whose CRS is then
    the survey's.  Raises CaptureError where too few are known in both, or they do not agree, ControlError
    where most control points contradict the rest.
    """
    checks = [anchor for anchor in control if anchor.role == "check"]
    control = [replace(anchor, role="control") for anchor in control if anchor.role != "check"]
    named = [name for name in centres if name in references.by_name]
    known = [(name, references.by_name[name]) for name in named]
    anchors = [Anchor(name, centres[name], ref.xyz, ref.sigma_m, references.crs) for name, ref in known]
    anchors += control
    if not anchors:
        raise CaptureError(
            f"None of the {len(centres)} images with a pose has a position from {references.source}. Give a "
            "geo.txt with positions, or go on without: lengths are then unscaled."
        )
    crs = anchors[-1].crs  # of the control points, if there are any
    own = np.array([anchor.xyz for anchor in anchors if anchor.crs == crs])
    frame = local_frame(crs, own)
    x, y, sigma = _known(anchors, frame)
    if len(y) > 1 and np.ptp(y, axis=0).max() < SAME_M:
        raise CaptureError(
            f"All {len(y)} positions are the same, so that they hold no scale. The receiver stood still: "
            "give positions in geo.txt, or go on without: lengths are then unscaled."
        )
    fit = robust_similarity(x, y, sigma)
    of_control = np.array([anchor.role == "control" for anchor in anchors])
    positions_off = _height_offset(fit, of_control, sigma, anchors)
    if positions_off is not None:
        y[~of_control, 2] -= positions_off.off_m[2]
        fit = robust_similarity(x, y, sigma)
    _check_control(fit, of_control, anchors, sigma, references.source)
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
    points = [
        PointResidual(anchor.name, "control", off, bool(good))
        for anchor, off, good in zip(anchors, fit.residual, fit.inlier, strict=True)
        if anchor.role == "control"
    ]
    checks_off = None
    if checks:
        _check_heights(checks, frame)
        x, y, its = _known(checks, frame)
        off = fit.similarity(x) - y
        good = np.sqrt(((off / its) ** 2).mean(1)) <= INLIER_SIGMAS
        points += [
            PointResidual(anchor.name, "check", one, bool(well))
            for anchor, one, well in zip(checks, off, good, strict=True)
        ]
        checks_off = common_offset(-off, its, INLIER_SIGMAS)
    agree = bool(known) and fit.inlier[~of_control].mean() > LEAST_TRUSTED
    if agree and heights_of(references.crs).kind == "ellipsoid" and _good(known):
        # What agrees with good heights above the ellipsoid is above it, too.
        frame = replace(frame, crs=with_heights(frame.crs, ELLIPSOID))
    if positions_off is None and of_control.any() and not of_control.all():
        positions_off = common_offset(-fit.residual[~of_control], sigma[~of_control], INLIER_SIGMAS)
    parts = [references.source] * bool(named) + [f"{len(control)} control points"] * bool(control)
    scatter = None if gravity is None else gravity.scatter_deg
    names = tuple(anchor.name for anchor in anchors)
    return Georeference(
        frame, fit, names, " and ".join(parts), held, scatter, tuple(points), positions_off, checks_off
    )


def _known(
    anchors: Sequence[Anchor], frame: LocalFrame
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
    """Places in the reconstruction and in metres, and standard deviations of the latter.

    Heights are those above what the frame's are above, where both are known and the grids between them are
    installed; else as they are stated.
    """
    y = np.zeros((len(anchors), 3))
    for crs in dict.fromkeys(anchor.crs for anchor in anchors):
        of_it = [k for k, anchor in enumerate(anchors) if anchor.crs == crs]
        y[of_it] = LocalFrame(crs, frame.origin).to_local(np.array([anchors[k].xyz for k in of_it]))
        if _differ(crs, frame.crs):
            lon_lat = LocalFrame(GEOGRAPHIC, frame.origin).to_crs(y[of_it])[:, :2]
            here, there = (datum_height_m(one, lon_lat) for one in (crs, frame.crs))
            if here is not None and there is not None:
                y[of_it, 2] += here - there
    return np.stack([anchor.x for anchor in anchors]), y, np.array([anchor.sigma_m for anchor in anchors])


def _good(known: Sequence[tuple[str, Reference]]) -> bool:
    return bool(np.median([reference.sigma_m[2] for _, reference in known] or [np.inf]) < LEAST_POOR_M)


def _differ(one: str, other: str) -> bool:
    """Whether heights of two CRSs are known to be above different things."""
    heights = heights_of(one), heights_of(other)
    if {"unknown"} & {each.kind for each in heights}:
        return False
    return heights[0].kind != heights[1].kind or (heights[0].kind == "datum" and heights[0] != heights[1])


def _check_heights(checks: Sequence[Anchor], frame: LocalFrame) -> None:
    """Raises ControlError where check points' heights cannot be compared with the scene's."""
    for crs in {anchor.crs for anchor in checks}:
        lon_lat = np.array([frame.origin[:2]])
        lost = [one for one in (crs, frame.crs) if datum_height_m(one, lon_lat) is None]
        if _differ(crs, frame.crs) and lost:
            raise ControlError(
                f"Heights of the scene are {heights_of(frame.crs).words}, of the check points "
                f"{heights_of(crs).words}, so that they cannot be compared. {missing_grids(lost[0])} Or make "
                "some of the points control points: these then hold the heights."
            )


def _height_offset(
    fit: RobustFit, of_control: Bool[np.ndarray, " n"], sigma: Float[np.ndarray, "n 3"],
    anchors: Sequence[Anchor],
) -> Offset | None:  # fmt: skip
    """By how much the heights of all positions are off if most control points say so, and it may be: both are
    known to be above different things, or the positions are no good ones.  Barometers and receivers without
    corrections state heights above anything."""
    if _most_agree(fit, of_control) or of_control.all():
        return None
    positions, points = (
        next(anchor.crs for anchor, one in zip(anchors, of_control, strict=True) if one == control)
        for control in (False, True)
    )
    if not _differ(positions, points) and np.median(sigma[~of_control, 2]) < LEAST_POOR_M:
        return None
    common = common_offset(-fit.residual[of_control], sigma[of_control], INLIER_SIGMAS)
    return None if common is None else replace(common, off_m=-common.off_m)


def _most_agree(fit: RobustFit, of_control: Bool[np.ndarray, " n"]) -> bool:
    return not of_control.any() or bool(fit.inlier[of_control].mean() >= LEAST_TRUSTED_CONTROL)


def _check_control(
    fit: RobustFit, of_control: Bool[np.ndarray, " n"], anchors: Sequence[Anchor],
    sigma: Float[np.ndarray, "n 3"], source: str,
) -> None:  # fmt: skip
    """Raises ControlError where most control points disagree with the photos' positions: in a common offset,
    as of heights above different things, or each in its own way."""
    if _most_agree(fit, of_control):
        return
    count, good = int(of_control.sum()), int(fit.inlier[of_control].sum())
    off = -fit.residual[of_control]
    named = [anchor for anchor, one in zip(anchors, of_control, strict=True) if one]
    head = f"Of {count} control points only {good} agree with {source}"
    common = common_offset(off, sigma[of_control], INLIER_SIGMAS)
    if common is not None:
        others = heights_of(next(anchor.crs for anchor in anchors if anchor.role == "position"))
        raise ControlError(
            f"{head}, and all differ alike: they lie {common.words}. Heights of the two are above different "
            f"things: of the photos {others.words}, of the control points "
            f"{heights_of(named[0].crs).words}. State what the control points' heights are above "
            "(--height-datum EPSG:7837, for example, or EPSG:25832+7837 in the first line of their file), or "
            "correct them."
        )
    worst = sorted(zip(np.linalg.norm(off, axis=1).tolist(), named, strict=True), key=lambda one: -one[0])
    some = ", ".join(f"{anchor.name} {far:.2f} m" for far, anchor in worst[:5])
    raise ControlError(
        f"{head} within {INLIER_SIGMAS:g} standard deviations; they are off by {some}. Check their "
        "coordinate reference system, the order of their axes, and where they are marked in the images; or "
        "remove those that are wrong."
    )
