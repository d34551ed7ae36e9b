"""NumPy's and PLY's headers are believed only as far as the file goes."""

import io
import zipfile
from pathlib import Path

import numpy as np
import pytest

from plnerf.errors import SurveyError
from plnerf.scene.npy_files import read_npy, read_npz
from plnerf.scene.ply import read_ply

POINTS = np.arange(12.0).reshape(4, 3)
HEADERS = {
    "a shape of terabytes": ("{'descr': '<f8', 'fortran_order': False, 'shape': (10**12, 3)}", "no NumPy"),
    "a shape of more than there is": ("{'descr': '<f8', 'fortran_order': False, 'shape': (5, 3)}", "shape"),
    "a shape of 10^40": (
        f"{{'descr': '<f8', 'fortran_order': False, 'shape': ({10**40},)}}", "its header states the shape"
    ),
    "a negative shape": ("{'descr': '<f8', 'fortran_order': False, 'shape': (-4, 3)}", "no NumPy"),
    "objects": ("{'descr': '|O', 'fortran_order': False, 'shape': (4, 3)}", "of the kind object"),
    "texts": ("{'descr': '<U8', 'fortran_order': False, 'shape': (3,)}", "of the kind <U8"),
    "no kind at all": ("{'descr': 'x', 'fortran_order': False, 'shape': (3,)}", "no NumPy"),
    "deep nesting": ("(" * 5000, "no NumPy"),
    "a list": ("[]", "no NumPy"),
}  # fmt: skip


def npy(header: str) -> bytes:
    text = (header + "\n").encode()
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text + POINTS.tobytes()


@pytest.mark.parametrize("name", HEADERS)
def test_a_header_that_states_something_else_is_refused(name: str, tmp_path: Path) -> None:
    header, text = HEADERS[name]
    (tmp_path / "a.npy").write_bytes(npy(header))
    with pytest.raises(SurveyError, match=rf"a\.npy is no NumPy array of numbers.*{text}|{text}"):
        read_npy(tmp_path / "a.npy")
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        archive.writestr("points.npy", npy(header))
    with pytest.raises(SurveyError, match=r"a\.npz is no NumPy archive of numbers"):
        read_npz(tmp_path / "a.npz", "points")


@pytest.mark.parametrize("order", ["C", "F"])
def test_arrays_are_read_as_numpy_reads_them(order: str, tmp_path: Path) -> None:
    array = np.asarray(POINTS, np.float32, order=order)  # type: ignore[call-overload]
    np.save(tmp_path / "a.npy", array)
    np.savez_compressed(tmp_path / "a.npz", points=array, other=array[:1])
    assert (read_npy(tmp_path / "a.npy") == array).all()
    name, read = read_npz(tmp_path / "a.npz", "points")
    assert name == "points" and (read == array).all() and read.dtype == np.float32


def test_an_archive_that_states_more_than_it_unpacks_is_refused(tmp_path: Path) -> None:
    """Also one of zeros, which would unpack to a thousand times its size."""
    whole = io.BytesIO()
    np.savez_compressed(whole, points=np.zeros((100_000, 3)))
    data = bytearray(whole.getvalue())
    (tmp_path / "cut.npz").write_bytes(data[: len(data) // 2])
    (tmp_path / "text.npz").write_bytes(b"not an archive")
    data[60:90] = bytes(30)
    (tmp_path / "damaged.npz").write_bytes(data)
    for name in ("cut", "text", "damaged"):
        with pytest.raises(SurveyError, match=rf"{name}\.npz is no NumPy archive of numbers"):
            read_npz(tmp_path / f"{name}.npz", "points")


@pytest.mark.parametrize("order", ["ascii", "binary_little_endian"])
@pytest.mark.parametrize("count", [10**12, 10**15, "9" * 40, 5])
def test_a_ply_of_more_than_it_holds_is_refused(order: str, count: object, tmp_path: Path) -> None:
    rows = "".join("1 2 3\n" for _ in range(4)).encode() if order == "ascii" else bytes(4 * 12)
    properties = "".join(f"property float {axis}\n" for axis in "xyz")
    header = f"ply\nformat {order} 1.0\nelement vertex {count}\n{properties}end_header\n"
    (tmp_path / "a.ply").write_bytes(header.encode() + rows)
    with pytest.raises(SurveyError, match=r"is cut off: its header promises|which PLY does not know"):
        read_ply(tmp_path / "a.ply")


def test_a_ply_with_a_property_twice_or_none_is_refused(tmp_path: Path) -> None:
    for properties, text in (
        ("property float x\nproperty float x\n", "has the property 'x' of element 'vertex' twice"),
        ("", "holds no points|no element 'vertex'|none"),
    ):
        header = f"ply\nformat ascii 1.0\nelement vertex 1000000000000\n{properties}end_header\n1 2\n"
        (tmp_path / "a.ply").write_text(header)
        if properties:
            with pytest.raises(SurveyError, match=text):
                read_ply(tmp_path / "a.ply")
        else:
            assert len(read_ply(tmp_path / "a.ply")["vertex"]) == 0
