"""Where crossarms may be that no wire was found on: beside a structure, as high as what it holds.

A structure's place is known by the wires on it that were found.  Where those of its other side were not, the
crossarm there stands several metres from any of them, and its points look like a plant's.  LineFrame, metres.
"""

import numpy as np
from jaxtyping import Bool, Int

from plnerf.line.ends import Attached
from plnerf.line.survey import Survey
from plnerf.survey.config_obstacles import ObstacleConfig


def in_crossarm_zone(
    survey: Survey, index: Int[np.ndarray, " m"], config: ObstacleConfig
) -> Bool[np.ndarray, " m"]:
    """Which of the indexed points of a cloud from images may be a part of a structure that holds wires."""
    inside = np.zeros(len(index), np.bool_)
    if survey.cloud.sigma_m is None:
        return inside
    points = survey.cloud.xyz[index]
    for wire in survey.wires:
        ends = wire.points(np.array([0.0, wire.base.length_m]))
        for end, held in zip(wire.ends, ends, strict=True):
            if isinstance(end, Attached):
                off = points - held
                along = np.abs(off[:, :2] @ wire.base.u) <= config.passes_m
                near = np.linalg.norm(off[:, :2], axis=1) <= config.arm_m
                inside |= along & near & (off[:, 2] >= -config.arm_below_m)
    return inside
