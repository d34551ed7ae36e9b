"""How high a line lies above the sea, which decides how well the air around it insulates.

Heights above a vertical datum are taken for heights above the sea.  Heights above an ellipsoid are reduced by
the geoid's where its grid is installed.  Else, and where nothing says what heights are above, the geoid's
least and greatest height anywhere bound the altitude.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from plnerf.capture.heights import GEOID_M, geoid_height_m, heights_of
from plnerf.capture.local_frame import local_frame
from plnerf.errors import CaptureError
from plnerf.line.frame import LineFrame
from plnerf.line.survey import Survey


@dataclass(frozen=True)
class Altitude:
    """Height above the sea in metres, between two bounds; both are the same where it is known."""

    low_m: float
    high_m: float
    why: str = ""
    """Why it is not known better; empty where it is known."""

    @property
    def words(self) -> str:
        """The altitude, reads on after "the line is at"."""
        if self.low_m == self.high_m:
            return f"{self.low_m:.0f} m"
        return f"{self.low_m:.0f} to {self.high_m:.0f} m"


def altitude_of(survey: Survey) -> Altitude:
    """Of the highest end of a wire; 0 without wires."""
    ends = [wire.points(np.array([0.0, wire.base.length_m])) for wire in survey.wires]
    if not ends:
        return Altitude(0.0, 0.0)
    points = np.concatenate(ends)
    return altitude_at(survey.frame, points[points[:, 2].argmax()])


def altitude_at(frame: LineFrame, point: Float[np.ndarray, "3"]) -> Altitude:
    """Of a point of a metric LineFrame."""
    world = frame.to_world(point[None])
    origin = frame.origin_lon_lat_height
    z = float(world[0, 2]) + (0.0 if origin is None else float(origin[2]))
    heights = heights_of(frame.crs)
    if heights.kind == "datum":
        return Altitude(z, z)
    why = f"heights are {heights.words}"
    if heights.kind == "ellipsoid":
        place = _lon_lat(frame, world)
        geoid = None if place is None else geoid_height_m(*place)
        if geoid is not None:
            return Altitude(z - geoid, z - geoid)
        why += ", and no grid of the geoid is installed (`projsync --file us_nga_egm96_15.tif`)"
    return Altitude(z - GEOID_M[1], z - GEOID_M[0], why)


def _lon_lat(frame: LineFrame, world: Float[np.ndarray, "1 3"]) -> tuple[float, float] | None:
    if frame.origin_lon_lat_height is not None:
        longitude, latitude = (float(value) for value in frame.origin_lon_lat_height[:2])
        return longitude, latitude
    try:
        return local_frame(str(frame.crs), world).origin[:2]
    except CaptureError:  # outside of what its CRS is for
        return None
