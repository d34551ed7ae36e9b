"""Checks that the files of a COLMAP model are whole, before COLMAP reads them.

Its readers take every count in a file as true, and read on behind the file's end: one that was cut off hangs
them, asks for all memory, or gives cameras and poses of zeros.  Binary files are walked record by record; of
text files the lines are counted where a comment states how many there are.  The layouts are COLMAP's, those
of rigs and frames from version 3.12 on.
"""

import re
import struct
from collections.abc import Callable
from functools import cache
from pathlib import Path

from plnerf.errors import SceneError
from plnerf.scene.colmap import pycolmap

_MAX_NAME = 4096
"""Bytes of an image's name: no path is longer."""
_RIGID = 7 * 8  # a quaternion and a translation
_STATED = re.compile(r"^# Number of \w+: (\d+)", re.MULTILINE)
_LINES_EACH = {"images": 2}
"""Lines of a text file for each of what it counts, where it is not one."""


class _Damaged(Exception):
    """What is wrong with a file."""


class _Records:
    """Reads a binary file from its beginning, and never behind its end."""

    def __init__(self, data: bytes) -> None:
        self._data, self._at = data, 0

    def read(self, layout: struct.Struct) -> tuple[int, ...]:
        """Values at the present place, which moves behind them."""
        at = self._at
        self.skip(layout.size)
        return layout.unpack_from(self._data, at)

    def skip(self, size: int) -> None:
        """Moves the present place."""
        if size > len(self._data) - self._at:
            raise _Damaged(f"it ends at byte {len(self._data)}, within a record")
        self._at += size

    def count(self, least: int) -> int:
        """A count, of records of so many bytes at least."""
        (count,) = self.read(_COUNT)
        if count > (len(self._data) - self._at) // least:
            raise _Damaged(f"it states {count} records, for which it is too short")
        return count

    def name(self) -> None:
        """Moves behind a text that ends with a zero."""
        end = self._data.find(b"\0", self._at, self._at + _MAX_NAME)
        if end < 0:
            raise _Damaged("the name of an image does not end")
        _as_text(self._data[self._at : end])
        self._at = end + 1

    def finish(self) -> None:
        """Checks that nothing follows."""
        if self._at < len(self._data):
            raise _Damaged(f"{len(self._data) - self._at} bytes follow its last record")


_COUNT = struct.Struct("<Q")
_CAMERA = struct.Struct("<IiQQ")
_SENSORS = struct.Struct("<II")
_SENSOR = struct.Struct("<iI")
_FLAG = struct.Struct("<B")


def check_model(model: Path) -> None:
    """Raises SceneError where a file of the model is cut off, or states more than it holds."""
    kind = "bin" if (model / "cameras.bin").is_file() else "txt"
    for name, walk in _WALKS.items():
        path = model / f"{name}.{kind}"
        if not path.is_file():
            continue  # which ones there must be is the reader's to say
        try:
            if kind == "txt":
                _check_lines(path.read_bytes(), _LINES_EACH.get(name, 1))
            else:
                records = _Records(path.read_bytes())
                walk(records)
                records.finish()
        except (OSError, _Damaged) as error:
            raise SceneError(
                f"The file {path} of a COLMAP model is damaged: {error}. Copy the model again, or run the "
                "reconstruction again."
            ) from error


def _cameras(records: _Records) -> None:
    for _ in range(records.count(_CAMERA.size)):
        number, lens, _, _ = records.read(_CAMERA)
        size = _parameters(lens)
        if size is None:
            raise _Damaged(f"camera {number} has the lens model {lens}, which COLMAP does not know")
        records.skip(8 * size)


def _images(records: _Records) -> None:
    for _ in range(records.count(4 + _RIGID + 4 + 1 + 8)):
        records.skip(4 + _RIGID + 4)
        records.name()
        records.skip(24 * records.count(24))  # x, y, number of the point


def _points(records: _Records) -> None:
    for _ in range(records.count(8 + 24 + 3 + 8 + 8)):
        records.skip(8 + 24 + 3 + 8)
        records.skip(8 * records.count(8))  # image, number of its feature


def _rigs(records: _Records) -> None:
    for _ in range(records.count(_SENSORS.size)):
        _, sensors = records.read(_SENSORS)
        if sensors:
            records.skip(_SENSOR.size)
        for _ in range(1, sensors):
            records.skip(_SENSOR.size)
            (posed,) = records.read(_FLAG)
            records.skip(_RIGID if posed else 0)


def _frames(records: _Records) -> None:
    for _ in range(records.count(4 + 4 + _RIGID + 4)):
        records.skip(4 + 4 + _RIGID)
        (count,) = records.read(_NUMBER)
        records.skip(count * (_SENSOR.size + 8))


_NUMBER = struct.Struct("<I")
_WALKS: dict[str, Callable[[_Records], None]] = {
    "cameras": _cameras, "rigs": _rigs, "frames": _frames, "images": _images, "points3D": _points,
}  # fmt: skip


@cache
def _parameters(lens: int) -> int | None:
    """How many numbers a lens model has; None for none of COLMAP's."""
    try:
        camera = pycolmap.Camera.create_from_model_id(1, pycolmap.CameraModelId(lens), 1.0, 1, 1)
    except ValueError:
        return None
    return len(camera.params)


def _check_lines(data: bytes, each: int) -> None:
    text = _as_text(data)
    if (stated := _STATED.search(text)) is None:
        return
    # Of an image without a point the second line is empty, and the last one may lack its end.
    lines = [line for line in text.removesuffix("\n").split("\n") if not line.startswith("#")]
    wanted = each * int(stated[1][:18])
    there = len(lines) if each > 1 else sum(bool(line.strip()) for line in lines)
    if there < wanted - (each - 1):
        raise _Damaged(f"it states {stated[1]} records, but has {there // each}")


def _as_text(data: bytes) -> str:
    try:
        return data.decode()
    except UnicodeDecodeError as error:
        raise _Damaged(f"it holds {data[error.start : error.start + 8]!r}, which is not UTF-8") from error
