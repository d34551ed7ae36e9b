"""Wires from one LineFrame into another of the same world, as when a scene's frame is fitted to its wires."""

from dataclasses import replace

import numpy as np

from plnerf.line.base import Base
from plnerf.line.ends import Attached, End, Evidence
from plnerf.line.frame import LineFrame
from plnerf.line.wire import Wire

LEVEL = 1e-9
"""1 - cosine of the angle by which the two frames' z axes may differ: 0.003 degrees."""


def move_wire(wire: Wire, old: LineFrame, new: LineFrame) -> Wire:
    """The same wire in the frame `new`, with its covariance, its ends and the lengths of its evidence.

    Raises ValueError where up is another direction in the two: then a wire's plane is no longer upright.
    """
    factor, R, shift = new.from_frame(old)
    if 1 - R[2, 2] > LEVEL:
        raise ValueError(f"the two frames' z axes differ by {np.degrees(np.arccos(R[2, 2])):.3f} degrees")
    a, b = (factor * R[:2, :2] @ end + shift[:2] for end in (wire.base.a, wire.base.b))
    J = np.diag([factor] * 5 + [1.0])
    theta = J @ wire.theta + np.array([0.0, 0.0, shift[2], shift[2], 0.0, 0.0])

    def end(one: End) -> End:
        if not isinstance(one, Attached):
            return one
        string = None if one.string_m is None else factor * one.string_m
        point = factor * R @ one.point + shift
        return replace(one, point=point, sigma_m=factor * one.sigma_m, string_m=string)

    return replace(
        wire,
        base=Base(a, b),
        theta=theta,
        covariance=J @ wire.covariance @ J,
        ends=(end(wire.ends[0]), end(wire.ends[1])),
        evidence=_resized(wire.evidence, factor),
        diameter_m=None if wire.diameter_m is None else factor * wire.diameter_m,
    )


def _resized(evidence: Evidence, factor: float) -> Evidence:
    """Its lengths in units of which one old unit has `factor`."""
    seen = evidence.seen_m
    return replace(
        evidence,
        longest_gap_m=factor * evidence.longest_gap_m,
        residual_across_m=factor * evidence.residual_across_m,
        residual_up_m=factor * evidence.residual_up_m,
        reach_m=None if evidence.reach_m is None else factor * evidence.reach_m,
        seen_m=None if seen is None else tuple((factor * low, factor * high) for low, high in seen),
    )
