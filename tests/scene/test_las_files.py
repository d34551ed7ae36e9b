"""LAS and LAZ files that state more than they hold are refused before lazrs takes memory for it."""

import struct
from collections.abc import Callable
from pathlib import Path

import laspy
import numpy as np
import pytest

from plnerf.errors import SurveyError
from plnerf.scene.las_files import open_las
from plnerf.survey.lidar.point_cloud import read_cloud

COUNT, CHUNK_SIZE = 500, 12  # of points; the place of the chunks' size in LASzip's record
Damage = Callable[[bytearray], object]


def write(path: Path, point_format: int = 7) -> bytearray:
    header = laspy.LasHeader(point_format=point_format, version="1.4" if point_format > 5 else "1.2")
    header.scales = [0.001] * 3
    las = laspy.LasData(header)
    las.xyz = np.random.default_rng(0).uniform(0, 50, (COUNT, 3))
    las.write(str(path))
    return bytearray(path.read_bytes())


def points_at(data: bytearray) -> int:
    return int(struct.unpack_from("<I", data, 96)[0])


def table_at(data: bytearray) -> int:
    return int(struct.unpack_from("<q", data, points_at(data))[0])


def packing_at(data: bytearray) -> int:
    """Where LASzip's record begins, behind its head."""
    return int(data.index(b"laszip encoded")) - 2 + 54


DAMAGES: dict[str, tuple[Damage, str]] = {
    "table behind the end": (
        lambda d: struct.pack_into("<q", d, points_at(d), 10**15), "its table of chunks is at byte 10000000"
    ),
    "table before the points": (
        lambda d: struct.pack_into("<q", d, points_at(d), 7), "its table of chunks is at byte 7, outside"
    ),
    "as many chunks as can be stated": (
        lambda d: struct.pack_into("<I", d, table_at(d) + 4, 2**32 - 1), "it states 4,294,967,295 chunks"
    ),
    "no chunk": (lambda d: struct.pack_into("<I", d, table_at(d) + 4, 0), "for 500 points"),
    "a chunk that is too long": (
        lambda d: d.__setitem__(slice(table_at(d) + 8, table_at(d) + 11), b"\xff\xff\xff"), "its chunks state"
    ),
    "chunks of too many points": (
        lambda d: struct.pack_into("<I", d, packing_at(d) + CHUNK_SIZE, 2**32 - 2), "4,294,967,294 points"
    ),
    "a layer that is too long": (
        lambda d: struct.pack_into("<I", d, points_at(d) + 8 + 36 + 4, 2**32 - 1), "the layers of chunk 0"
    ),
    "too many records": (lambda d: struct.pack_into("<I", d, 100, 2**32 - 1), "states 4294967295 records"),
    "too many records at the end": (
        lambda d: struct.pack_into("<QI", d, 235, 400, 2**32 - 1), "4294967295 records behind byte 400"
    ),
    "cut off": (lambda d: d.__delitem__(slice(-20, None)), "outside of the file"),
    "no record of the packing": (
        lambda d: d.__setitem__(slice(packing_at(d) - 52, packing_at(d) - 38), b"somebody else\0"),
        "it does not state how its points are compressed",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", DAMAGES)
def test_a_laz_file_that_states_more_than_it_holds_is_refused(name: str, tmp_path: Path) -> None:
    data = write(tmp_path / "line.laz")
    damage, text = DAMAGES[name]
    damage(data)
    (tmp_path / "line.laz").write_bytes(data)
    with pytest.raises(SurveyError, match=rf"line\.laz cannot be read as LAS or LAZ \(.*({text})"):
        read_cloud(tmp_path / "line.laz")


@pytest.mark.parametrize("point_format", [1, 3, 6, 7])
@pytest.mark.parametrize("suffix", ["las", "laz"])
def test_whole_files_pass(suffix: str, point_format: int, tmp_path: Path) -> None:
    write(tmp_path / f"line.{suffix}", point_format)
    with open_las(tmp_path / f"line.{suffix}") as reader:
        assert len(reader.read().points) == COUNT


def test_a_las_file_that_was_cut_off_is_refused(tmp_path: Path) -> None:
    data = write(tmp_path / "line.las")
    (tmp_path / "line.las").write_bytes(data[: -36 * 7])
    with pytest.raises(SurveyError, match="it states 500 points, but holds 493"):
        read_cloud(tmp_path / "line.las")


def test_a_panic_of_rust_is_an_error_and_an_interrupt_is_none(tmp_path: Path) -> None:
    write(tmp_path / "line.laz")
    panic = type("PanicException", (BaseException,), {"__module__": "pyo3_runtime"})
    with (
        pytest.raises(SurveyError, match="its points are damaged: capacity overflow"),
        open_las(tmp_path / "line.laz"),
    ):
        raise panic("capacity overflow")
    with pytest.raises(KeyboardInterrupt), open_las(tmp_path / "line.laz"):
        raise KeyboardInterrupt
