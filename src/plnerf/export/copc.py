"""COPC: a cloud optimized for reading a part of it, by copclib (of the extra `plnerf[gis]`).

The points of `cloud.laz` in an octree: each cube keeps the first points that are `spacing` apart in it, and
hands the others down to its eight parts.  All attributes of the point format stay; extra bytes are left out,
since copclib cannot name them.
"""

from collections.abc import Iterator
from pathlib import Path

import laspy
import numpy as np
from jaxtyping import Int
from laspy.vlrs.known import WktCoordinateSystemVlr

from plnerf.export.read_back import check_all, check_same
from plnerf.scene.files import complete_file
from plnerf.scene.las_files import open_las

CELLS = 64
"""Along each edge of a cube, of which each keeps a point."""
LEAF = 20_000
"""A cube of no more points keeps them all."""
DEEPEST = 12


def write_copc(path: Path, laz: Path) -> None:
    """Writes the points of a LAZ file, and reads them back.  Raises SurveyError where they differ."""
    import copclib

    with open_las(laz) as reader:
        las = reader.read()
    header, size = las.header, laspy.PointFormat(las.header.point_format.id).size
    config = copclib.CopcConfigWriter(
        header.point_format.id, _vector(header.scales), _vector(header.offsets), _wkt(header)
    )
    low, high = las.xyz.min(0), las.xyz.max(0)
    half = max(float((high - low).max()) / 2, 1.0)
    centre = (low + high) / 2
    config.las_header.min, config.las_header.max = _vector(low), _vector(high)
    config.las_header.generating_software = "plnerf"
    info = config.copc_info
    info.center_x, info.center_y, info.center_z = (float(one) for one in centre)
    info.halfsize, info.spacing = half, 2 * half / CELLS
    raw = np.frombuffer(las.points.array.tobytes(), np.uint8).reshape(len(las.points), -1)[:, :size]
    with complete_file(path) as beside:
        writer = copclib.FileWriter(str(beside), config)
        for key, index in _octree((las.xyz - (centre - half)) / (2 * half)):
            data = np.ascontiguousarray(raw[index]).reshape(-1).view(np.int8)
            writer.AddNode(copclib.VoxelKey(*key), copclib.VectorChar(data))
        writer.Close()
        _check(path, beside, las)


def _octree(unit: np.ndarray) -> Iterator[tuple[tuple[int, int, int, int], Int[np.ndarray, " _"]]]:
    """Depth, x, y and z of every cube, and the indices of its points; unit: places in the root, 0 to 1."""
    stack = [((0, 0, 0, 0), np.arange(len(unit)))]
    while stack:
        (depth, x, y, z), index = stack.pop()
        if len(index) <= LEAF or depth == DEEPEST:
            yield (depth, x, y, z), index
            continue
        local = unit[index] * 2**depth - [x, y, z]
        cell = np.clip((local * CELLS).astype(np.int64), 0, CELLS - 1) @ [CELLS * CELLS, CELLS, 1]
        _, first = np.unique(cell, return_index=True)
        keeps = np.zeros(len(index), np.bool_)
        keeps[first] = True
        yield (depth, x, y, z), index[keeps]
        rest, local = index[~keeps], local[~keeps]
        part = np.clip((local * 2).astype(np.int64), 0, 1)
        number = part @ [4, 2, 1]
        for k in np.unique(number).tolist():
            child = (depth + 1, 2 * x + (k >> 2), 2 * y + (k >> 1 & 1), 2 * z + (k & 1))
            stack.append((child, rest[number == k]))


def _vector(values: np.ndarray) -> tuple[float, float, float]:
    x, y, z = (float(one) for one in values)
    return x, y, z


def _wkt(header: laspy.LasHeader) -> str:
    found = [vlr.string for vlr in header.vlrs if isinstance(vlr, WktCoordinateSystemVlr)]
    return found[0] if found else ""


def _check(path: Path, beside: Path, las: laspy.LasData) -> None:
    with laspy.CopcReader.open(str(beside)) as reader:
        check_same(path, len(las.points), int(reader.header.point_count), "the number of points")
        back = reader.query()
    order, other = (np.lexsort((one.intensity, one.Z, one.Y, one.X)) for one in (las, back))
    for name in ("X", "Y", "Z", "intensity"):
        check_all(path, np.array_equal(las[name][order], back[name][other]), f"values of {name}")
    wanted, found = (np.bincount(one.classification, minlength=256) for one in (las, back))
    check_all(path, np.array_equal(wanted, found), "classes")
