"""PLY files of points: what a survey needs of the format, and no more.

A small reader of its own: plyfile's licence (GPL) does not go with this project's, and trimesh would bring a
library of meshes for a header of text before an array that NumPy reads.  Read are ascii and binary files of
either byte order; of lists (the faces of a mesh) only that they come after the elements that are wanted.
"""

import io
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import numpy as np
from jaxtyping import Float, Shaped

from plnerf.errors import SurveyError
from plnerf.scene.files import complete_file

_TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4",
    "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4",
    "uint32": "u4", "float32": "f4", "float64": "f8",
}  # fmt: skip
_NAMES = {"i1": "char", "u1": "uchar", "i2": "short", "u2": "ushort", "i4": "int", "u4": "uint"} | {
    "f4": "float",
    "f8": "double",
}
MAX_DIGITS = 16
"""Of a count: no disk holds as many values."""
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}


@dataclass(frozen=True)
class _Element:
    name: str
    count: int
    fields: tuple[tuple[str, str], ...]
    """Names and NumPy types, without the byte order."""
    lists: bool


def read_ply(path: Path) -> dict[str, Shaped[np.ndarray, " n"]]:
    """The elements of a PLY file as structured arrays by name, up to the first that holds lists.

    Raises SurveyError where the file is no PLY, is cut off, or has lists before its vertices.
    """
    with path.open("rb") as file:
        order, elements = _header(file, path)
        found: dict[str, Shaped[np.ndarray, " n"]] = {}
        for element in elements:
            if element.lists:
                break
            dtype = np.dtype([(name, order + kind) for name, kind in element.fields])
            found[element.name] = _rows(file, element, dtype, path, text=not order)
    if "vertex" not in found:
        listed = ", ".join(element.name for element in elements) or "none"
        raise SurveyError(
            f"{path} has no element 'vertex' of plain numbers (its elements: {listed}), so it holds no "
            "points that can be read. Export it as a point cloud."
        )
    return found


def write_ply(
    path: Path,
    points: Float[np.ndarray, "n 3"],
    attributes: dict[str, Shaped[np.ndarray, " n"]] | None = None,
    comment: str = "",
) -> None:
    """A binary PLY of points in float64, each attribute in its own type (64-bit integers are not PLY's).

    comment: one line for readers, in its header.  Complete or absent; raises PlnerfError where it cannot be
    written.
    """
    columns = {"x": points[:, 0], "y": points[:, 1], "z": points[:, 2], **(attributes or {})}
    kinds = {name: column.dtype.str.lstrip("<>|=") for name, column in columns.items()}
    unknown = {name: str(columns[name].dtype) for name, kind in kinds.items() if kind not in _NAMES}
    if unknown:
        raise ValueError(f"PLY has no type for {unknown}: give them as one of {sorted(_NAMES)}")
    table = np.empty(len(points), np.dtype([(name, f"<{kind}") for name, kind in kinds.items()]))
    for name, column in columns.items():
        table[name] = column
    properties = [f"property {_NAMES[kind]} {name}" for name, kind in kinds.items()]
    said = [f"comment {' '.join(comment.split())}"] if comment else []
    header = ["ply", "format binary_little_endian 1.0", *said, f"element vertex {len(points)}", *properties]
    with complete_file(path) as beside, beside.open("wb") as file:
        file.write(("\n".join([*header, "end_header"]) + "\n").encode("ascii", "replace"))
        table.tofile(file)


def _header(file: IO[bytes], path: Path) -> tuple[str, list[_Element]]:
    """The byte order ("" for ascii) and the elements; the file is then at its first value."""
    if file.readline(100).strip() != b"ply":
        raise SurveyError(
            f"{path} does not begin with the line 'ply', so it is no PLY file. Is it of another program, or "
            "cut off? Write it again, or give it the suffix of what it is."
        )
    order: str | None = None
    elements: list[_Element] = []
    while True:
        line = file.readline(1000)
        words = line.decode("ascii", errors="replace").split()
        match words:
            case ["end_header"]:
                break
            case ["format", name, _] if name in _ORDERS:
                order = _ORDERS[name]
            case ["element", name, count] if count.isdecimal() and len(count) < MAX_DIGITS:
                elements.append(_Element(name, int(count), (), lists=False))
            case ["property", "list", _, _, _] if elements:
                last = elements.pop()
                elements.append(_Element(last.name, last.count, last.fields, lists=True))
            case ["property", kind, name] if elements and kind in _TYPES:
                last = elements.pop()
                if name in dict(last.fields):
                    raise SurveyError(
                        f"{path} has the property {name!r} of element {last.name!r} twice. Write it again."
                    )
                fields = (*last.fields, (name, _TYPES[kind]))
                elements.append(_Element(last.name, last.count, fields, last.lists))
            case ["comment" | "obj_info", *_]:
                continue
            case _:
                what = f"has the line {' '.join(words)!r} in its header" if line else "ends in its header"
                raise SurveyError(
                    f"{path} {what}, which PLY does not know. Write it again, binary or ascii, with "
                    "properties x, y, z."
                )
    if order is None:
        raise SurveyError(f"{path} does not say its format (ascii or binary) in its header. Write it again.")
    return order, elements


def _rows(
    file: IO[bytes], element: _Element, dtype: np.dtype[np.void], path: Path, *, text: bool
) -> Shaped[np.ndarray, " n"]:
    if not element.fields:
        return np.empty(0, dtype)  # so that no memory is taken for what has no values
    here = file.tell()
    left = file.seek(0, io.SEEK_END) - here
    file.seek(here)
    least = 2 * len(element.fields) if text else dtype.itemsize  # a digit and a space or line end each
    if element.count * least > left + 1:
        raise SurveyError(
            f"{path} is cut off: its header promises {element.count} of element {element.name!r}, but only "
            f"{left:,} bytes follow. Copy or write it again."
        )
    if not text:
        data = file.read(element.count * dtype.itemsize)
        rows: Shaped[np.ndarray, " n"] = np.frombuffer(
            data[: len(data) // dtype.itemsize * dtype.itemsize], dtype
        )
    else:
        lines = [line for _ in range(element.count) if (line := file.readline())]
        try:
            rows = np.loadtxt(io.BytesIO(b"".join(lines)), dtype, ndmin=1) if lines else np.empty(0, dtype)
        except ValueError as error:
            raise SurveyError(
                f"{path} cannot be read as ascii PLY: in element {element.name!r}, {error}. Write it again."
            ) from error
    if len(rows) != element.count:
        raise SurveyError(
            f"{path} is cut off: its header promises {element.count} of element {element.name!r}, but only "
            f"{len(rows)} are there. Copy or write it again."
        )
    return rows
