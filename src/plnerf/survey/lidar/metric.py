"""A cloud's coordinates in metres, whatever its CRS has: feet, degrees, heights in another unit.

Metres of a projected CRS stay as they are.  All else becomes metres east, north and up of a place in the
cloud's middle (`capture/local_frame.py`), and the files of a survey hold the CRS's own units again, or UTM
where it has degrees.
"""

from dataclasses import dataclass
from pathlib import Path

import laspy
import numpy as np
from jaxtyping import Float
from pyproj import CRS
from pyproj.exceptions import CRSError

from plnerf.capture.heights import crs_name, height_unit_m, heights_of, horizontal
from plnerf.capture.local_frame import local_frame
from plnerf.errors import CaptureError, SurveyError
from plnerf.findings import Finding, harms, note

KIND = "coordinate system"
DEGREE_M = 111_000.0
COARSEST_M = 0.2
"""Steps of degrees that are longer on the ground than this make no wires."""
SOME = 1000
"""Points that the middle of a cloud is taken of."""


@dataclass(frozen=True, eq=False)
class Metric:
    """Points in metres, z up."""

    xyz: Float[np.ndarray, "n 3"]
    crs: str | None
    """Of the file, as EPSG codes or WKT, with the unit of its heights; None: the file states none."""
    origin: tuple[float, float, float] | None
    """Longitude, latitude and height of the metres' origin; None: they are those of the CRS."""
    findings: tuple[Finding, ...] = ()


def in_metres(xyz: Float[np.ndarray, "n 3"], header: laspy.LasHeader, path: Path) -> Metric:
    """Points of a file in metres, with what was converted.  Raises SurveyError for coordinates that its CRS
    does not have, and degrees that are too coarse."""
    try:
        crs = header.parse_crs()
    except CRSError as error:
        what = f"The coordinate system that the file states is none: {error}."
        return Metric(xyz, None, None, (note(KIND, what),))
    if crs is None:
        what = "The file states no coordinate system: its coordinates are taken for metres."
        return Metric(xyz, None, None, (note(KIND, what),))
    flat = horizontal(crs)
    unit = flat.axis_info[0]
    in_m = not flat.is_geographic and unit.unit_conversion_factor == 1
    if in_m and height_unit_m(crs) == 1:
        return Metric(xyz, text_of(crs), None)
    findings = []
    if flat.is_geographic:
        _check_fine(header, path)
    elif len(crs.axis_info) < 3:
        crs = _with_height_unit(crs, unit.unit_name, unit.unit_conversion_factor)
        findings.append(
            harms(
                KIND,
                f"The file states no unit of its heights: they are taken for {unit.unit_name}, as its other "
                "coordinates are.",
                "If they are metres, state that in the file.",
            )
        )
    named = text_of(crs)
    try:
        frame = local_frame(named, xyz[:: max(1, len(xyz) // SOME)]) if len(xyz) else None
        local = xyz if frame is None else frame.to_local(xyz)
    except CaptureError as error:
        raise SurveyError(
            f"The coordinates of {path} are none of {crs_name(crs)}: {error} Correct the file's coordinate "
            "system."
        ) from error
    if frame is None:
        return Metric(local, named, None)
    units = " and ".join(dict.fromkeys(axis.unit_name for axis in crs.axis_info))
    longitude, latitude, height = frame.origin
    what = (
        f"The file is in {units} ({crs_name(crs)}). It was read as metres east, north and up of "
        f"{longitude:.6f} degrees east, {latitude:.6f} degrees north and height {height:.2f} m."
    )
    return Metric(local, named, frame.origin, (note(KIND, what), *findings))


def text_of(crs: CRS) -> str:
    """A CRS as EPSG codes, or as WKT where it has none."""
    code = crs.to_epsg()
    if code:
        return f"EPSG:{code}"
    if crs.is_compound and heights_of(crs).kind == "datum":
        codes = [part.to_epsg() for part in crs.sub_crs_list]
        if all(codes):
            return f"EPSG:{codes[0]}+{codes[1]}"
    return str(crs.to_wkt())


def _with_height_unit(crs: CRS, name: str, metres: float) -> CRS:
    """A CRS of two dimensions with heights of a unit, above what is not stated."""
    vertical = (
        f'VERT_CS["unknown height",VERT_DATUM["unknown",2005],UNIT["{name}",{metres!r}],AXIS["Up",UP]]'
    )
    return CRS.from_wkt(f'COMPD_CS["{crs.name} + unknown height",{crs.to_wkt("WKT1_GDAL")},{vertical}]')


def _check_fine(header: laspy.LasHeader, path: Path) -> None:
    step_m = float(header.scales[:2].max()) * DEGREE_M
    if step_m > COARSEST_M:
        raise SurveyError(
            f"{path} holds degrees in steps of {step_m:.2g} m on the ground, too coarse for wires. Transform "
            "the original to a projected coordinate system, such as UTM."
        )
