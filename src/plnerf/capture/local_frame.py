"""East, north and up about a point of the earth, and the coordinates of a survey.

Everything here is float64: a UTM coordinate in float32 is half a metre off.  Between a survey's CRS and the
local frame lie geocentric coordinates (EPSG:4978), and no plane: far from the origin the local frame stays
exact, and its z leaves the earth's surface by d^2 / 12,700 km.

Heights stay what they are: those above a vertical datum are not turned into heights above the ellipsoid,
which needs the datum's grid.  The local frame then lies as if the datum were the ellipsoid, tens of metres
off in height, which changes lengths by less than 1 mm in 50 m, and coordinates come back as they went in.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from jaxtyping import Float
from pyproj import CRS, Transformer
from pyproj.exceptions import CRSError, ProjError

from plnerf.capture.heights import height_unit_m, horizontal, known_crs
from plnerf.errors import CaptureError

GEOCENTRIC, GEOGRAPHIC = "EPSG:4978", "EPSG:4979"


@dataclass(frozen=True)
class LocalFrame:
    """Metres east, north and up of an origin."""

    crs: str
    """Of the survey: what pyproj understands, such as EPSG:25832 or, with heights, EPSG:25832+7837."""
    origin: tuple[float, float, float]
    """Longitude and latitude in degrees, height in metres above what the heights of `crs` are above."""

    def to_local(self, xyz: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Coordinates of the CRS, x or longitude first, to metres.  Raises CaptureError where it has none."""
        local: Float[np.ndarray, "n 3"] = (_geocentric(self.crs, xyz) - self._centre) @ self._axes.T
        return local

    def to_crs(self, local: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """The inverse of `to_local`."""
        return _from_geocentric(self.crs, local @ self._axes + self._centre)

    @property
    def _centre(self) -> Float[np.ndarray, "3"]:
        return _geocentric(GEOGRAPHIC, np.array([self.origin]))[0]

    @property
    def _axes(self) -> Float[np.ndarray, "3 3"]:
        """Rows: east, north and up at the origin, in geocentric axes."""
        longitude, latitude = np.radians(self.origin[:2])
        (s, c), (sp, cp) = ((np.sin(a), np.cos(a)) for a in (longitude, latitude))
        return np.array([[-s, c, 0.0], [-sp * c, -sp * s, cp], [cp * c, cp * s, sp]])

    def to_json(self) -> dict[str, Any]:
        """Plain values."""
        return {"crs": self.crs, "origin_lon_lat_height": list(self.origin)}

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> "LocalFrame":
        """The inverse of `to_json`.  Raises CaptureError for anything else."""
        try:
            longitude, latitude, height = (float(value) for value in data["origin_lon_lat_height"])
            frame = cls(str(data["crs"]), (longitude, latitude, height))
        except (KeyError, TypeError, ValueError) as error:
            raise CaptureError(
                "A georeference needs crs and origin_lon_lat_height (three numbers), but holds "
                f"{dict(data)} ({error!r}). Capture the scene again."
            ) from error
        check_crs(frame.crs)
        return frame


def local_frame(crs: str, xyz: Float[np.ndarray, "n 3"]) -> LocalFrame:
    """The frame whose origin is the median of some coordinates of a CRS."""
    middle = np.median(_geocentric(crs, xyz), axis=0, keepdims=True)
    longitude, latitude, height = _from_geocentric(GEOGRAPHIC, middle)[0]
    # Rounded, so that files say the same wherever they are made: 1e-7 degrees are a centimetre.
    return LocalFrame(crs, (round(longitude, 7), round(latitude, 7), round(height, 3)))


def check_crs(crs: str) -> None:
    """Raises CaptureError for a CRS that coordinates cannot be turned from or into."""
    _to_geocentric(crs), _of_geocentric(crs)


@cache
def _to_geocentric(crs: str) -> Transformer:
    return _transformer(crs, GEOCENTRIC, crs)


@cache
def _of_geocentric(crs: str) -> Transformer:
    return _transformer(GEOCENTRIC, crs, crs)


def _transformer(source: str, target: str, crs: str) -> Transformer:
    try:
        there, here = (horizontal(known_crs(part)).to_3d() if part != GEOCENTRIC else CRS(part)
                       for part in (source, target))  # fmt: skip
        return Transformer.from_crs(there, here, always_xy=True, allow_ballpark=False)
    except (CRSError, ProjError) as error:
        raise CaptureError(
            f"The coordinate reference system {crs!r} cannot be used ({error}). Give an EPSG code such as "
            "EPSG:25832, EPSG:25832+7837 with heights, a PROJ string or WKT."
        ) from error


def _geocentric(crs: str, xyz: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    return _transformed(_to_geocentric(crs), crs, xyz * [1.0, 1.0, _height_unit_m(crs)])


def _from_geocentric(crs: str, xyz: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    return _transformed(_of_geocentric(crs), crs, xyz) / [1.0, 1.0, _height_unit_m(crs)]


@cache
def _height_unit_m(crs: str) -> float:
    return height_unit_m(known_crs(crs))


def _transformed(
    transformer: Transformer, crs: str, xyz: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "n 3"]:
    found: Float[np.ndarray, "n 3"] = np.stack(transformer.transform(*xyz.astype(np.float64).T), 1)
    bad = np.nonzero(~np.isfinite(found).all(1))[0]
    if len(bad):
        raise CaptureError(
            f"{len(bad)} of {len(xyz)} coordinates lie outside of what {crs} can say, the first of them "
            f"{xyz[bad[0]].tolist()}. Is it the right CRS, and x (or longitude) before y?"
        )
    return found
