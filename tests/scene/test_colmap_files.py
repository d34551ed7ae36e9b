"""COLMAP models that are cut off, or state what no camera has, are refused before COLMAP reads them."""

import struct
from pathlib import Path

import pytest

from plnerf.errors import SceneError
from plnerf.scene.colmap_files import check_model
from plnerf.scene.formats import read_listing
from plnerf.scene.formats_colmap import read_colmap, write_colmap

FILES = ["cameras", "images", "points3D", "rigs", "frames"]
FOCAL = 8 + 24  # place of the first parameter of the first camera
BINARY = struct.Struct("<d")


@pytest.fixture
def scene(tiny_scene: Path) -> Path:
    """The tiny scene as a binary COLMAP model, with two points."""
    write_colmap(read_listing(tiny_scene), tiny_scene / "sparse/0")
    points = [struct.pack("<Q3d3BdQ", i, 0.0, 0.0, 0.5, 200, 60, 40, 0.5, 0) for i in (1, 2)]
    (tiny_scene / "sparse/0/points3D.bin").write_bytes(struct.pack("<Q", 2) + b"".join(points))
    return tiny_scene


@pytest.mark.parametrize("name", FILES)
def test_a_file_that_is_cut_off_anywhere_is_refused(name: str, scene: Path) -> None:
    path = scene / "sparse/0" / f"{name}.bin"
    whole = path.read_bytes()
    check_model(path.parent)
    for end in {0, 4, 8, 9, len(whole) // 3, len(whole) // 2, len(whole) - 1} - {len(whole)}:
        path.write_bytes(whole[:end])
        with pytest.raises(SceneError, match=rf"{name}\.bin of a COLMAP model is damaged"):
            check_model(path.parent)
    path.write_bytes(whole + b"\0")
    with pytest.raises(SceneError, match="1 bytes follow its last record"):
        check_model(path.parent)


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("count", [2**63, 10**12, 10**7])
def test_an_absurd_count_is_refused(name: str, count: int, scene: Path) -> None:
    path = scene / "sparse/0" / f"{name}.bin"
    path.write_bytes(struct.pack("<Q", count) + path.read_bytes()[8:])
    with pytest.raises(SceneError, match=f"states {count} records, for which it is too short"):
        check_model(path.parent)


def test_counts_within_records_and_names_are_checked(scene: Path) -> None:
    path = scene / "sparse/0/images.bin"
    whole = path.read_bytes()
    name = whole.index(b"0000.png")
    path.write_bytes(whole[: name + 9] + struct.pack("<Q", 10**12) + whole[name + 17 :])
    with pytest.raises(SceneError, match="states 1000000000000 records"):
        read_colmap(scene)
    path.write_bytes(whole[:name] + b"\xff\xfe" + whole[name + 2 :])
    with pytest.raises(SceneError, match="which is not UTF-8"):
        read_colmap(scene)
    for outside in (b"/etc.png", b"../0.png"):
        path.write_bytes(whole[:name] + outside + whole[name + 8 :])
        with pytest.raises(SceneError, match=rf"names the image {outside.decode()}, outside of"):
            read_colmap(scene)
    path.write_bytes(whole[:name] + b"9" * 300 + whole[name + 8 :])
    with pytest.raises(SceneError, match="lists are not there"):
        read_colmap(scene)
    cameras = scene / "sparse/0/cameras.bin"
    cameras.write_bytes(cameras.read_bytes()[:12] + struct.pack("<i", 99) + cameras.read_bytes()[16:])
    with pytest.raises(SceneError, match="the lens model 99, which COLMAP does not know"):
        read_colmap(scene)


@pytest.mark.parametrize("focal", [0.0, -5.0, float("nan"), float("inf"), 1e300])
def test_an_absurd_lens_is_refused(focal: float, scene: Path) -> None:
    path = scene / "sparse/0/cameras.bin"
    whole = path.read_bytes()
    path.write_bytes(whole[:FOCAL] + BINARY.pack(focal) + whole[FOCAL + 8 :])
    with pytest.raises(SceneError, match=r"must be positive|no camera has"):
        read_colmap(scene)


def test_an_absurd_size_and_position_are_refused(scene: Path) -> None:
    path = scene / "sparse/0/cameras.bin"
    whole = path.read_bytes()
    path.write_bytes(whole[:16] + struct.pack("<QQ", 2**40, 2**40) + whole[32:])
    with pytest.raises(SceneError, match=r"no camera has .* in images of 1\.09951e\+12 x 1\.09951e\+12 px"):
        read_colmap(scene)
    path.write_bytes(whole)
    frames = scene / "sparse/0/frames.bin"
    data = frames.read_bytes()
    frames.write_bytes(data[: 16 + 32] + BINARY.pack(1e300) + data[16 + 40 :])
    with pytest.raises(SceneError, match="the camera-to-world matrix puts the camera 1e"):
        read_colmap(scene)


@pytest.mark.parametrize("name", ["cameras", "images", "frames"])
def test_a_text_file_with_fewer_lines_than_it_states_is_refused(name: str, tiny_scene: Path) -> None:
    write_colmap(read_listing(tiny_scene), tiny_scene / "sparse/0", text=True)
    path = tiny_scene / "sparse/0" / f"{name}.txt"
    check_model(path.parent)
    lines = path.read_text().splitlines(keepends=True)
    path.write_text("".join(lines[: -2 if name == "images" else -1]))
    with pytest.raises(SceneError, match=r"it states \d+ records, but has \d+"):
        check_model(path.parent)
