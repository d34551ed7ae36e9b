"""Checks whether wires can be sought in a cloud, and sorts out points that it holds twice or far away.

Letters: n points, d distinct ones among them.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from plnerf.errors import SurveyError
from plnerf.survey.lidar.config import CloudConfig


def check_cloud(xyz: Float[np.ndarray, "n 3"], config: CloudConfig) -> None:
    """Raises SurveyError for clouds that are empty, not finite, all at one place, or in degrees."""
    if not len(xyz):
        raise SurveyError("The cloud holds no points. Give one of a power line, in metres with z up.")
    bad = int((~np.isfinite(xyz).all(1)).sum())
    if bad:
        raise SurveyError(
            f"{bad} of the cloud's {len(xyz)} points have coordinates that are not finite. Remove them."
        )
    extent = np.ptp(xyz, axis=0)
    wide = float(extent[:2].max())
    small = wide < config.min_extent_m
    if small and (np.abs(xyz[:, :2]).max(0) <= [180, 90]).all() and extent[2] > wide > 0:
        raise SurveyError(
            f"The cloud's x ({xyz[:, 0].min():.6f} to {xyz[:, 0].max():.6f}) and y ({xyz[:, 1].min():.6f} to "
            f"{xyz[:, 1].max():.6f}) look like degrees, but metres are needed. Transform it to a projected "
            "coordinate system, such as UTM."
        )
    if small:
        raise SurveyError(
            f"The cloud's {len(xyz)} points lie within {wide:.3g} m of each other in plan, but a span has "
            "tens of metres. Give coordinates in metres."
        )


def distinct(xyz: Float[np.ndarray, "n 3"]) -> tuple[Float[np.ndarray, "d 3"], Int[np.ndarray, " n"]]:
    """Each place once, in the order of x, y and z, and which of them each point is."""
    order = np.lexsort(xyz.T[::-1])
    ordered = xyz[order]
    new = np.ones(len(xyz), np.bool_)
    new[1:] = (ordered[1:] != ordered[:-1]).any(1)
    which = np.empty(len(xyz), np.int64)
    which[order] = np.cumsum(new) - 1
    return ordered[new], which


def astray(points: Float[np.ndarray, "d 3"], config: CloudConfig) -> Bool[np.ndarray, " d"]:
    """Which points are far away from all others in plan."""
    edge = (1 - config.middle_share) / 2
    low, high = np.quantile(points[:, :2], [edge, 1 - edge], axis=0)
    beyond = np.maximum(low - points[:, :2], points[:, :2] - high)
    far: Bool[np.ndarray, " d"] = (beyond > config.far_times * (high - low) + config.far_m).any(1)
    return far
