"""How thick wires are and how blurred, as images show it in which some are wider than their blur.

Letters: w wires, k measurements.
"""

from collections.abc import Sequence

import numpy as np
from scipy.linalg import block_diag

from plnerf.survey.refine.config import RefineConfig
from plnerf.survey.refine.profiles import ProfileMeasurements

MOST_STEP = 0.3
"""Greatest change of a diameter's logarithm in a round."""
LEAST_BLUR_PX = 0.4
"""Least blur that is believed: a pixel alone blurs by 0.29 px."""


def likelier_widths(
    diameters: Sequence[float],
    blur_px: float,
    found: Sequence[Sequence[ProfileMeasurements]],
    config: RefineConfig,
) -> tuple[tuple[float, ...], float]:
    """A Gauss-Newton step from the wires' diameters and the images' blur towards the likeliest ones.

    found: for each image, the measurements of each wire.  A measured width holds both, the more of the blur
    the thinner the wire is: wires far away tell the blur, near ones their width.  Where neither is seen, both
    come to the configured values.
    """
    W = len(diameters)
    logs, variance = np.log(np.array(diameters) / config.diameter_m), blur_px**2
    spread = np.full((W, W), config.diameter_log_sd**2) + np.eye(W) * config.own_log_sd**2
    H = block_diag(np.linalg.inv(spread), config.blur_sd_px2**-2)
    b = -H @ np.append(logs, variance - config.blur_px**2)
    for w in range(W):
        names = ("A", "variance_A", "width_px", "wider", "wider_by_blur", "variance_wider")
        A, variance_A, width, wider, by_blur, noise = (
            np.concatenate([getattr(row[w], name) for row in found]) for name in names
        )
        clear = np.abs(A) > config.adjust.visible * np.sqrt(variance_A)
        columns = (A[:, None] * np.stack([width, by_blur], 1))[clear]
        sd = np.sqrt(noise + (config.unlike_bar * A * width) ** 2)[clear]
        apart = wider[clear] / sd
        scale = max(float(np.median(np.abs(apart))), 1.0) if len(apart) else 1.0
        weight = 1 / (1 + (apart / (config.adjust.robust * scale)) ** 2) / (sd * scale) ** 2
        own = np.array([w, W])
        H[np.ix_(own, own)] += columns.T @ (columns * weight[:, None])
        b[own] += columns.T @ (weight * wider[clear])
    step = np.linalg.solve(H, b)
    logs = logs + np.clip(step[:W], -MOST_STEP, MOST_STEP)
    blur_px = float(np.sqrt(max(variance + step[W], LEAST_BLUR_PX**2)))
    return tuple((config.diameter_m * np.exp(logs)).tolist()), blur_px
