"""What a click points at: a wire, a camera, a point of the cloud.

Letters: a ray from o along the unit vector d; angles from its direction as seen from o.  LineFrame.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from plnerf.line.wire import Wire
from plnerf.view.opened import Opened

WIRE_RAD, CAMERA_RAD, POINT_RAD = 0.010, 0.015, 0.006
"""Within these angles of the click a wire, a camera or a point is meant: some 9, 13 and 5 pixels of a window
of 900."""
STEP_M, FINE = 0.25, 201
"""Between the places of a wire that are compared with the ray; how many more then between three of them."""


@dataclass(frozen=True, eq=False)
class Picked:
    """A thing, and where the click meets it."""

    kind: Literal["wire", "camera", "point", "surface"]
    number: int
    """Id of the wire, index of the camera or point; 0 of the field's surface."""
    at: Float[np.ndarray, "3"]
    sigma_m: float | None = None
    """Standard deviation of its place in its least certain direction, where it is known."""


def pick_wire(opened: Opened, o: Float[np.ndarray, "3"], d: Float[np.ndarray, "3"]) -> Picked | None:
    """The wire nearest to the ray as seen from its origin."""
    best: tuple[float, Picked] | None = None
    for wire in opened.survey.wires if opened.survey is not None else ():
        s = np.linspace(0.0, wire.base.length_m, max(2, int(wire.base.length_m / STEP_M)) + 1)
        k = int(angles(wire.points(s), o, d).argmin())
        # Near the eye these places are far apart: between the neighbours of the best lies the nearest.
        fine = np.linspace(s[max(k - 1, 0)], s[min(k + 1, len(s) - 1)], FINE)
        places = wire.points(fine)
        angle = angles(places, o, d)
        k = int(angle.argmin())
        if angle[k] < WIRE_RAD and (best is None or angle[k] < best[0]):
            best = (float(angle[k]), Picked("wire", wire.id, places[k], _sigma(wire, fine[k])))
    return None if best is None else best[1]


def pick_camera(opened: Opened, o: Float[np.ndarray, "3"], d: Float[np.ndarray, "3"]) -> Picked | None:
    """The camera nearest to the ray, if any is near enough; one that the eye is at is none."""
    if opened.views is None:
        return None
    centres = opened.views.cameras.centre.numpy()
    angle = np.where(np.linalg.norm(centres - o, axis=1) > 1e-6, angles(centres, o, d), np.inf)
    k = int(angle.argmin())
    return Picked("camera", k, centres[k]) if angle[k] < CAMERA_RAD else None


def pick_point(opened: Opened, o: Float[np.ndarray, "3"], d: Float[np.ndarray, "3"]) -> Picked | None:
    """Of the cloud's points within a narrow cone around the ray, the first along it."""
    if opened.points is None or not len(opened.points.xyz):
        return None
    near = np.flatnonzero(angles(opened.points.xyz, o, d) < POINT_RAD)
    if not len(near):
        return None
    k = int(near[((opened.points.xyz[near] - o) @ d).argmin()])
    return Picked("point", k, opened.points.xyz[k])


def angles(
    x: Float[np.ndarray, "n 3"], o: Float[np.ndarray, "3"], d: Float[np.ndarray, "3"]
) -> Float[np.ndarray, " n"]:
    """Between the ray and the directions to points; infinite behind it."""
    to = x - o
    along = to @ d
    across = np.linalg.norm(to - along[:, None] * d, axis=1)
    found: Float[np.ndarray, " n"] = np.where(along > 0, across / np.maximum(along, 1e-9), np.inf)
    return found


def _sigma(wire: Wire, s: float) -> float:
    """Largest standard deviation across the wire at s."""
    return float(wire.sigma_at(np.array([s])).max())
