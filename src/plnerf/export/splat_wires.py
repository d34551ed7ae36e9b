"""Wires as rows of long Gaussians along their curves: drawn for display, and not what the field shows."""

from collections.abc import Sequence

import numpy as np

from plnerf.export.splat_seed import z_along
from plnerf.export.splat_sh import Y_0
from plnerf.export.splats import Splats
from plnerf.line.wire import Wire

STEP = 0.5
"""Between Gaussians, in metres (units of an unscaled frame) along the wire."""
DIAMETER_M = 0.03
"""Of a wire whose diameter is not known."""
OPACITY = 0.95
GREY = 0.25
_FULL_WIDTH = 2.3548  # at half the height, in standard deviations
_OVERLAP = 0.6  # standard deviation along the wire, in steps


def wire_splats(wires: Sequence[Wire], degree: int) -> Splats:
    """Gaussians along wires from end to end, LineFrame, grey; none where there are no wires.

    Their full width at half the height is the wire's diameter.
    """
    parts = [(wire, wire.polyline(STEP)) for wire in wires]
    ends = [line for _, line in parts]
    first = np.concatenate([line[:-1] for line in ends]) if ends else np.zeros((0, 3))
    last = np.concatenate([line[1:] for line in ends]) if ends else np.zeros((0, 3))
    length = np.linalg.norm(last - first, axis=1)
    across = np.concatenate([
        np.full(len(line) - 1, (wire.diameter_m or DIAMETER_M) / _FULL_WIDTH) for wire, line in parts
    ] or [np.zeros(0)])  # fmt: skip
    sh = np.zeros((len(first), (degree + 1) ** 2, 3), np.float32)
    sh[:, 0] = (GREY - 0.5) / Y_0
    return Splats(
        xyz=(first + last) / 2,
        scale=np.stack([across, across, _OVERLAP * length], 1).astype(np.float32),
        rotation=z_along((last - first) / np.maximum(length, 1e-12)[:, None]),
        opacity=np.full(len(first), OPACITY, np.float32),
        sh=sh,
        drawn=len(first),
    )
