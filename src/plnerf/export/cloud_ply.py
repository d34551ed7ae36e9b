"""A survey's points as PLY in world coordinates, float64; of an unscaled survey in those of its LineFrame.

A comment in the header says what they refer to.
"""

from pathlib import Path

import numpy as np
from jaxtyping import Float, Shaped

from plnerf.export.crs import CrsTransform
from plnerf.export.read_back import check_all, check_places
from plnerf.line.cloud import Cloud
from plnerf.line.survey import WirePoints
from plnerf.scene.files import complete_file
from plnerf.scene.ply import read_ply, write_ply


def write_cloud_ply(path: Path, cloud: Cloud, transform: CrsTransform) -> None:
    """Writes the classified cloud and reads it back.  Raises SurveyError where they differ."""
    columns = {"classification": cloud.label, "wire_id": cloud.wire.astype(np.int32)}
    if cloud.rgb is not None:
        columns |= dict(zip(("red", "green", "blue"), cloud.rgb.T, strict=True))
    if cloud.sigma_m is not None:
        columns["sigma"] = cloud.sigma_m.astype(np.float32)
    _write(path, transform.to_world(cloud.xyz), columns, transform.world_reference)


def write_wires_ply(path: Path, points: WirePoints, transform: CrsTransform) -> None:
    """Writes the points that a field shows on wires and reads them back, likewise."""
    columns = {"view": points.view.astype(np.int32), "solid": points.solid.astype(np.float32)}
    _write(path, transform.to_world(points.xyz), columns, transform.world_reference)


def _write(
    path: Path, xyz: Float[np.ndarray, "n 3"], columns: dict[str, Shaped[np.ndarray, " n"]], reference: str
) -> None:
    with complete_file(path) as beside:
        write_ply(beside, xyz, columns, reference)
        read = read_ply(beside)["vertex"]
        check_places(path, xyz, np.stack([read[axis] for axis in "xyz"], 1).astype(np.float64), "points")
        for name, column in columns.items():
            check_all(path, np.array_equal(read[name], column), f"values of {name}")
