"""What is known in advance of where the line runs: for tests and comparisons, not for any method.

World frame, metres.
"""

import numpy as np
from jaxtyping import Float

from plnerf.synth.config import CaptureConfig
from plnerf.synth.span import Span


def hints_of(span: Span, capture: CaptureConfig) -> dict[str, object]:
    """The direction of the line and the box of its filmed stretch, as truth.json has them under `hints`."""
    low, high = span_box(span, capture)
    return {"line_axis": [*span.along, 0.0], "span_min": low.tolist(), "span_max": high.tolist()}


def span_box(span: Span, capture: CaptureConfig) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """World box around supports, wires and the ground below them, with 1 m to spare at the sides.

    Where only a stretch of the line is filmed, around what stands and hangs there.
    """
    half = span.config.span_length_m / 2
    low_m, high_m = capture.filmed_m or (-half, half)
    points = []
    for wire in span.wires:
        line = wire.polyline(0.25)
        along = line[:, :2] @ np.array(span.along)
        points.append(line if capture.filmed_m is None else line[(along >= low_m) & (along <= high_m)])
    for tower in span.towers:
        x, y, z = tower.foot
        along_m = float(np.array([x, y]) @ np.array(span.along))
        if low_m - 1e-6 <= along_m <= high_m + 1e-6:
            points.append(np.array([[x - 1.2, y - 1.2, z], [x + 1.2, y + 1.2, z + tower.height_m]]))
    if capture.filmed_m is not None:
        x_m, y_m = np.concatenate(points)[:, :2].T
        points.append(np.stack([x_m, y_m, span.ground.heights(x_m, y_m)], axis=1))
    cloud = np.concatenate(points)
    margin = np.array([1.0, 1.0, 0.0])
    return cloud.min(axis=0) - margin - [0, 0, 0.5], cloud.max(axis=0) + margin + [0, 0, 0.5]
