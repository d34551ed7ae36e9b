"""What is known in advance of where the line runs: for tests and comparisons, not for any method.

World frame, metres.
"""

import numpy as np
from jaxtyping import Float

from plnerf.synth.flight_config import CaptureConfig
from plnerf.synth.site import Site


def hints_of(site: Site, capture: CaptureConfig) -> dict[str, object]:
    """The direction of the line and the box of its filmed stretch, as truth.json has them under `hints`."""
    low, high = span_box(site, capture)
    return {"line_axis": [*site.along, 0.0], "span_min": low.tolist(), "span_max": high.tolist()}


def span_box(site: Site, capture: CaptureConfig) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """World box around supports, wires and the ground below them, with 1 m to spare at the sides.

    Where only a stretch of the line is filmed, around what stands and hangs there.
    """
    half = site.config.span_length_m / 2
    low_m, high_m = capture.filmed_m or (-half, half)
    points = []
    for wire in site.wires:
        line = wire.polyline(0.25)
        along = site.route.stations_of(line)
        points.append(line if capture.filmed_m is None else line[(along >= low_m) & (along <= high_m)])
    for tower in site.towers:
        x, y, z = tower.foot
        along_m = float(site.route.stations_of(np.array([[x, y]]))[0])
        if low_m - 1e-6 <= along_m <= high_m + 1e-6:
            points.append(np.array([[x - 1.2, y - 1.2, z], [x + 1.2, y + 1.2, z + tower.height_m]]))
    if capture.filmed_m is not None:
        x_m, y_m = np.concatenate(points)[:, :2].T
        points.append(np.stack([x_m, y_m, site.ground.heights(x_m, y_m)], axis=1))
    cloud = np.concatenate(points)
    margin = np.array([1.0, 1.0, 0.0])
    return cloud.min(axis=0) - margin - [0, 0, 0.5], cloud.max(axis=0) + margin + [0, 0, 0.5]
