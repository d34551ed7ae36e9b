"""Blocks of clouds that are larger than memory: where files have points, and the points of some squares.

Files are read in chunks; memory grows with the number of squares, not of points.
"""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import laspy
import numpy as np
from jaxtyping import Int

from plnerf.errors import SurveyError
from plnerf.scene.files import complete_file, write_text
from plnerf.scene.las_files import open_las
from plnerf.scene.strict_json import read_json
from plnerf.survey.lidar.metric import in_metres
from plnerf.survey.lidar.point_cloud import SUFFIXES
from plnerf.survey.part import Cells

CHUNK = 2_000_000
"""Points that are read at a time."""
POINTS, SQUARES = "points.laz", "squares.json"
"""A block's points, and where they lie, in its folder."""


@dataclass(frozen=True, eq=False)
class Squares:
    """The squares in which the files of a corridor have points."""

    cells: Cells
    count: Int[np.ndarray, " c"]
    """Points of each square."""
    crs: str | None
    """The coordinate system that all files have in common; None: they state none."""


def is_cloud(source: Path) -> bool:
    """Whether something is a LAS or LAZ file, or a folder with any."""
    return source.suffix.lower() in SUFFIXES or (source.is_dir() and bool(_files(source)))


def sources_of(source: Path) -> tuple[Path, ...]:
    """The LAS and LAZ files that a source means, by name."""
    return tuple(_files(source)) if source.is_dir() else (source,)


def squares_of(paths: Sequence[Path], side_m: float) -> Squares:
    """Where files have points.  Raises SurveyError where one cannot be read, is in no metres, or is in
    another coordinate system or point format than the first."""
    found: dict[tuple[int, int], int] = {}
    first: tuple[str | None, int] | None = None
    for path in paths:
        with open_las(path) as reader:
            crs = _crs_in_metres(reader, path)
            mine = (crs, reader.header.point_format.id)
            first = first or mine
            if mine != first:
                raise SurveyError(
                    f"{path} has the coordinate system {mine[0]} and point format {mine[1]}, but {paths[0]} "
                    f"has {first[0]} and {first[1]}. Convert all tiles to the same."
                )
            for points in reader.chunk_iterator(CHUNK):
                flat = np.stack([points.x, points.y], 1)
                keys, count = np.unique(_keys(flat, side_m), axis=0, return_counts=True)
                for key, more in zip(map(tuple, keys.tolist()), count.tolist(), strict=True):
                    found[key] = found.get(key, 0) + more
    if not found or first is None:
        raise SurveyError(f"{paths[0].parent if paths else 'The corridor'} has no points.")
    keys, count = np.array(list(found), np.int64), np.array(list(found.values()))
    return Squares(Cells(side_m, keys), count, first[0])


def write_squares(folder: Path, cells: Cells) -> None:
    """Writes which squares a block reads."""
    write_text(folder / SQUARES, json.dumps({"side": cells.side, "keys": cells.keys.tolist()}) + "\n")


def block_points(folder: Path, paths: Sequence[Path]) -> Path:
    """Writes the points that lie in a block's squares, with all their attributes, once; returns the file."""
    path = folder / POINTS
    if path.is_file():
        return path
    stated = read_json(folder / SQUARES, SurveyError)
    cells = Cells(float(stated["side"]), np.array(stated["keys"], np.int64).reshape(-1, 2))
    low, high = cells.keys.min(0) * cells.side, (cells.keys.max(0) + 1) * cells.side
    with complete_file(path) as beside:
        writer: laspy.LasWriter | None = None
        for source in paths:
            with open_las(source) as reader:
                header = reader.header
                if (header.mins[:2] > high).any() or (header.maxs[:2] < low).any():
                    continue
                if writer is None:
                    own = laspy.LasHeader(version=header.version, point_format=header.point_format)
                    own.scales, own.offsets, own.vlrs = header.scales, header.offsets, header.vlrs
                    own.global_encoding = header.global_encoding
                    writer = laspy.open(beside, mode="w", header=own)
                for points in reader.chunk_iterator(CHUNK):
                    inside = cells.hold(np.stack([points.x, points.y], 1))
                    if inside.any():
                        some = points[inside]
                        some.change_scaling(writer.header.scales, writer.header.offsets)
                        writer.write_points(some)
        if writer is None:
            raise SurveyError(f"None of {len(paths)} files has points in {folder.name}. Were any moved?")
        writer.close()
    return path


def stamps_of(paths: Sequence[Path], cells: Cells) -> str:
    """A fingerprint of a block's points: its squares, and sizes and times of all files."""
    stats = [(path.name, path.stat().st_size, path.stat().st_mtime_ns) for path in paths]
    whole = hashlib.sha256(repr((stats, cells.side)).encode())
    whole.update(np.ascontiguousarray(cells.keys[np.lexsort(cells.keys.T)]).tobytes())
    return whole.hexdigest()


def _files(folder: Path) -> list[Path]:
    return sorted(path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES)


def _keys(flat: np.ndarray, side_m: float) -> Int[np.ndarray, "n 2"]:
    keys: Int[np.ndarray, "n 2"] = np.floor(flat / side_m).astype(np.int64)
    return keys


def _crs_in_metres(reader: laspy.LasReader, path: Path) -> str | None:
    """The file's CRS; raises SurveyError where its coordinates are no metres."""
    header = reader.header
    found = in_metres(np.stack([header.mins, header.maxs]), header, path)
    if found.origin is not None:
        raise SurveyError(
            f"{path} is not in metres ({found.crs}). A corridor is cut by metres: convert the tiles to a "
            "projected coordinate system first, or survey each as one cloud: plnerf survey."
        )
    return found.crs
