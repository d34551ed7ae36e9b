"""Points of one survey in the LineFrame of another."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float
from pyproj import CRS, Transformer

from plnerf.capture.heights import heights_of, horizontal
from plnerf.capture.local_frame import GEOGRAPHIC, LocalFrame
from plnerf.errors import SurveyError
from plnerf.line.frame import LineFrame

Points = Float[np.ndarray, "n 3"]
Onto = Callable[[Points], Points]


def onto(a: LineFrame, b: LineFrame) -> Onto:
    """From A's LineFrame to B's.  Heights stay what they are.

    Raises SurveyError where one of the two has no scale, the place of one alone on the earth is known, or
    their heights are known to be above different things.
    """
    if "unscaled" in {a.unit, b.unit}:
        raise SurveyError(
            "Two surveys can only be compared in metres, but one is unscaled. Give its photos positions or "
            "control points, and survey it again."
        )
    if (a.crs is None) != (b.crs is None):
        raise SurveyError(
            f"The coordinate reference system of one survey is {a.crs or b.crs}, that of the other is not "
            "known: they cannot be laid over each other. Survey both in one."
        )
    above = [heights_of(frame.crs) for frame in (a, b)]
    if above[0] != above[1] and all(one.kind != "unknown" for one in above):
        raise SurveyError(
            f"The heights of one survey are {above[0].words}, those of the other {above[1].words}: they "
            "cannot be compared. Survey both with heights above the same."
        )
    if a.crs is None or (a.crs == b.crs and _same_origin(a, b)):
        return lambda points: b.from_world(a.to_world(points))
    return lambda points: b.from_world(_from_lon_lat(b, _to_lon_lat(a, a.to_world(points))))


def _same_origin(a: LineFrame, b: LineFrame) -> bool:
    one, other = a.origin_lon_lat_height, b.origin_lon_lat_height
    if one is None or other is None:
        return one is other
    return np.array_equal(one, other)


def _earth(frame: LineFrame) -> LocalFrame:
    assert frame.origin_lon_lat_height is not None
    longitude, latitude, height = (float(value) for value in frame.origin_lon_lat_height)
    return LocalFrame(GEOGRAPHIC, (longitude, latitude, height))


def _to_lon_lat(frame: LineFrame, world: Points) -> Points:
    if frame.origin_lon_lat_height is not None:
        return _earth(frame).to_crs(world)
    flat = Transformer.from_crs(horizontal(CRS.from_user_input(frame.crs)), "EPSG:4326", always_xy=True)
    return np.column_stack([*flat.transform(world[:, 0], world[:, 1]), world[:, 2]])


def _from_lon_lat(frame: LineFrame, place: Points) -> Points:
    if frame.origin_lon_lat_height is not None:
        return _earth(frame).to_local(place)
    flat = Transformer.from_crs("EPSG:4326", horizontal(CRS.from_user_input(frame.crs)), always_xy=True)
    return np.column_stack([*flat.transform(place[:, 0], place[:, 1]), place[:, 2]])
