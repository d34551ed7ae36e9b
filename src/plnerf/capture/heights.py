"""What heights are above: the ellipsoid, a vertical datum such as a sea level, or what nobody states.

A CRS says so itself.  One of three dimensions has heights above its ellipsoid, a compound one above the datum
of its vertical part, and one of two dimensions says nothing of heights.
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Literal

import numpy as np
from jaxtyping import Float
from pyproj import CRS, Transformer
from pyproj.crs import CompoundCRS
from pyproj.exceptions import CRSError, ProjError
from pyproj.transformer import TransformerGroup

from plnerf.errors import CaptureError, ConfigError

ELLIPSOID = "ellipsoid"
"""As `--height-datum` names heights above the ellipsoid."""
GEOID_M = (-107.0, 86.0)
"""Least and greatest height of the geoid (the sea's mean level, continued) above the ellipsoid anywhere."""
WGS_84 = "EPSG:4979"
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
        if vertical.name.lower().startswith("unknown"):  # it says the unit of heights alone
            return Heights("unknown", f"above nothing that {crs.sub_crs_list[0].name} states")
        authority = vertical.to_authority()
        code = " ({}:{})".format(*authority) if authority else ""
        return Heights("datum", f"above {vertical.name.replace(' height', '')}{code}")
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


def horizontal(crs: CRS) -> CRS:
    """The part of a CRS that says where, without heights."""
    return crs.sub_crs_list[0] if crs.is_compound else crs.to_2d()


def height_unit_m(crs: CRS) -> float:
    """Length of the unit of a CRS's heights; metres where it has none."""
    return float(crs.axis_info[2].unit_conversion_factor) if len(crs.axis_info) > 2 else 1.0


def crs_name(crs: CRS | str | None) -> str:
    """A CRS and what its heights are above, in words; a text that names none as it is."""
    if crs is None:
        return "no coordinate reference system"
    try:
        crs = known_crs(crs)
    except CaptureError:
        return str(crs)
    flat = horizontal(crs)
    code = flat.to_epsg()
    heights = heights_of(crs)
    words = "above what is not stated" if heights.kind == "unknown" else heights.words
    return f"{flat.name}{f' (EPSG:{code})' if code else ''}, heights {words}"


def check_height_datum(datum: str | None) -> None:
    """Raises ConfigError for what is neither the ellipsoid nor a vertical datum."""
    if datum is None or datum == ELLIPSOID:
        return
    try:
        vertical = CRS.from_user_input(datum)
    except CRSError:
        vertical = None
    if vertical is None or not vertical.is_vertical or vertical.is_compound:
        raise ConfigError(
            f"Heights are above the ellipsoid ({ELLIPSOID}) or a vertical datum such as EPSG:5773 (EGM96), "
            f"EPSG:7837 (DHHN2016) or EPSG:5703 (NAVD88), but --height-datum is {datum!r}."
        )


def with_heights(crs: str, datum: str | None) -> str:
    """A CRS with what its heights are above, where it does not say so itself.

    datum: `ELLIPSOID`, or a vertical CRS; None: that is not known.
    """
    if datum is None or heights_of(crs).kind != "unknown":
        return crs
    flat = horizontal(known_crs(crs))
    if datum == ELLIPSOID:
        solid = flat.to_3d()
        code = solid.to_epsg()
        return f"EPSG:{code}" if code else str(solid.to_wkt())
    vertical = known_crs(datum)
    codes = [part.to_authority() for part in (flat, vertical)]
    if codes[0] is not None and codes[1] is not None and codes[0][0] == codes[1][0]:
        return f"{codes[0][0]}:{codes[0][1]}+{codes[1][1]}"
    return str(CompoundCRS(f"{flat.name} + {vertical.name}", [flat, vertical]).to_wkt())


def datum_height_m(
    crs: CRS | str, lon_lat: Float[np.ndarray, "n 2"]
) -> Float[np.ndarray, " n"] | None:
    """Height of a CRS's vertical datum above the WGS 84 ellipsoid at some places; 0 for heights above an
    ellipsoid, None where nothing states the datum, or its grid is not installed (`missing_grids`)."""
    crs = known_crs(crs)
    kind = heights_of(crs).kind
    if kind == "ellipsoid":
        return np.zeros(len(lon_lat))
    if kind == "unknown":
        return None
    transformer = _to_datum(crs.to_wkt())
    if transformer is None:
        return None
    longitude, latitude = lon_lat.T
    above = transformer.transform(longitude, latitude, np.zeros(len(lon_lat)))[2]
    found: Float[np.ndarray, " n"] = -np.asarray(above, np.float64) * height_unit_m(crs)
    return found if np.isfinite(found).all() else None


@cache
def _to_datum(wkt: str) -> Transformer | None:
    """From heights above the ellipsoid to those of a CRS; None where its grid is not installed."""
    try:
        return Transformer.from_crs(WGS_84, CRS.from_wkt(wkt), always_xy=True, allow_ballpark=False)
    except (CRSError, ProjError):
        return None


@cache
def geoid_height_m(longitude: float, latitude: float) -> float | None:
    """Height of the geoid above the WGS 84 ellipsoid; None where no grid of it is installed."""
    for sea_level in SEA_LEVELS:
        height = datum_height_m(sea_level, np.array([[longitude, latitude]]))
        if height is not None:
            return float(height[0])
    return None


def missing_grids(crs: CRS | str) -> str:
    """What to install so that a CRS's heights can be turned into those above the ellipsoid, as a sentence."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that the best one is missing, which is what is asked for
        group = TransformerGroup(WGS_84, known_crs(crs), always_xy=True)
    every: Sequence[str] = [
        grid.short_name for one in group.unavailable_operations for grid in one.grids if not grid.available
    ]
    if not every:
        return "PROJ knows no grid for it."
    return f"Its grid is not installed: `projsync --file {every[0]}` brings it."
