"""What heights are above: the ellipsoid, a vertical datum such as a sea level, or what nobody states.

A CRS says so itself.  One of three dimensions has heights above its ellipsoid, a compound one above the datum
of its vertical part, and one of two dimensions says nothing of heights.
"""

import warnings
from dataclasses import dataclass
from functools import cache
from typing import Literal

from pyproj import CRS, Transformer
from pyproj.exceptions import CRSError, ProjError
from pyproj.transformer import TransformerGroup

from plnerf.errors import CaptureError

GEOID_M = (-107.0, 86.0)
"""Least and greatest height of the geoid (the sea's mean level, continued) above the ellipsoid anywhere."""
SEA_LEVELS = ("EPSG:4326+3855", "EPSG:4326+5773")
"""EGM2008 and EGM96, which reach round the earth; their grids do not come with pyproj."""


@dataclass(frozen=True)
class Heights:
    """What the heights of some coordinates are above."""

    kind: Literal["ellipsoid", "datum", "unknown"]
    words: str
    """Reads on after "heights are"."""


def heights_of(crs: CRS | str | None) -> Heights:
    """What the heights of a CRS's coordinates are above.  Raises CaptureError for no known CRS."""
    if crs is None:
        return Heights("unknown", "above nothing that the input states")
    crs = known_crs(crs)
    if crs.is_compound:
        vertical = crs.sub_crs_list[1]
        authority = vertical.to_authority()
        code = " ({}:{})".format(*authority) if authority else ""
        return Heights("datum", f"above {vertical.name.removesuffix(' height')}{code}")
    if len(crs.axis_info) > 2:
        return Heights("ellipsoid", f"above the ellipsoid of {geodetic_name(crs)}")
    return Heights("unknown", f"above nothing that {crs.name} states")


def geodetic_name(crs: CRS) -> str:
    """The name of a CRS's geodetic part, without the kind of its coordinates."""
    geodetic = crs.geodetic_crs
    return str(crs.name if geodetic is None else geodetic.name)


def known_crs(crs: CRS | str) -> CRS:
    """The CRS of a text.  Raises CaptureError for none that pyproj knows."""
    try:
        return CRS.from_user_input(crs)
    except CRSError as error:
        raise CaptureError(
            f"The coordinate reference system {crs!r} cannot be used ({error}). Give an EPSG code such as "
            "EPSG:25832, EPSG:25832+7837 with heights, a PROJ string or WKT."
        ) from error


@cache
def geoid_height_m(longitude: float, latitude: float) -> float | None:
    """Height of the geoid above the WGS 84 ellipsoid; None where no grid of it is installed."""
    for sea_level in SEA_LEVELS:
        try:
            transformer = Transformer.from_crs("EPSG:4979", sea_level, always_xy=True, allow_ballpark=False)
        except (CRSError, ProjError):
            continue
        height = -float(transformer.transform(longitude, latitude, 0.0)[2])
        if GEOID_M[0] <= height <= GEOID_M[1]:
            return height
    return None


def missing_grids(source: str, target: str) -> tuple[str, ...]:
    """Names of the grids of the best transformation between two CRSs that are not installed."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that the best one is missing, which is what is asked for
        group = TransformerGroup(source, target, always_xy=True)
    for operation in group.unavailable_operations:
        names = tuple(grid.short_name for grid in operation.grids if not grid.available)
        if names:
            return names
    return ()
