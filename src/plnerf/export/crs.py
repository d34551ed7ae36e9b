"""From LineFrame coordinates to those of files, and back: the survey's CRS, and longitude and latitude.

Map coordinates are metres or feet of a projected CRS, east before north, as other programs expect them.
Between the LineFrame and them lies the world (`line/frame.py`).  A survey without scale has no world of
metres: its files hold LineFrame coordinates, labelled unscaled.

Heights are above what the survey's CRS says (`capture/heights.py`), and every file names it.  Longitudes and
latitudes have heights above the WGS 84 ellipsoid, as GeoJSON wants them, where these can be known; else the
survey's, and the file says so.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float
from pyproj import CRS
from pyproj.exceptions import CRSError

from plnerf.capture.heights import (
    ELLIPSOID,
    crs_name,
    datum_height_m,
    heights_of,
    horizontal,
    missing_grids,
    with_heights,
)
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
    to_ellipsoid: bool = False
    """Whether heights beside longitudes and latitudes are turned into those above the ellipsoid."""

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
        """Longitude, latitude (degrees) and height, above what `lon_lat_heights` says."""
        world = self.to_world(line)
        east = world if self.earth_of_world is None else self.earth_of_world.to_local(world)
        found = self._earth.to_crs(east)
        found[:, 2] += self._datum_height_m(found)
        return found

    def from_lon_lat(self, coordinates: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """The inverse of `to_lon_lat`."""
        lowered = coordinates.copy()
        lowered[:, 2] -= self._datum_height_m(coordinates)
        east = self._earth.to_local(lowered)
        return self.from_world(east if self.earth_of_world is None else self.earth_of_world.to_crs(east))

    def _datum_height_m(self, lon_lat_height: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """What is added to the survey's heights for those beside longitudes and latitudes."""
        if not self.to_ellipsoid or self.crs is None:
            return np.zeros(len(lon_lat_height))
        found = datum_height_m(self.crs, lon_lat_height[:, :2])
        return np.zeros(len(lon_lat_height)) if found is None else found

    @cached_property
    def reference(self) -> str:
        """What map coordinates and their heights refer to, in words."""
        if self.frame.unit == "unscaled":
            return "unscaled, in the survey's own frame"
        return crs_name(self.crs) if self.crs is not None else "the survey's own metres"

    @property
    def world_reference(self) -> str:
        """What world coordinates and their heights refer to, in words."""
        origin = self.frame.origin_lon_lat_height
        if self.frame.unit == "unscaled" or origin is None:
            return self.reference
        longitude, latitude, height = (float(value) for value in origin)
        return (
            f"metres east, north and up of {longitude:.7f} degrees east, {latitude:.7f} degrees north, "
            f"height {height:.3f} m ({self.reference})"
        )

    @property
    def lon_lat_heights(self) -> str:
        """What heights beside longitudes and latitudes are above; reads on after "heights are"."""
        if self.to_ellipsoid:
            return "above the WGS 84 ellipsoid"
        return heights_of(self.crs).words

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
        """How GeoJSON of 2008 names a CRS, which GIS programs still read, without ellipsoidal heights."""
        if self.crs is None:
            return None
        whole = self.crs if self.crs.is_compound else horizontal(self.crs)
        authority = whole.to_authority()
        parts = [part.to_authority() for part in whole.sub_crs_list]
        if authority is not None:
            name = "urn:ogc:def:crs:{}::{}".format(*authority)
        elif parts and all(parts):
            name = "urn:ogc:def:crs," + ",".join("crs:{}::{}".format(*part) for part in parts)
        else:
            name = whole.to_wkt()
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
    about, named = [], frame.crs
    if not crs.is_projected:
        about.append(
            f"{horizontal(crs).name} has longitudes and latitudes; files that need metres are in UTM."
        )
        named = _utm(longitude, latitude, crs)
    crs = CRS(named)
    found = CrsTransform(frame, crs, LocalFrame(named, origin), earth, None, ())
    return _with_heights(found, about, np.array([[longitude, latitude]]))


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
    about: list[str] = []
    try:
        local = local_frame(str(frame.crs), some) if len(some) else None
    except CaptureError as error:
        about.append(f"Longitudes and latitudes are not known: {error}")
        local = None
    if local is None:
        return CrsTransform(frame, crs, None, None, None, (f"Coordinates: {crs_name(crs)}.", *about))
    east, north = (_ground_length_m(local, some[0], axis) for axis in np.eye(3)[:2])
    if max(abs(east - 1), abs(north - 1)) > UNIT_TOLERANCE:
        raise SurveyError(
            f"A unit of {frame.crs} is {east:.4g} m on the ground eastwards and {north:.4g} m northwards at "
            f"{some[0].tolist()}, so that {survey.source} does not hold metres. Project the cloud to metres "
            "(to UTM, for example) and survey it again."
        )
    found = CrsTransform(frame, crs, None, LocalFrame(GEOGRAPHIC, local.origin), local, ())
    return _with_heights(found, about, np.array([local.origin[:2]]))


def _ground_length_m(local: LocalFrame, at: Float[np.ndarray, "3"], axis: Float[np.ndarray, "3"]) -> float:
    """Length on the ground of a unit along a horizontal axis of the CRS, at a point."""
    ends = local.to_local(np.stack([at, at + 100 * axis]))
    return float(np.linalg.norm(ends[1] - ends[0])) / 100


def _with_heights(
    found: CrsTransform, about: list[str], lon_lat: Float[np.ndarray, "1 2"]
) -> CrsTransform:
    """With what the files' heights are above, and whether they can be turned into those of the ellipsoid."""
    crs = found.crs
    assert crs is not None
    heights, known = heights_of(crs), datum_height_m(crs, lon_lat) is not None
    about.append(f"Coordinates: {crs_name(crs)}.")
    if heights.kind == "unknown":
        about.append(
            "Heights are passed on as they came: above the ellipsoid and above the sea differ by tens of "
            "metres. State which they are: --height-datum."
        )
    elif not known:
        about.append(
            f"Heights beside longitudes and latitudes are {heights.words}, too, rather than above the "
            f"ellipsoid as GeoJSON wants them. {missing_grids(crs)}"
        )
    return replace(found, about=tuple(about), to_ellipsoid=known)


def _utm(longitude: float, latitude: float, like: CRS) -> str:
    """The UTM zone of a place, with heights above what those of another CRS are above."""
    zone = int((longitude + 180) // 6) % 60 + 1
    utm = f"EPSG:{(32600 if latitude >= 0 else 32700) + zone}"
    kind = heights_of(like).kind
    if kind == "unknown":
        return utm
    return with_heights(utm, ELLIPSOID if kind == "ellipsoid" else like.sub_crs_list[1].to_wkt())
