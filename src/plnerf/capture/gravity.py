"""Which way is up in a reconstruction: as the gimbal said when the photos were taken, or as cameras are held.

Letters: n images; R (n 3 3) camera to reconstruction, OpenCV's camera axes (x right, y down, z forward).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from plnerf.scene.orientation import estimate_up

LEAST_IMAGES = 3


@dataclass(frozen=True, eq=False)
class Gravity:
    """The direction against gravity."""

    up: Float[np.ndarray, "3"]
    scatter_deg: float
    """Median angle between it and what single images say."""
    source: str
    """Who says so, in words."""


def gravity_from_level_cameras(R: Float[np.ndarray, "n 3 3"], centres: Float[np.ndarray, "n 3"]) -> Gravity:
    """As cameras are usually held, level: an assumption, and said to be one."""
    up, how = estimate_up(R, centres)
    tilt = np.degrees(np.arcsin(np.clip(np.abs(R[:, :, 0] @ up), 0, 1)))
    return Gravity(up, float(np.median(tilt)), f"cameras taken for level ({how})")


def up_in_camera(pitch_deg: float, roll_deg: float) -> Float[np.ndarray, "3"]:
    """Up as a camera sees it: pitch is positive upwards and -90 looks down, roll positive to the right."""
    pitch, roll = np.radians([pitch_deg, roll_deg])
    return np.array([-np.cos(pitch) * np.sin(roll), -np.cos(pitch) * np.cos(roll), np.sin(pitch)])


def gravity_from_gimbal(
    R: Float[np.ndarray, "n 3 3"], pitch_roll_deg: Float[np.ndarray, "n 2"]
) -> Gravity | None:
    """What most images agree on; None for fewer than LEAST_IMAGES, and where they differ by 20 degrees."""
    if len(R) < LEAST_IMAGES:
        return None
    said = np.stack([turn @ up_in_camera(*angles) for turn, angles in zip(R, pitch_roll_deg, strict=True)])
    middle = np.median(said, axis=0)
    if np.linalg.norm(middle) < 0.1:
        return None
    near = said @ (middle / np.linalg.norm(middle)) > np.cos(np.radians(20))
    if near.sum() < LEAST_IMAGES:
        return None
    up = said[near].mean(0)
    up /= np.linalg.norm(up)
    scatter = float(np.degrees(np.median(np.arccos(np.clip(said @ up, -1, 1)))))
    return Gravity(up, scatter, "the gimbal's angles") if scatter < 20 else None
