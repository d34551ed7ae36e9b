"""Whether a refitted wire is to be believed, and what it may be off by.

One that few images show, that stands out no more than what is beside it, or that moved farther than its
detection may be off stays where it was detected, with what that may be off by.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float, Int

from plnerf.line.base import Base
from plnerf.line.curve import LEAST_BEND_M, curve_at, curve_by_theta
from plnerf.line.wire import Wire
from plnerf.survey.refine.adjust import Step
from plnerf.survey.refine.config import RefineConfig
from plnerf.survey.refine.profiles import ProfileMeasurements
from plnerf.survey.refine.unknowns import SWING, Prior

Stretches = tuple[tuple[float, float], ...]
"""From where to where along a wire, metres."""
ALIKE = np.kron(np.eye(2), np.ones((2, 2)))
"""Of what displaces all of a wire alike: y_A goes with y_B, and z_A with z_B."""


def believed(
    wire: Wire,
    prior: Prior,
    steps: tuple[Step, Step],
    w: int,
    found: Sequence[Sequence[ProfileMeasurements]],
    seen: Stretches,
    more: float,
    config: RefineConfig,
) -> Wire:
    """The refitted wire if it is to be believed, else the wire as it was and why.

    steps: by all measurements, and by those on what enough images show; what lies beside a wire that is
    hardly seen pulls at the others, which help to find it and do not make it certain.  more: how many times
    as often the wire stands out as what is beside it.
    """
    step, sure = steps
    rows = [row[w] for row in found]
    views, count = sum(len(row) > 0 for row in rows), sum(len(row) for row in rows)
    off, theta = step.off_px[w], step.state.theta[w]
    trust, base = prior.trust_m[w], wire.base
    s = np.linspace(0, base.length_m, config.samples)
    moved, own = between(base, prior.theta[w], theta, s), step.of_wire(w)
    J = curve_by_theta(theta, base.length_m, s)
    sigma = float(np.sqrt(np.linalg.eigvalsh(J @ own @ J.transpose(0, 2, 1))[:, -1].min()))
    near = float((np.abs(off) <= config.near_px).mean()) if len(off) else 0.0
    refused, at_odds = None, 0.0
    if views < config.least_views or not len(off):
        refused = f"{views} images show it"
    elif sigma > config.no_news * trust:
        refused = "the views do not fix it better than its detection did"
    elif len(off) < config.least_visible * count:
        refused = f"it stands out at {len(off) / count:.1%} of the places where it was measured"
    elif near < config.least_near:
        refused = f"{near:.0%} of its measurements lie within a pixel of it"
    elif more < config.least_beside:
        refused = f"it stands out {more:.1f} times as often as what is beside it"
    elif moved > config.most_moved * trust:
        refused = f"it moved {moved / trust:.1f} times as far as its detection may be off"
        at_odds = moved / 2  # an interval of 95 % holds both
    evidence = replace(wire.evidence, source=f"{views} images", count=views, seen_m=seen)
    if refused is not None:
        # A detection states its least certain point: that stands for all of them, and for the bow.  Of one
        # that full-size images do not show, it is all that it may be off by, and of one that they show
        # elsewhere, which of the two is right is not known.
        sigma = max(wire.worst_sigma(), trust if more < config.least_beside else 0.0, at_odds)
        swing = min(np.radians(config.adjust.swing_deg), sigma / max(float(wire.theta[4]), LEAST_BEND_M))
        held = np.diag([sigma**2] * 5 + [max(swing**2, float(wire.covariance[SWING, SWING]))])
        notes = (*wire.notes, f"It is not refitted to the images: {refused}.")
        return replace(wire, covariance=held, evidence=evidence, notes=notes)
    undescribed_px = config.undescribed * step.pose_residual_px()
    by_view, common = (float(np.hypot(px, undescribed_px)) for px in (config.systematic_px, config.common_px))
    covariance = sure.of_wire(w) + by_view**2 * sure.displaced[w]
    covariance[:4, :4] += ALIKE * (common / step.pixels_per_m) ** 2
    return replace(wire, theta=theta, covariance=covariance, evidence=evidence)


def on_stretches(
    seen: Sequence[Stretches], found: Sequence[Sequence[ProfileMeasurements]]
) -> list[list[ProfileMeasurements]]:
    """Of every image, the measurements of each wire on the stretches that are seen of it."""

    def within(s: Float[np.ndarray, " k"], some: Stretches) -> Bool[np.ndarray, " k"]:
        inside = np.zeros(len(s), np.bool_)
        for low, high in some:
            inside |= (s >= low) & (s <= high)
        return inside

    return [
        [one.only(within(one.s, some)) for one, some in zip(row, seen, strict=True)] for row in found
    ]


def stretches_seen(
    step: Step, w: int, length_m: float, config: RefineConfig, measured: Float[np.ndarray, " k"] | None = None
) -> Stretches:
    """Stretches of a wire on which enough images show it near to its curve.

    measured: all places along it where it was measured; with these, only where it stands out at a fair share
    of them around a piece, as a curve beside a wire does not.
    """
    count = max(1, round(length_m / config.piece_m))

    def pieces(s: Float[np.ndarray, " k"]) -> Int[np.ndarray, " k"]:
        return np.clip((s / length_m * count).astype(np.int64), 0, count - 1)

    near = np.abs(step.off_px[w]) <= config.near_px
    piece = pieces(step.s[w][near])
    shown = np.zeros((count, len(step.state.pose)), np.bool_)
    shown[piece, step.image[w][near]] = True
    enough = shown.sum(1) >= config.least_views
    if measured is not None:
        around = np.ones(2 * config.pieces_around + 1)
        here, of = (
            np.convolve(np.bincount(some, minlength=count), around)[config.pieces_around :][:count]
            for some in (piece, pieces(measured))
        )
        enough &= here >= config.least_often * of
    edges = np.flatnonzero(np.diff(np.concatenate([[0], enough.astype(np.int8), [0]]))) * length_m / count
    return tuple((float(low), float(high)) for low, high in zip(edges[::2], edges[1::2], strict=True))


def between(
    base: Base, one: Float[np.ndarray, "6"], other: Float[np.ndarray, "6"], s: Float[np.ndarray, " k"]
) -> float:
    """Greatest distance between two curves."""
    apart = curve_at(one, base.length_m, s) - curve_at(other, base.length_m, s)
    return float(np.linalg.norm(apart, axis=1).max())
