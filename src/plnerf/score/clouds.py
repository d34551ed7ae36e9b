"""Points of wires out of files: clouds as they are, polylines sampled along.

Whatever is read is in the scene's `world` frame (metres where the scene is metric), float64; no coordinate
reference system is converted, and none is guessed.
"""

import csv
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from textwrap import shorten
from typing import Any

import numpy as np
from jaxtyping import Float, Shaped

from plnerf.errors import SurveyError
from plnerf.line.cloud import CONDUCTOR, SHIELD
from plnerf.line.polylines import lengths_along, resample
from plnerf.scene.las_files import open_las
from plnerf.scene.npy_files import read_npy, read_npz
from plnerf.scene.ply import read_ply
from plnerf.score.config import DEFAULT
from plnerf.score.geojson import read_geojson

WIRE_CLASSES = (SHIELD, CONDUCTOR)
LAS_CHUNK = 2_000_000
MAX_SAMPLES = 60_000_000
"""Points that lines are sampled to, at the most: 1.4 GB."""


@dataclass(frozen=True, eq=False)
class FilePoints:
    """Points of wires in the world frame, and in words what of the file they are."""

    points: Float[np.ndarray, "n 3"]
    taken: str


def read_points(
    path: Path,
    *,
    classes: tuple[int, ...] | None = None,
    line_step_m: float = DEFAULT.points.line_step_m,
) -> FilePoints:
    """The points of a .ply, .npy, .npz, .csv, .txt, .xyz, .las, .laz or .geojson file.

    line_step_m: spacing of the samples of a PLY file's edges and a GeoJSON file's lines.  classes: of a LAS
    file, only points of these; None: `WIRE_CLASSES` if there are any such, else all.  A file that states that
    it holds no points gives none.  Raises SurveyError where it cannot be read, has no z, or is not finite.
    """
    readers: dict[str, Callable[[], tuple[Float[np.ndarray, "n 3"], str]]] = {
        ".ply": lambda: _read_ply(path, line_step_m),
        ".npy": lambda: _read_npy(path),
        ".npz": lambda: _read_npz(path),
        ".csv": lambda: _read_text(path),
        ".txt": lambda: _read_text(path),
        ".xyz": lambda: _read_text(path),
        ".las": lambda: _read_las(path, classes),
        ".laz": lambda: _read_las(path, classes),
        ".geojson": lambda: _read_geojson(path, line_step_m),
        ".json": lambda: _read_geojson(path, line_step_m),
    }
    read = readers.get(path.suffix.lower())
    if read is None:
        raise SurveyError(
            f"{path} has the suffix {path.suffix!r}, but points of wires are read from {', '.join(readers)}. "
            "Convert the file, or give it its right suffix."
        )
    if not path.is_file():
        raise SurveyError(f"{path} is not there, or is no file. Give a file with points of wires.")
    try:
        points, taken = read()
    except OSError as error:
        raise SurveyError(f"{path} cannot be read ({error}). Check the file.") from error
    _check_finite(points, path)
    return FilePoints(points, taken)


def sample_lines(lines: list[Float[np.ndarray, "_ 3"]], step_m: float) -> Float[np.ndarray, "n 3"]:
    """Points on all of the polylines, so far apart or closer.

    Raises SurveyError where that is more than fits into memory: a coordinate is wrong, or the step too short.
    """
    length_m = sum(float(lengths_along(line)[-1]) for line in lines)
    if not length_m / step_m <= MAX_SAMPLES:
        raise SurveyError(
            f"The lines are {length_m:,.0f} m long, which makes {length_m / step_m:,.0f} points {step_m:g} m "
            f"apart, more than {MAX_SAMPLES:,}. Correct their coordinates, or give a longer step."
        )
    return np.concatenate([np.empty((0, 3)), *(resample(line, step_m) for line in lines)])


def _read_ply(path: Path, step_m: float) -> tuple[Float[np.ndarray, "n 3"], str]:
    elements = read_ply(path)
    points = _columns(elements["vertex"], path)
    edges = elements.get("edge")
    if edges is None or not len(edges) or not {"vertex1", "vertex2"} <= set(edges.dtype.names or ()):
        return points, f"{len(points)} points"
    ends = np.stack([edges["vertex1"], edges["vertex2"]], axis=1).astype(np.int64)
    if ends.min() < 0 or ends.max() >= len(points):
        raise SurveyError(
            f"{path}: an edge names vertex {ends.max()}, but there are {len(points)}, counted from 0. Write "
            "the file again."
        )
    _check_finite(points, path)
    return sample_lines([points[pair] for pair in ends], step_m), f"{len(ends)} edges, sampled"


def _read_npy(path: Path) -> tuple[Float[np.ndarray, "n 3"], str]:
    array = read_npy(path)
    return _rows(array, path, "the array"), f"{len(array)} points"


def _read_npz(path: Path) -> tuple[Float[np.ndarray, "n 3"], str]:
    name, array = read_npz(path, "points")
    return _rows(array, path, f"the array {name!r}"), f"{len(array)} points of the array {name!r}"


def _read_text(path: Path) -> tuple[Float[np.ndarray, "n 3"], str]:
    """Columns by name where the first line has names, else the first three."""
    try:
        with path.open(encoding="utf-8-sig") as file:
            lines = list(file)
    except UnicodeDecodeError as error:
        raise SurveyError(
            f"{path} is no text in UTF-8 ({error}). Is it a binary file? Give it its right suffix."
        ) from error
    lines = [line for line in lines if line.strip()]
    if not lines:
        raise SurveyError(f"{path} is empty. A file without points has at least its header: x,y,z.")
    first = lines[0].strip().lstrip("#/").strip()
    delimiter = next((mark for mark in ",;\t" if mark in first), None)
    words = next(csv.reader([first], delimiter=delimiter)) if delimiter else first.split()
    names = [word.strip().lower().removesuffix("_m") for word in words]
    columns, skip = [0, 1, 2], 0
    if not all(_is_number(word) for word in words):
        absent = [axis for axis in "xyz" if axis not in names]
        if absent:
            raise SurveyError(
                f"{path}: the first line names the columns {shorten(', '.join(words), 200)}, among which "
                f"there is no {' and no '.join(absent)}. Name three of them x, y and z."
            )
        columns, skip = [names.index(axis) for axis in "xyz"], 1
    elif len(words) < 3:
        raise SurveyError(
            f"{path} has {len(words)} columns of numbers, but points need three: x, y and z. Write z too."
        )
    rows = lines[skip:]
    if not any(not line.startswith("#") for line in rows):
        return np.empty((0, 3)), "0 points"
    try:
        points = np.loadtxt(rows, delimiter=delimiter, usecols=columns, ndmin=2)
    except (ValueError, IndexError) as error:
        raise SurveyError(
            f"{path} cannot be read as columns of numbers ({error}). Numbers have a decimal point, columns "
            "are parted by commas, semicolons, tabs or spaces, and every line has as many."
        ) from error
    return points, f"{len(points)} points"


def _read_las(path: Path, classes: tuple[int, ...] | None) -> tuple[Float[np.ndarray, "n 3"], str]:
    counts: dict[int, int] = {}
    for chunk in _las_chunks(path):
        for code, count in zip(
            *np.unique(np.asarray(chunk.classification), return_counts=True), strict=True
        ):
            counts[int(code)] = counts.get(int(code), 0) + int(count)
    wanted = classes or tuple(code for code in WIRE_CLASSES if code in counts) or tuple(sorted(counts))
    absent = bool(counts) and not any(code in counts for code in wanted)
    parts = [] if absent else [_of_classes(chunk, wanted) for chunk in _las_chunks(path)]
    if absent:
        raise SurveyError(
            f"{path} has no points of class {_listed(wanted)}; its classes are {_listed(counts)}. Name those "
            "of its wires."
        )
    points = np.concatenate([np.empty((0, 3)), *parts])
    return points, f"{len(points)} points of class {_listed(wanted)} (in the file: {_listed(counts)})"


def _las_chunks(path: Path) -> Iterator[Any]:
    with open_las(path) as file:
        yield from file.chunk_iterator(LAS_CHUNK)


def _of_classes(chunk: Any, wanted: tuple[int, ...]) -> Float[np.ndarray, "n 3"]:
    chosen = np.isin(np.asarray(chunk.classification), wanted)
    points: Float[np.ndarray, "n 3"] = np.stack([np.asarray(chunk[axis])[chosen] for axis in "xyz"], axis=1)
    return points


def _listed(codes: Any) -> str:
    return ", ".join(str(code) for code in sorted(codes)) or "none"


def _read_geojson(path: Path, step_m: float) -> tuple[Float[np.ndarray, "n 3"], str]:
    points, lines = read_geojson(path)
    for vertices in lines:
        _check_finite(vertices, path)
    found = np.concatenate([points, sample_lines(lines, step_m)])
    return found, f"{len(points)} points and {len(lines)} lines, sampled"


def _check_finite(points: Float[np.ndarray, "n 3"], path: Path) -> None:
    bad = ~np.isfinite(points).all(1)
    if bad.any():
        raise SurveyError(
            f"{path}: {int(bad.sum())} of its {len(points)} points hold NaN or infinity, the first of them "
            f"number {int(bad.argmax())}, counted from 0. Take them out of the file."
        )


def _columns(table: Shaped[np.ndarray, " n"], path: Path) -> Float[np.ndarray, "n 3"]:
    """x, y and z of a structured array."""
    names = {name.lower(): name for name in table.dtype.names or ()}
    absent = [axis for axis in "xyz" if axis not in names]
    if absent:
        raise SurveyError(
            f"{path}: its points have {', '.join(names.values()) or 'no properties'}, but no "
            f"{' and no '.join(absent)}. Points need x, y and z."
        )
    points: Float[np.ndarray, "n 3"] = np.stack([table[names[axis]] for axis in "xyz"], axis=1).astype(
        np.float64
    )
    return points


def _rows(array: Shaped[np.ndarray, "..."], path: Path, what: str) -> Float[np.ndarray, "n 3"]:
    if array.dtype.names is not None and array.ndim == 1:
        return _columns(array, path)
    if array.ndim != 2 or array.shape[1] < 3 or array.dtype.kind not in "fiu":
        raise SurveyError(
            f"{path}: {what} is of type {array.dtype} and shape {array.shape}, but points are numbers of "
            "shape (n, 3): x, y and z. Write it again."
        )
    return array[:, :3].astype(np.float64)


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
