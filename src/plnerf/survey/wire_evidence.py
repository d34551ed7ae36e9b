"""What a wire of a scene rests on: the images that show it, and the points that a field has on it."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float

from plnerf.line.survey import WirePoints
from plnerf.line.wire import Wire
from plnerf.survey.config_wires import WireEvidenceConfig


def with_evidence(wires: Sequence[Wire], points: WirePoints | None, config: WireEvidenceConfig) -> list[Wire]:
    """Every wire with what shows it: the field's points on it if there is a field, else the images."""
    if points is None:
        return [by_images(wire) for wire in wires]
    return [by_points(wire, points.xyz, config) for wire in wires]


def by_images(wire: Wire) -> Wire:
    """With the coverage of the stretches that images show (`evidence.seen_m`)."""
    length, seen = wire.base.length_m, wire.evidence.seen_m or ()
    edges = np.array([0.0, *(s for stretch in seen for s in stretch), length])
    gaps = edges[1::2] - edges[::2]
    evidence = replace(
        wire.evidence, coverage=1 - float(gaps.sum()) / length, longest_gap_m=float(gaps.max())
    )
    return replace(wire, evidence=evidence)


def by_points(wire: Wire, points: Float[np.ndarray, "n 3"], config: WireEvidenceConfig) -> Wire:
    """With the coverage, gaps and residuals of a field's points on it."""
    on = points_on(wire, points, config.near_m)
    local = wire.base.local(points[on])
    off = local[:, 1:] - wire.at(local[:, 0])
    across, up = np.sqrt((off**2).mean(0)) if len(off) else (0.0, 0.0)
    gaps = _gaps(local[:, 0], wire.base.length_m, config.step_m)
    evidence = replace(
        wire.evidence,
        source=f"{wire.evidence.source}, and {len(off):,} points of the field",
        coverage=1 - sum(gaps) / wire.base.length_m,
        longest_gap_m=max(gaps, default=0.0),
        residual_across_m=float(across),
        residual_up_m=float(up),
    )
    notes = wire.notes if len(off) else ("The field shows no point of it.", *wire.notes)
    return replace(wire, evidence=evidence, notes=notes)


def points_on(wire: Wire, points: Float[np.ndarray, "n 3"], near_m: float) -> Bool[np.ndarray, " n"]:
    """Which points lie beside the wire, between its ends, no farther than `near_m` in y and in z."""
    local = wire.base.local(points)
    off = np.abs(local[:, 1:] - wire.at(local[:, 0]))
    on: Bool[np.ndarray, " n"] = (off <= near_m).all(1)
    return on & (local[:, 0] >= 0) & (local[:, 0] <= wire.base.length_m)


def _gaps(s: Float[np.ndarray, " k"], length_m: float, step_m: float) -> Sequence[float]:
    """Lengths of the stretches without a point."""
    count = max(1, int(length_m / step_m))
    piece = np.clip((s / length_m * count).astype(int), 0, count - 1)
    bare = np.ones(count, int)
    bare[piece] = 0
    edges = np.flatnonzero(np.diff(np.concatenate([[0], bare, [0]])))
    return [float(b - a) * length_m / count for a, b in zip(edges[::2], edges[1::2], strict=True)]
