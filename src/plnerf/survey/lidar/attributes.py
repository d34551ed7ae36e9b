"""What a LAS file says of its points beside their places: intensity, returns, times, colours, extra bytes."""

import laspy
import numpy as np

from plnerf.line.cloud import Attributes, Extra

STANDARD = (
    "intensity", "return_number", "number_of_returns", "synthetic", "key_point", "withheld", "overlap",
    "scanner_channel", "scan_direction_flag", "edge_of_flight_line", "user_data", "point_source_id",
    "gps_time", "red", "green", "blue", "nir",
)  # fmt: skip
"""Dimensions that point formats before and after 6 have in common; scan angles differ, and waves are left."""
SCAN_ANGLE_DEG = 0.006
"""Unit of scan angles from point format 6 on; before, they are whole degrees."""


def attributes_of(las: laspy.LasData) -> Attributes:
    """All of a file's attributes as arrays, as the file has them."""
    names = set(las.point_format.standard_dimension_names)
    columns = {name: np.array(las[name]) for name in STANDARD if name in names}
    if "scan_angle" in names:
        columns["scan_angle"] = np.array(las.scan_angle)
    elif "scan_angle_rank" in names:
        whole = np.array(las.scan_angle_rank, np.float64)
        columns["scan_angle"] = np.round(whole / SCAN_ANGLE_DEG).astype(np.int16)
    raw = las.points.array
    extra = tuple(
        Extra(one.name, one.type_str(), one.description, one.scales, one.offsets, one.no_data)
        for one in las.point_format.extra_dimensions
    )
    # Not by the dimension's name: a file may have extra bytes of the name of a standard dimension.
    values = tuple(np.array(raw[one.name]) for one in extra)
    # So that laspy's own class is meant, and no extra bytes of that name.
    if "raw_classification" in (raw.dtype.names or ()):
        label = np.array(raw["raw_classification"]) & 31
    else:
        label = np.array(raw["classification"])
    standard = las.header.global_encoding.gps_time_type == laspy.header.GpsTimeType.STANDARD
    return Attributes(columns, label.astype(np.uint8), extra, values, bool(standard))
