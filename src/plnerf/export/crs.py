"""The survey's coordinates in its CRS, and on the WGS 84 ellipsoid.

World is the survey's own frame (see `model.py`); map coordinates are metres or feet of a projected CRS, east
before north, as files of the trade want them.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float
from pyproj import CRS
from pyproj.exceptions import CRSError

from plnerf.capture.local_frame import GEOGRAPHIC, LocalFrame, local_frame
from plnerf.errors import CaptureError, SurveyError
from plnerf.survey.model import Survey

UNIT_TOLERANCE = 0.01
"""Maps of surveys are true to length within a part in a thousand; feet and Web Mercator's metres are not."""


@dataclass(frozen=True, eq=False)
class Places:
    """Turns world coordinates into those of files, and back.  Made by `places_of`."""

    crs: CRS | None
    """Of map coordinates; None: they are the world's, whose place on the earth is not known."""
    to_map_frame: LocalFrame | None
    """None: map coordinates are the world's."""
    earth: LocalFrame | None
    """Metres east, north and up, from longitude and latitude; None: longitudes are not known."""
    world_to_earth: LocalFrame | None
    """From the world to the frame `earth`; None: the world is that frame."""
    notes: tuple[str, ...]

    def to_map(self, world: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Projected coordinates and heights, or the world's own."""
        return world if self.to_map_frame is None or not len(world) else self.to_map_frame.to_crs(world)

    def to_world(self, coordinates: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """The inverse of `to_map`."""
        if self.to_map_frame is None or not len(coordinates):
            return coordinates
        return self.to_map_frame.to_local(coordinates)

    def to_wgs84(self, world: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Longitude, latitude (degrees) and height above the ellipsoid."""
        east = world if self.world_to_earth is None else self.world_to_earth.to_local(world)
        return self._earth.to_crs(east)

    def from_wgs84(self, coordinates: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """The inverse of `to_wgs84`."""
        east = self._earth.to_local(coordinates)
        return east if self.world_to_earth is None else self.world_to_earth.to_crs(east)

    @property
    def _earth(self) -> LocalFrame:
        if self.earth is None:
            raise ValueError("where the survey lies on the earth is not known")
        return self.earth

    @cached_property
    def crs_json(self) -> dict[str, Any] | None:
        """How GeoJSON of 2008 names a CRS, which GIS programs still read."""
        if self.crs is None:
            return None
        authority = self.crs.to_authority()
        name = "urn:ogc:def:crs:{}::{}".format(*authority) if authority else self.crs.to_wkt()
        return {"type": "name", "properties": {"name": name}}


def places_of(survey: Survey) -> Places:
    """How the survey's coordinates become those of its CRS.

    A CRS of longitudes and latitudes is no place for metres: the UTM zone takes its part, and a note says so.
    Raises SurveyError for a CRS that pyproj does not know.
    """
    if survey.unit != "m":
        return Places(None, None, None, None, (
            "The survey has no scale: lengths are in units of its own, not in metres, and no file says where "
            "on the earth it lies.",
        ))  # fmt: skip
    if survey.crs is None:
        return Places(None, None, None, None, (
            "The survey's coordinate reference system is not known: coordinates are the survey's own metres.",
        ))  # fmt: skip
    try:
        crs = CRS.from_user_input(survey.crs)
    except CRSError as error:
        raise SurveyError(
            f"The coordinate reference system {survey.crs!r} of {survey.source} is not known ({error}). Give "
            "an EPSG code such as EPSG:25832, a PROJ string or WKT."
        ) from error
    if survey.origin is None:
        return _of_crs(survey, crs)
    longitude, latitude, height = (float(value) for value in survey.origin)
    origin = (longitude, latitude, height)
    earth = LocalFrame(GEOGRAPHIC, origin)
    if crs.is_projected:
        return Places(crs, LocalFrame(survey.crs, origin), earth, None, tuple(_of_heights(crs)))
    utm = _utm(longitude, latitude)
    return Places(CRS(utm), LocalFrame(utm, origin), earth, None, (
        f"{survey.crs} has longitudes and latitudes; files that want metres are in {utm} (UTM), with heights "
        "above the WGS 84 ellipsoid.",
    ))  # fmt: skip


def _of_crs(survey: Survey, crs: CRS) -> Places:
    """World coordinates that are those of the CRS."""
    if not crs.is_projected:
        raise SurveyError(
            f"The coordinates of {survey.source} are said to be those of {survey.crs}, which are degrees, so "
            "that they hold no metres. Project the cloud (to UTM, for example) and survey it again."
        )
    ends = [end for conductor in survey.conductors for end in (conductor.fit.curve.a, conductor.fit.curve.b)]
    some = np.array(ends) if ends else survey.cloud.xyz[:: max(1, len(survey.cloud.xyz) // 1000)]
    notes = _of_heights(crs)
    try:
        frame = local_frame(str(survey.crs), some) if len(some) else None
    except CaptureError as error:
        return Places(crs, None, None, None, (*notes, f"Longitudes and latitudes are not known: {error}"))
    if frame is None:
        return Places(crs, None, None, None, tuple(notes))
    east, north = (_metres(frame, some[0], axis) for axis in np.eye(3)[:2])
    if max(abs(east - 1), abs(north - 1)) > UNIT_TOLERANCE:
        raise SurveyError(
            f"A unit of {survey.crs} is {east:.4g} m on the ground eastwards and {north:.4g} m northwards at "
            f"{some[0].tolist()}, so that {survey.source} does not hold metres. Project the cloud to metres "
            "(to UTM, for example) and survey it again."
        )
    return Places(crs, None, LocalFrame(GEOGRAPHIC, frame.origin), frame, tuple(notes))


def _metres(frame: LocalFrame, place: Float[np.ndarray, "3"], axis: Float[np.ndarray, "3"]) -> float:
    """Length on the ground of a unit along a horizontal axis, at a place."""
    ends = frame.to_local(np.stack([place, place + 100 * axis]))
    return float(np.linalg.norm(ends[1] - ends[0])) / 100


def _of_heights(crs: CRS) -> list[str]:
    if len(crs.axis_info) > 2:
        return []
    return [
        f"{crs.name} says nothing of heights: they are taken to be above its ellipsoid. If they are above "
        "sea level, those in longitude-latitude files may be off by tens of metres."
    ]


def _utm(longitude: float, latitude: float) -> str:
    zone = int((longitude + 180) // 6) % 60 + 1
    return f"EPSG:{(32600 if latitude >= 0 else 32700) + zone}"
