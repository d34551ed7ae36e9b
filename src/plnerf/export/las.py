"""The classified cloud as LAZ: LAS 1.4, point format 7, ASPRS classes, its CRS as WKT.

Format 7 because classes of wires and towers are reserved in formats before 6.  The specification asks for
the first WKT (OGC 01-009) there.  It has no three-dimensional projected CRS: heights above an ellipsoid are
written as a compound one, whose vertical datum is the ellipsoid (type 2002).  Every point has its `wire_id`,
and `sigma` (m) where the cloud states it.  What a LAS file said of its points (intensity, returns, GPS time,
colours, scan angle, point source, extra bytes) comes out as it went in; with near infrared in point format 8.
With its classes kept, the survey's are in `plnerf_class`.
"""

from collections.abc import Iterator
from pathlib import Path

import laspy
import numpy as np
from jaxtyping import Float, UInt8
from laspy.vlrs.known import WktCoordinateSystemVlr
from pyproj import CRS
from pyproj.exceptions import CRSError

from plnerf.errors import SurveyError
from plnerf.export.crs import CrsTransform
from plnerf.export.read_back import check_all, check_places, check_same
from plnerf.line.cloud import Cloud, Extra
from plnerf.scene.files import complete_file

SCALE = 0.001
CHUNK = 500_000
OWN_CLASS = "plnerf_class"
"""Extra bytes with the survey's classes beside the input's."""
_SAID = "version, point format and the WKT bit"
_ELLIPSOIDAL = (
    'VERT_CS["Ellipsoid (metre)",VERT_DATUM["Ellipsoid",2002],UNIT["metre",1,AUTHORITY["EPSG","9001"]],'
    'AXIS["Up",UP]]'
)
COLOUR_STEP = 257
"""LAS colours have 16 bits: 255 becomes 65535."""


def write_las(path: Path, cloud: Cloud, transform: CrsTransform, *, synthetic: bool) -> None:
    """Writes a cloud and reads it back, by chunks.

    synthetic: sets that flag of every point, which is for points not observed directly, such as those from
    images.  Raises SurveyError where the file differs, or the cloud is wider than LAS can hold.
    """
    header = _header(cloud, transform)
    with complete_file(path) as beside:
        try:
            with laspy.open(beside, mode="w", header=header) as file:
                for part, at in _parts(cloud, transform):
                    file.write_points(_record(cloud, part, at, header, synthetic=synthetic))
        except OverflowError as error:
            raise SurveyError(
                f"{path} cannot hold the cloud, which is wider than {SCALE * 2**31:.0f} m. Take out stray "
                "points."
            ) from error
        _check(path, beside, cloud, transform, synthetic=synthetic)


def wkt_of(crs: CRS) -> str:
    """A CRS in the WKT that LAS 1.4 asks for, with what its heights are above, where that is known."""
    try:
        if crs.is_compound or len(crs.axis_info) < 3:
            return str(crs.to_wkt("WKT1_GDAL"))
        flat = crs.to_2d()
        return f'COMPD_CS["{flat.name} + ellipsoidal height",{flat.to_wkt("WKT1_GDAL")},{_ELLIPSOIDAL}]'
    except CRSError:  # a projection that the first WKT has no name for
        return str(crs.to_wkt())


def _header(cloud: Cloud, transform: CrsTransform) -> laspy.LasHeader:
    given = cloud.attributes
    header = laspy.LasHeader(version="1.4", point_format=8 if given and "nir" in given.columns else 7)
    header.scales = np.full(3, SCALE)
    header.offsets = np.floor(transform.to_map(cloud.xyz[:1])[0]) if len(cloud.xyz) else np.zeros(3)
    header.generating_software = "plnerf"
    header.add_extra_dim(laspy.ExtraBytesParams("wire_id", "int32", "wire, 0: none"))
    if cloud.sigma_m is not None:
        header.add_extra_dim(laspy.ExtraBytesParams("sigma", "float32", "standard deviation, m"))
    if given is not None:
        if given.keep_classes:
            header.add_extra_dim(laspy.ExtraBytesParams(OWN_CLASS, "uint8", "class by plnerf"))
        for one in given.extra:
            header.add_extra_dim(_extra(one))
        if given.standard_time:
            header.global_encoding.gps_time_type = laspy.header.GpsTimeType.STANDARD
    header.global_encoding.wkt = True  # format 7 knows no other
    if transform.crs is not None:
        header.vlrs.append(WktCoordinateSystemVlr(wkt_of(transform.crs)))
    return header


def _extra(one: Extra) -> laspy.ExtraBytesParams:
    return laspy.ExtraBytesParams(
        _name(one), one.type, one.description, offsets=one.offsets, scales=one.scales, no_data=one.no_data
    )


def _name(one: Extra) -> str:
    """Its name, or another one where it is that of a dimension of the file written."""
    taken = {*laspy.PointFormat(8).dimension_names, "wire_id", "sigma", OWN_CLASS}
    return f"input_{one.name}" if one.name in taken else one.name


def _parts(cloud: Cloud, transform: CrsTransform) -> Iterator[tuple[slice, Float[np.ndarray, "c 3"]]]:
    """Chunks of the cloud, and their map coordinates."""
    for first in range(0, len(cloud.xyz), CHUNK):
        part = slice(first, first + CHUNK)
        yield part, transform.to_map(cloud.xyz[part])


def _record(
    cloud: Cloud, part: slice, at: Float[np.ndarray, "c 3"], header: laspy.LasHeader, *, synthetic: bool
) -> laspy.ScaleAwarePointRecord:
    record = laspy.ScaleAwarePointRecord.zeros(len(at), header=header)
    record.x, record.y, record.z = at.T
    given = cloud.attributes
    if given is None:
        record.synthetic = np.full(len(at), synthetic, np.uint8)
        record.return_number = record.number_of_returns = np.ones(len(at), np.uint8)
    else:
        for name, values in given.columns.items():
            record[name] = values[part]
        for one, values in zip(given.extra, given.values, strict=True):
            record.array[_name(one)] = values[part]
    for name, label in _classes(cloud).items():
        record[name] = label[part]
    record.wire_id = cloud.wire[part].astype(np.int32)
    if cloud.sigma_m is not None:
        record.sigma = cloud.sigma_m[part].astype(np.float32)
    if cloud.rgb is not None:
        record.red, record.green, record.blue = cloud.rgb[part].T.astype(np.uint16) * COLOUR_STEP
    return record


def _check(path: Path, beside: Path, cloud: Cloud, transform: CrsTransform, *, synthetic: bool) -> None:
    with laspy.open(beside) as file:
        header = file.header
        said = (str(header.version), header.point_format.id, bool(header.global_encoding.wkt))
        check_same(path, ("1.4", _header(cloud, transform).point_format.id, True), said, _SAID)
        check_same(path, len(cloud.xyz), header.point_count, "the number of points")
        wkts = [vlr.string for vlr in header.vlrs if isinstance(vlr, WktCoordinateSystemVlr)]
        check_same(path, [] if transform.crs is None else [wkt_of(transform.crs)], wkts, "the CRS")
        for (part, at), read in zip(_parts(cloud, transform), file.chunk_iterator(CHUNK), strict=True):
            found = np.stack([np.asarray(read[axis], dtype=np.float64) for axis in "xyz"], 1)
            check_places(path, at, found, "points")
            for name, label in _classes(cloud).items():
                check_all(path, np.array_equal(read[name], label[part]), f"values of {name}")
            check_all(path, np.array_equal(read.wire_id, cloud.wire[part]), "wire ids")
            _check_attributes(path, cloud, part, read, synthetic=synthetic)
            if cloud.sigma_m is not None:
                check_all(path, np.array_equal(read.sigma, cloud.sigma_m[part].astype(np.float32)), "sigmas")
            if cloud.rgb is not None:
                colours = np.stack([read.red, read.green, read.blue], 1) // COLOUR_STEP
                check_all(path, np.array_equal(colours, cloud.rgb[part]), "colours")


def _classes(cloud: Cloud) -> dict[str, UInt8[np.ndarray, " n"]]:
    """Dimensions with classes: the survey's, or the input's and the survey's."""
    given = cloud.attributes
    if given is None or not given.keep_classes:
        return {"classification": cloud.label}
    return {"classification": given.label, OWN_CLASS: cloud.label}


def _check_attributes(
    path: Path, cloud: Cloud, part: slice, read: laspy.ScaleAwarePointRecord, *, synthetic: bool
) -> None:
    given = cloud.attributes
    if given is None:
        check_all(path, bool((np.asarray(read.synthetic) == synthetic).all()), "synthetic flags")
        return
    for name, values in given.columns.items():
        check_all(path, np.array_equal(read[name], values[part]), f"values of {name}")
    for one, values in zip(given.extra, given.values, strict=True):
        same = np.array_equal(read.array[_name(one)], values[part], equal_nan=values.dtype.kind == "f")
        check_all(path, same, f"values of {one.name}")
