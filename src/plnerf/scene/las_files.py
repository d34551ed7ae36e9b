"""Opens LAS and LAZ files once it is known that they hold what their headers state.

laspy and lazrs take counts and offsets as true: a damaged table of chunks makes lazrs ask for more memory
than there is, which ends the process without an error that Python could catch.  Places are those of the LAS
1.4 specification and of LASzip.
"""

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

import laspy
import lazrs

from plnerf.errors import SurveyError

_VLR, _EVLR = 54, 60
"""Bytes of the heads of (extended) variable length records."""
_COUNTS, _EXTENDED = struct.Struct("<HII"), struct.Struct("<QI")
_TABLE = struct.Struct("<II")
_MAX_CHUNK = 1_000_000
"""Points of a chunk in a file that has fewer: memory is taken for as many.  LASzip's chunks have 50,000."""
_LAYERS, _BYTES_14 = {10: 9, 11: 1, 12: 2, 13: 1}, 14
"""Of LASzip's items by kind: points, colours, colours with infrared, waves.  Each further byte is one."""


class _Damaged(Exception):
    """What is wrong with a file."""


@contextmanager
def open_las(path: Path) -> Iterator[laspy.LasReader]:
    """A reader of the points of a LAS or LAZ file.

    Raises SurveyError where the file states more than it holds, and for whatever fails inside the block.
    """
    try:
        with path.open("rb") as file:
            _check_header(file, path.stat().st_size)
        with laspy.open(path) as reader:
            with path.open("rb") as file:
                _check_points(file, reader.header, path.stat().st_size)
            yield reader
    except (_Damaged, OSError, ValueError, EOFError, laspy.LaspyException, lazrs.LazrsError) as error:
        raise _unreadable(path, str(error)) from error
    except (MemoryError, OverflowError) as error:
        raise _unreadable(path, "it asks for more memory than there is") from error
    except (struct.error, IndexError, KeyError, TypeError, AssertionError) as error:
        raise _unreadable(path, f"its header is damaged: {error}") from error
    except BaseException as error:
        # What Rust calls a panic; its class cannot be imported, and is no Exception.
        if type(error).__module__ != "pyo3_runtime":
            raise
        raise _unreadable(path, f"its points are damaged: {error}") from error


def _unreadable(path: Path, why: str) -> SurveyError:
    return SurveyError(
        f"{path} cannot be read as LAS or LAZ ({why.rstrip('.')}). Is it cut off? Copy it again."
    )


def _check_header(file: IO[bytes], size: int) -> None:
    """Checks the counts that laspy goes by before it has read them all."""
    head = file.read(375)
    if len(head) < 227 or head[:4] != b"LASF":
        raise _Damaged("it does not begin with the header of a LAS file")
    length, points_at, records = _COUNTS.unpack_from(head, 94)
    if not length <= points_at <= size or records * _VLR > points_at - length:
        raise _Damaged(
            f"its header states {records} records before byte {points_at}, in a file of {size} bytes"
        )
    if head[25] >= 4 and len(head) >= 247:
        first, records = _EXTENDED.unpack_from(head, 235)
        if records and (first > size or records * _EVLR > size - first):
            raise _Damaged(
                f"its header states {records} records behind byte {first}, in a file of {size} bytes"
            )


def _check_points(file: IO[bytes], header: laspy.LasHeader, size: int) -> None:
    """Checks that the points fit into the file, or the table of chunks to chunks and points."""
    first, count, each = header.offset_to_point_data, header.point_count, header.point_format.size
    if not header.are_points_compressed:
        if count * each > size - first:
            raise _Damaged(f"it states {count:,} points, but holds {(size - first) // each:,}")
        return
    records = header.vlrs.get("LasZipVlr")
    if not records:
        raise _Damaged("it does not state how its points are compressed")
    packing = bytes(records[0].record_data)
    compression = lazrs.LazVlr(packing)
    if compression.item_size() != each:
        raise _Damaged(f"its points have {each} bytes, and {compression.item_size()} where they are packed")
    if count:
        lengths = _check_chunks(file, compression, first, count, size)
        if layers := _layers(packing):
            _check_layers(file, first + 8, lengths, each, layers)


def _check_chunks(
    file: IO[bytes], compression: lazrs.LazVlr, first: int, count: int, size: int
) -> list[int]:
    """Checks the table of chunks; returns how many bytes each chunk has."""
    table = _number(file, first, size)
    if table == -1:  # written by a program that could not go back in the file
        table = _number(file, size - 8, size)
    room = table - first - 8
    if room < 0 or table + _TABLE.size > size:
        raise _Damaged(f"its table of chunks is at byte {table}, outside of the file's {size} bytes")
    file.seek(table)
    _, chunks = _TABLE.unpack(file.read(_TABLE.size))
    if chunks * compression.item_size() > room:  # each begins with a point as it is
        raise _Damaged(f"it states {chunks:,} chunks in {room:,} bytes")
    file.seek(table)
    listed = lazrs.read_chunk_table_only(file, compression)
    packed = sum(length for _, length in listed)
    if compression.uses_variable_size_chunks():
        sizes = [number for number, _ in listed]
    else:
        sizes = [compression.chunk_size()] * len(listed)
    if max(sizes, default=0) > max(count, _MAX_CHUNK):
        raise _Damaged(f"it states chunks of {max(sizes):,} points, of {count:,} in all")
    if packed > room or sum(sizes) < count:
        raise _Damaged(f"its chunks state {packed:,} bytes of {room:,}, for {count:,} points")
    return [length for _, length in listed]


def _layers(packing: bytes) -> int:
    """How many layers a chunk has: those of its items; 0 where chunks are not layered."""
    (items,) = struct.unpack_from("<H", packing, 32)
    kinds = struct.iter_unpack("<HHH", packing[34 : 34 + 6 * items])
    return sum(size if kind == _BYTES_14 else _LAYERS.get(kind, 0) for kind, size, _ in kinds)


def _check_layers(file: IO[bytes], at: int, lengths: list[int], each: int, layers: int) -> None:
    """Checks the layers' lengths, which stand before them: a first point, a count, and a length for each."""
    for number, length in enumerate(lengths):
        file.seek(at + each + 4)
        stated = struct.unpack(f"<{layers}I", file.read(4 * layers))
        if each + 4 + 4 * layers + sum(stated) > length:
            raise _Damaged(f"the layers of chunk {number} state {sum(stated):,} bytes of its {length:,}")
        at += length


def _number(file: IO[bytes], at: int, size: int) -> int:
    if not 0 <= at <= size - 8:
        raise _Damaged("it ends before its points")
    file.seek(at)
    return int.from_bytes(file.read(8), "little", signed=True)
