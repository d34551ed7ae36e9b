"""Lengths along polylines in space, and even samples of them.

Letters: v vertices, n samples, k segments.  Any frame, any unit of length.
"""

import math

import numpy as np
from jaxtyping import Float

from plnerf.errors import SurveyError
from plnerf.scene.memory import require_memory

SAMPLE_BYTES = 64
"""Memory of a sample at least: its place along the line, and in space twice."""


def lengths_along(line: Float[np.ndarray, "v 3"]) -> Float[np.ndarray, " v"]:
    """Length of the polyline from its first vertex to each."""
    steps = np.linalg.norm(np.diff(line, axis=0), axis=1)
    along: Float[np.ndarray, " v"] = np.concatenate([[0.0], np.cumsum(steps)])
    return along


def require_samples(length: float, step: float) -> None:
    """Raises SurveyError where samples of a line do not fit into memory, as of coordinates that are wrong."""
    what = f"A line that is {length:.3g} long, sampled every {step:g},"
    require_memory(SAMPLE_BYTES * length / step, what, "Correct its coordinates.", SurveyError)


def resample(line: Float[np.ndarray, "v 3"], step: float) -> Float[np.ndarray, "n 3"]:
    """Points on the polyline from end to end, evenly spaced along it and at most `step` apart.

    One point where the polyline has no length.  Raises SurveyError where they do not fit into memory.
    """
    along = lengths_along(line)
    total = float(along[-1])
    if total == 0:
        return line[:1].copy()
    require_samples(total, step)
    wanted = np.linspace(0.0, total, max(1, math.ceil(total / step - 1e-9)) + 1)
    samples: Float[np.ndarray, "n 3"] = np.stack([np.interp(wanted, along, axis) for axis in line.T], axis=1)
    return samples


def onto_segments(
    points: Float[np.ndarray, "n 3"], start: Float[np.ndarray, "n 3"], end: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, " n"]:
    """How far along its own segment each point's nearest point on it lies: 0 at the start, 1 at the end."""
    along = end - start
    squared = np.einsum("ij,ij->i", along, along)
    projected = np.einsum("ij,ij->i", points - start, along) / np.where(squared > 0, squared, 1.0)
    share: Float[np.ndarray, " n"] = np.clip(projected, 0.0, 1.0)
    return share
