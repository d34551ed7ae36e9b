"""NumPy's files of arrays, read once it is known that they hold what their headers state.

`numpy.load` takes memory for the shape that a header states before it reads a number, and an archive may hold
a thousand times its own size of zeros.
"""

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Shaped

from plnerf.errors import SurveyError

MAX_BYTES = 4 << 30
"""Of an array: more is no set of points on wires."""


class _Damaged(Exception):
    """What is wrong with a file."""


def read_npy(path: Path) -> Shaped[np.ndarray, "..."]:
    """The array of a .npy file, of numbers.  Raises SurveyError where it is none, or is not as stated."""
    try:
        with path.open("rb") as file:
            return _read(file, path.stat().st_size)
    except Exception as error:  # NumPy evaluates the header as Python's literals, which can raise anything
        raise SurveyError(f"{path} is no NumPy array of numbers ({error}). Write it again.") from error


def read_npz(path: Path, name: str) -> tuple[str, Shaped[np.ndarray, "..."]]:
    """An array of a .npz file, and its name: the only one, or the one of that name.

    Raises SurveyError where there is none, or an array is not what it states.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            members = {one.filename.removesuffix(".npy"): one for one in archive.infolist()}
            wanted = next(iter(members)) if len(members) == 1 else name
            if wanted in members:
                with archive.open(members[wanted]) as file:
                    return wanted, _read(file, members[wanted].file_size)
    except Exception as error:  # as above, and those of zipfile and of its decompressors
        raise SurveyError(f"{path} is no NumPy archive of numbers ({error}). Write it again.") from error
    raise SurveyError(
        f"{path} holds the arrays {', '.join(members)}, of which none is named {name!r}. Name it so, or "
        "store it alone."
    )


def _read(file: Any, size: int) -> Shaped[np.ndarray, "..."]:
    """An array out of an open file of so many bytes: one on disk, or one of an archive."""
    version = np.lib.format.read_magic(file)
    readers = {
        (1, 0): np.lib.format.read_array_header_1_0,
        (2, 0): np.lib.format.read_array_header_2_0,
    }
    if version not in readers:
        raise _Damaged(f"it is of the format version {version}, which is not read")
    shape, fortran_order, dtype = readers[version](file)
    if dtype.hasobject or dtype.kind not in "iufb":
        raise _Damaged(f"its values are of the kind {dtype}")
    count = 1
    for side in shape:
        count *= side
    if min(shape, default=0) < 0 or count * dtype.itemsize > min(size - file.tell(), MAX_BYTES):
        raise _Damaged(f"its header states the shape {shape}, for which its {size:,} bytes do not do")
    data = file.read(count * dtype.itemsize)
    if len(data) < count * dtype.itemsize:
        raise _Damaged("it is cut off")
    return np.frombuffer(data, dtype).reshape(shape, order="F" if fortran_order else "C")
