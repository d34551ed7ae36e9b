"""From LineFrame coordinates to those of files, and back: the survey's CRS, and longitude and latitude.

Map coordinates are metres or feet of a projected CRS, east before north, as other programs expect them.
Between the LineFrame and them lies the world (`line/frame.py`).  A survey without scale has no world of
metres: its files hold LineFrame coordinates, labelled unscaled.
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
from plnerf.line.frame import LineFrame
from plnerf.line.survey import Survey

UNIT_TOLERANCE = 0.01
"""Projections of surveys keep lengths within a part in a thousand; feet and Web Mercator's metres do not."""


@dataclass(frozen=True, eq=False)
class CrsTransform:
    """Maps LineFrame coordinates to those of files, and back.  Made by `crs_transform`."""

    frame: LineFrame
    crs: CRS | None
    """Of map coordinates; None: they are the world's, whose position on the earth is not known."""
    projection: LocalFrame | None
    """Between the world and map coordinates; None: they are the same."""
    earth: LocalFrame | None
    """Between local metres and longitude, latitude and height; None: longitudes are not known."""
    earth_of_world: LocalFrame | None
    """Between those local metres and the world; None: they are the same."""
    about: tuple[str, ...]
    """What the coordinates mean, in sentences."""

    def to_world(self, line: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """World coordinates; of an unscaled survey its LineFrame coordinates as they are."""
        return line if self.frame.unit == "unscaled" else self.frame.to_world(line)

    def from_world(self, world: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """The inverse of `to_world`."""
        return world if self.frame.unit == "unscaled" else self.frame.from_world(world)

    def to_map(self, line: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Projected coordinates and heights, or the world's own."""
        world = self.to_world(line)
        return world if self.projection is None or not len(world) else self.projection.to_crs(world)

    def from_map(self, coordinates: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """The inverse of `to_map`."""
        if self.projection is not None and len(coordinates):
            coordinates = self.projection.to_local(coordinates)
        return self.from_world(coordinates)

    def to_lon_lat(self, line: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Longitude, latitude (degrees) and height above the WGS 84 ellipsoid."""
        world = self.to_world(line)
        east = world if self.earth_of_world is None else self.earth_of_world.to_local(world)
        return self._earth.to_crs(east)

    def from_lon_lat(self, coordinates: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """The inverse of `to_lon_lat`."""
        east = self._earth.to_local(coordinates)
        return self.from_world(east if self.earth_of_world is None else self.earth_of_world.to_crs(east))

    @property
    def _earth(self) -> LocalFrame:
        if self.earth is None:
            raise ValueError("the survey's position on the earth is not known")
        return self.earth

    @property
    def unit_name(self) -> str | None:
        """Of map coordinates, as pyproj names it; None: unscaled."""
        if self.crs is not None:
            return str(self.crs.axis_info[0].unit_name)
        return None if self.frame.unit == "unscaled" else "metre"

    @cached_property
    def crs_json(self) -> dict[str, Any] | None:
        """How GeoJSON of 2008 names a CRS, which GIS programs still read."""
        if self.crs is None:
            return None
        authority = self.crs.to_authority()
        name = "urn:ogc:def:crs:{}::{}".format(*authority) if authority else self.crs.to_wkt()
        return {"type": "name", "properties": {"name": name}}


def crs_transform(survey: Survey) -> CrsTransform:
    """The transform from a survey's LineFrame to its CRS.

    A geographic CRS has no metres: the UTM zone is used instead, and `about` says so.  Raises SurveyError for
    a CRS that pyproj does not know.
    """
    frame = survey.frame
    if frame.unit == "unscaled":
        return _without_crs(
            frame,
            "The survey has no scale: lengths and coordinates are unscaled, in units of the survey's own "
            "frame and not in metres, and no file states a position on the earth.",
        )
    if frame.crs is None:
        return _without_crs(
            frame,
            "The survey's coordinate reference system is not known: coordinates are the survey's own metres.",
        )
    try:
        crs = CRS.from_user_input(frame.crs)
    except CRSError as error:
        raise SurveyError(
            f"The coordinate reference system {frame.crs!r} of {survey.source} is not known ({error}). Give "
            "an EPSG code such as EPSG:25832, a PROJ string or WKT."
        ) from error
    if frame.origin_lon_lat_height is None:
        return _of_projected_world(survey, crs)
    longitude, latitude, height = (float(value) for value in frame.origin_lon_lat_height)
    origin = (longitude, latitude, height)
    earth = LocalFrame(GEOGRAPHIC, origin)
    if crs.is_projected:
        return CrsTransform(
            frame, crs, LocalFrame(frame.crs, origin), earth, None, tuple(_about_heights(crs))
        )
    utm = _utm(longitude, latitude)
    about = (
        f"{frame.crs} has longitudes and latitudes; files that need metres are in {utm} (UTM), with heights "
        "above the WGS 84 ellipsoid."
    )
    return CrsTransform(frame, CRS(utm), LocalFrame(utm, origin), earth, None, (about,))


def _without_crs(frame: LineFrame, about: str) -> CrsTransform:
    return CrsTransform(frame, None, None, None, None, (about,))


def _of_projected_world(survey: Survey, crs: CRS) -> CrsTransform:
    """The transform where world coordinates are those of the CRS itself."""
    frame = survey.frame
    if not crs.is_projected:
        raise SurveyError(
            f"The coordinates of {survey.source} are said to be those of {frame.crs}, which are degrees, so "
            "that they hold no metres. Project the cloud (to UTM, for example) and survey it again."
        )
    ends = [wire.points(np.array([0.0, wire.base.length_m])) for wire in survey.wires]
    cloud = survey.cloud.xyz
    some = frame.to_world(np.concatenate(ends) if ends else cloud[:: max(1, len(cloud) // 1000)])
    about = _about_heights(crs)
    try:
        local = local_frame(str(frame.crs), some) if len(some) else None
    except CaptureError as error:
        about.append(f"Longitudes and latitudes are not known: {error}")
        return CrsTransform(frame, crs, None, None, None, tuple(about))
    if local is None:
        return CrsTransform(frame, crs, None, None, None, tuple(about))
    east, north = (_ground_length_m(local, some[0], axis) for axis in np.eye(3)[:2])
    if max(abs(east - 1), abs(north - 1)) > UNIT_TOLERANCE:
        raise SurveyError(
            f"A unit of {frame.crs} is {east:.4g} m on the ground eastwards and {north:.4g} m northwards at "
            f"{some[0].tolist()}, so that {survey.source} does not hold metres. Project the cloud to metres "
            "(to UTM, for example) and survey it again."
        )
    return CrsTransform(frame, crs, None, LocalFrame(GEOGRAPHIC, local.origin), local, tuple(about))


def _ground_length_m(local: LocalFrame, at: Float[np.ndarray, "3"], axis: Float[np.ndarray, "3"]) -> float:
    """Length on the ground of a unit along a horizontal axis of the CRS, at a point."""
    ends = local.to_local(np.stack([at, at + 100 * axis]))
    return float(np.linalg.norm(ends[1] - ends[0])) / 100


def _about_heights(crs: CRS) -> list[str]:
    if len(crs.axis_info) > 2:
        return []
    return [
        f"{crs.name} says nothing of heights: they are taken to be above its ellipsoid. If they are above "
        "sea level, those in longitude-latitude files may be off by tens of metres."
    ]


def _utm(longitude: float, latitude: float) -> str:
    zone = int((longitude + 180) // 6) % 60 + 1
    return f"EPSG:{(32600 if latitude >= 0 else 32700) + zone}"
