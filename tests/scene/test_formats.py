"""What the readers make of transforms.json and of COLMAP models."""

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap
import pytest
from PIL import Image

from plnerf.errors import SceneError
from plnerf.scene.formats import read_listing
from plnerf.scene.formats_colmap import find_model, read_colmap, write_colmap
from plnerf.scene.listing import Listing
from plnerf.scene.transforms import flip_camera_axes


def edit(scene: Path, change: Callable[[dict[str, Any]], object]) -> None:
    data = json.loads((scene / "transforms.json").read_text())
    change(data)
    (scene / "transforms.json").write_text(json.dumps(data))


def assert_same(one: Listing, two: Listing) -> None:
    assert [s.name for s in one.shots] == [s.name for s in two.shots]
    for a, b in zip(one.shots, two.shots, strict=True):
        np.testing.assert_allclose(a.T_world_camera, b.T_world_camera, atol=1e-12)
        for key in ("width", "height", "fl_x", "fl_y", "cx", "cy", "distortion"):
            assert getattr(a.intrinsics, key) == pytest.approx(getattr(b.intrinsics, key), abs=1e-9), key


def test_shared_intrinsics_and_opengl_poses(tiny_scene: Path) -> None:
    listing = read_listing(tiny_scene)
    stated = json.loads((tiny_scene / "transforms.json").read_text())["frames"]
    assert listing.format == "nerfstudio" and listing.unit == "m" and len(listing.shots) == 12
    for shot, frame in zip(listing.shots, stated, strict=True):
        np.testing.assert_allclose(
            flip_camera_axes(shot.T_world_camera), np.array(frame["transform_matrix"]), atol=1e-12
        )
    assert read_listing(tiny_scene / "transforms.json").shots[3].name == "images/0003.png"


def test_frames_are_sorted_by_file_path_whatever_their_order(tiny_scene: Path) -> None:
    before = read_listing(tiny_scene)
    edit(tiny_scene, lambda data: data["frames"].reverse())
    assert_same(read_listing(tiny_scene), before)


def test_per_frame_intrinsics_say_the_same_as_shared_ones(tiny_scene: Path) -> None:
    before = read_listing(tiny_scene)

    def move(data: dict[str, Any]) -> None:
        for key in ("w", "h", "fl_x", "fl_y", "cx", "cy"):
            value = data.pop(key)
            for frame in data["frames"]:
                frame[key] = value

    edit(tiny_scene, move)
    assert_same(read_listing(tiny_scene), before)


def test_blender_files_have_no_extension_no_size_and_one_angle(tiny_scene: Path) -> None:
    before = read_listing(tiny_scene)

    def blender(data: dict[str, Any]) -> None:
        for key in ("w", "h", "fl_x", "fl_y", "cx", "cy"):
            del data[key]
        data["camera_angle_x"] = 2 * math.atan(0.5 * 48 / 40.0)
        for frame in data["frames"]:
            frame["file_path"] = "./" + frame["file_path"].removesuffix(".png")

    edit(tiny_scene, blender)
    assert_same(read_listing(tiny_scene), before)


def test_both_angles_give_both_focal_lengths(tiny_scene: Path) -> None:
    def angles(data: dict[str, Any]) -> None:
        del data["fl_x"], data["fl_y"]
        data["camera_angle_x"], data["camera_angle_y"] = math.pi / 2, math.pi / 3

    edit(tiny_scene, angles)
    lens = read_listing(tiny_scene).shots[0].intrinsics
    assert lens.fl_x == pytest.approx(24.0) and lens.fl_y == pytest.approx(16.0 * math.sqrt(3))


def test_distortion_is_read_in_opencvs_order(tiny_scene: Path) -> None:
    edit(tiny_scene, lambda data: data.update(k1=0.1, k2=0.2, p1=0.3, p2=0.4, k3=0.5, k4=0.0))
    assert read_listing(tiny_scene).shots[0].intrinsics.distortion == (0.1, 0.2, 0.3, 0.4, 0.5)


@pytest.mark.parametrize("change", [{"k4": 0.1}, {"camera_model": "OPENCV_FISHEYE"}, {"is_fisheye": True}])
def test_lenses_that_are_no_pinholes_are_refused(tiny_scene: Path, change: dict[str, object]) -> None:
    edit(tiny_scene, lambda data: data.update(change))
    with pytest.raises(SceneError, match="camera model"):
        read_listing(tiny_scene)


def test_masks_depths_truth_and_lists_are_found_and_unknown_keys_passed_over(tiny_scene: Path) -> None:
    for name in ("mask.png", "wire.png", "depth.png"):
        Image.new("L", (48, 32)).save(tiny_scene / name)
    (tiny_scene / "truth.json").write_text("{}")

    def extend(data: dict[str, Any]) -> None:
        data["frames"][2].update(mask_path="mask.png", wire_mask_path="wire.png", depth_path="depth.png")
        data["plnerf"].update(
            truth="truth.json",
            line_axis="what earlier versions wrote",
            crs="EPSG:25832",
            test=["images/0001.png", "./images/0005.png"],
        )

    edit(tiny_scene, extend)
    listing = read_listing(tiny_scene)
    shot = listing.shots[2]
    assert (shot.mask, shot.wire_mask, shot.depth) == tuple(
        tiny_scene / f"{n}.png" for n in ("mask", "wire", "depth")
    )
    assert listing.shots[1].mask is None and listing.truth == tiny_scene / "truth.json"
    assert listing.crs == "EPSG:25832" and listing.train is None
    assert listing.test == ("images/0001.png", "images/0005.png")


def test_nerfstudios_lists_come_before_plnerfs(tiny_scene: Path) -> None:
    def extend(data: dict[str, Any]) -> None:
        data["train_filenames"] = ["images/0000.png", "images/0001.png"]
        data["val_filenames"] = ["images/0002.png"]
        data["plnerf"]["test"] = ["images/0003.png"]

    edit(tiny_scene, extend)
    listing = read_listing(tiny_scene)
    assert listing.train == ("images/0000.png", "images/0001.png") and listing.test == ("images/0002.png",)


def test_absent_images_of_instant_ngp_are_left_out_and_named(tiny_scene: Path) -> None:
    edit(tiny_scene, lambda data: data.update(aabb_scale=4))
    for i in (3, 7):
        (tiny_scene / f"images/{i:04d}.png").unlink()
    listing = read_listing(tiny_scene)
    assert listing.format == "instant-ngp" and len(listing.shots) == 10
    assert listing.left_out == ("images/0003.png", "images/0007.png")


def test_images_outside_the_folder_keep_their_whole_path(tiny_scene: Path, tmp_path: Path) -> None:
    (tiny_scene / "images/0000.png").rename(tmp_path / "far.png")
    edit(tiny_scene, lambda data: data["frames"][0].update(file_path=str(tmp_path / "far.png")))
    assert read_listing(tiny_scene).shots[0].name == (tmp_path / "far.png").as_posix()


@pytest.mark.parametrize("text", [False, True])
@pytest.mark.parametrize("distortion", [{}, {"k1": 0.05, "k2": -0.02, "p1": 0.001, "p2": -0.002}])
def test_a_colmap_model_is_the_same_scene(tiny_scene: Path, text: bool, distortion: dict[str, float]) -> None:
    edit(tiny_scene, lambda data: data.update(distortion))
    before = read_listing(tiny_scene)
    write_colmap(before, tiny_scene / "sparse/0", text=text)
    (tiny_scene / "transforms.json").unlink()
    after = read_listing(tiny_scene)
    assert after.format == "colmap" and after.root == tiny_scene and after.unit == "unscaled"
    assert_same(after, before)


@pytest.mark.parametrize("place", ["sparse/0", "sparse", ".", "colmap/sparse/0"])
def test_models_are_found_where_programs_put_them(tiny_scene: Path, place: str) -> None:
    before = read_listing(tiny_scene)
    write_colmap(before, tiny_scene / place)
    assert find_model(tiny_scene) == (tiny_scene / place if place != "." else tiny_scene)
    assert_same(read_colmap(tiny_scene), before)
    if place in {"sparse/0", "sparse"}:
        assert_same(read_listing(tiny_scene / place), before)


def test_models_without_rigs_and_frames_are_read(tiny_scene: Path) -> None:
    """Models of COLMAP before version 3.12 have three files."""
    before = read_listing(tiny_scene)
    write_colmap(before, tiny_scene / "sparse/0")
    for name in ("rigs.bin", "frames.bin"):
        (tiny_scene / "sparse/0" / name).unlink()
    assert_same(read_colmap(tiny_scene), before)


MODELS = {
    "SIMPLE_PINHOLE": ([40, 24, 16], (40, 40, 24, 16), (0, 0, 0, 0)),
    "PINHOLE": ([40, 41, 24, 16], (40, 41, 24, 16), (0, 0, 0, 0)),
    "SIMPLE_RADIAL": ([40, 24, 16, 0.1], (40, 40, 24, 16), (0.1, 0, 0, 0)),
    "RADIAL": ([40, 24, 16, 0.1, 0.2], (40, 40, 24, 16), (0.1, 0.2, 0, 0)),
    "OPENCV": ([40, 41, 24, 16, 0.1, 0.2, 0.3, 0.4], (40, 41, 24, 16), (0.1, 0.2, 0.3, 0.4)),
}


def model_with_camera(scene: Path, name: str, params: list[float]) -> None:
    write_colmap(read_listing(scene), scene / "sparse/0")
    model = pycolmap.Reconstruction(scene / "sparse/0")
    model.cameras[1].model = pycolmap.CameraModelId.__members__[name]
    model.cameras[1].params = params
    model.write(scene / "sparse/0")


@pytest.mark.parametrize("name", MODELS)
def test_camera_models_of_colmap(tiny_scene: Path, name: str) -> None:
    params, focal, distortion = MODELS[name]
    model_with_camera(tiny_scene, name, params)
    lens = read_colmap(tiny_scene).shots[0].intrinsics
    assert (lens.fl_x, lens.fl_y, lens.cx, lens.cy) == focal and lens.distortion == (*distortion, 0.0)


def test_broken_colmap_models_are_refused_without_a_traceback(tiny_scene: Path) -> None:
    listing = read_listing(tiny_scene)
    model = tiny_scene / "sparse/0"
    write_colmap(listing, model)
    whole = (model / "images.bin").read_bytes()
    (model / "images.bin").write_bytes(whole[:100])
    with pytest.raises(SceneError, match=r"cannot be read|is damaged"):
        read_colmap(tiny_scene)
    (model / "images.bin").unlink()
    with pytest.raises(SceneError, match=r"images\.bin is not there"):
        read_colmap(tiny_scene)


def test_k3_has_no_place_in_colmaps_model(tiny_scene: Path, tmp_path: Path) -> None:
    edit(tiny_scene, lambda data: data.update(k3=0.1))
    with pytest.raises(SceneError, match="k3"):
        write_colmap(read_listing(tiny_scene), tmp_path / "model")


@pytest.mark.parametrize(
    ("where", "change", "text"),
    [
        ("plnerf", {"crs": ["EPSG:4326"]}, r"crs must be a text, but is \['EPSG:4326'\]"),
        ("plnerf", {"up": ["0", "0", "1"]}, r"plnerf\.up must be three finite numbers"),
        ("plnerf", {"up": [[[0]]] * 3}, r"plnerf\.up must be three finite numbers"),
        ("", {"camera_model": ["OPENCV"]}, r"the camera model \(\['OPENCV'\]\) cannot be used"),
        ("", {"fl_x": 10**39}, r"no camera has fl_x"),
        ("frame", {"mask_path": ["m.png"]}, r"mask_path must be a text"),
        ("frame", {"mask_path": "m" * 5000}, r"mask_path names .* which is not there"),
        ("frame", {"file_path": "i" * 5000}, r"1 of the 12 images .* are not there"),
        ("frame", {"file_path": "images/\0.png"}, r"1 of the 12 images .* are not there"),
        ("frame", {"transform_matrix": [["1", "0", "0", "0"]] * 4}, r"transform_matrix must be 4 rows"),
        ("frame", {"transform_matrix": [[1, 0, 0, 1e300], *np.eye(4)[1:].tolist()]}, r"puts the camera 1e"),
    ],
)
def test_values_of_other_kinds_are_refused(
    tiny_scene: Path, where: str, change: dict[str, object], text: str
) -> None:
    def spoil(data: dict[str, Any]) -> None:
        {"": data, "plnerf": data["plnerf"], "frame": data["frames"][0]}[where].update(change)

    edit(tiny_scene, spoil)
    with pytest.raises(SceneError, match=text):
        read_listing(tiny_scene)
