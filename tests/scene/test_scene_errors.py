"""Every scene a user can get wrong ends in one paragraph that says what is wrong and what to do.

The texts are stored in tests/snapshots/scene_*.txt; ``pytest --update-snapshots`` writes them anew.
"""

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from PIL import Image
from tests.conftest import SNAPSHOTS

from plnerf.errors import SceneError
from plnerf.scene.formats import read_listing
from plnerf.scene.formats_colmap import write_colmap
from plnerf.scene.scene import load_scene

Spoil = Callable[[Path], object]
CASES: dict[str, Spoil] = {}
DOWNSCALE = {"too_small": 4, "downscale_zero": 0}


def case(spoil: Spoil) -> Spoil:
    CASES[spoil.__name__] = spoil
    return spoil


def edit(scene: Path, change: Callable[[dict[str, Any]], object]) -> None:
    data = json.loads((scene / "transforms.json").read_text())
    change(data)
    (scene / "transforms.json").write_text(json.dumps(data))


def edit_pose(scene: Path, change: Callable[[np.ndarray], np.ndarray]) -> None:
    def apply(data: dict[str, Any]) -> None:
        pose = np.array(data["frames"][2]["transform_matrix"])
        data["frames"][2]["transform_matrix"] = change(pose).tolist()

    edit(scene, apply)


def resave(scene: Path, convert: Callable[[Image.Image], Image.Image], name: str = "0002.png") -> None:
    path = scene / "images" / name
    convert(Image.open(path)).save(path)


@case
def missing_images(scene: Path) -> None:
    for i in (2, 4, 6, 8):
        (scene / f"images/{i:04d}.png").unlink()


@case
def more_than_half_missing(scene: Path) -> None:
    edit(scene, lambda data: data.update(aabb_scale=2))
    for i in range(7):
        (scene / f"images/{i:04d}.png").unlink()


@case
def truncated_jpeg(scene: Path) -> None:
    noise = np.random.default_rng(0).integers(0, 255, (32, 48, 3), dtype=np.uint8)
    Image.fromarray(noise).save(scene / "images/0002.jpg", quality=95)
    whole = (scene / "images/0002.jpg").read_bytes()
    (scene / "images/0002.jpg").write_bytes(whole[: len(whole) // 2])
    edit(scene, lambda data: data["frames"][2].update(file_path="images/0002.jpg"))


@case
def not_an_image(scene: Path) -> None:
    (scene / "images/0002.png").write_text("<html>404</html>")


@case
def empty_image(scene: Path) -> None:
    (scene / "images/0002.png").write_bytes(b"")


@case
def unequal_sizes(scene: Path) -> None:
    resave(scene, lambda image: image.resize((40, 32)))


@case
def unequal_sizes_unstated(scene: Path) -> None:
    edit(scene, lambda data: (data.pop("w"), data.pop("h")))
    resave(scene, lambda image: image.resize((40, 32)))


@case
def all_of_another_size(scene: Path) -> None:
    edit(scene, lambda data: data.update(w=96, h=64))


@case
def turned_by_exif(scene: Path) -> None:
    exif = Image.Exif()
    exif[0x0112] = 6
    for path in (scene / "images").iterdir():
        Image.open(path).rotate(90, expand=True).save(path, exif=exif)


@case
def rgba(scene: Path) -> None:
    resave(scene, lambda image: image.convert("RGBA"))


@case
def grey(scene: Path) -> None:
    resave(scene, lambda image: image.convert("L"))


@case
def palette(scene: Path) -> None:
    resave(scene, lambda image: image.convert("P"))


@case
def sixteen_bit_grey(scene: Path) -> None:
    Image.fromarray(np.full((32, 48), 4000, dtype=np.uint16)).save(scene / "images/0002.png")


@case
def sixteen_bit_colour(scene: Path) -> None:
    cv2.imwrite(str(scene / "images/0002.png"), np.full((32, 48, 3), 4000, dtype=np.uint16))


@case
def singular_pose(scene: Path) -> None:
    edit_pose(scene, lambda pose: pose * np.array([1.0, 0.0, 1.0, 1.0]))


@case
def scaled_pose(scene: Path) -> None:
    edit_pose(scene, lambda pose: pose @ np.diag([1.5, 1.5, 1.5, 1.0]))


@case
def sheared_pose(scene: Path) -> None:
    edit_pose(scene, lambda pose: pose @ (np.eye(4) + 0.1 * np.eye(4, k=1) * [0, 1, 0, 0]))


@case
def mirrored_pose(scene: Path) -> None:
    edit_pose(scene, lambda pose: pose * np.array([-1.0, 1.0, 1.0, 1.0]))


@case
def transposed_pose(scene: Path) -> None:
    edit_pose(scene, lambda pose: pose.T.round(3))


@case
def nan_pose(scene: Path) -> None:
    edit_pose(scene, lambda pose: np.where(np.eye(4, k=3) > 0, np.nan, pose))


@case
def infinite_pose(scene: Path) -> None:
    edit_pose(scene, lambda pose: np.where(np.eye(4, k=3) > 0, np.inf, pose))


@case
def pose_of_wrong_shape(scene: Path) -> None:
    edit_pose(scene, lambda pose: pose[:, :3])


@case
def pose_of_words(scene: Path) -> None:
    edit(scene, lambda data: data["frames"][2].update(transform_matrix=[["a"] * 4] * 4))


@case
def no_pose(scene: Path) -> None:
    edit(scene, lambda data: data["frames"][2].pop("transform_matrix"))


@case
def duplicate_frame(scene: Path) -> None:
    edit(scene, lambda data: data["frames"][2].update(file_path="images/../images/0001.png"))


@case
def nothing_held_out(scene: Path) -> None:
    edit(scene, lambda data: data["plnerf"].update(test=[]))


@case
def nothing_to_train_on(scene: Path) -> None:
    edit(scene, lambda data: data["plnerf"].update(test=[f["file_path"] for f in data["frames"]]))


@case
def one_image(scene: Path) -> None:
    edit(scene, lambda data: data.update(frames=data["frames"][:1]))


@case
def held_out_twice(scene: Path) -> None:
    edit(
        scene,
        lambda data: data.update(train_filenames=["images/0000.png"], test_filenames=["images/0000.png"]),
    )


@case
def unknown_held_out(scene: Path) -> None:
    edit(scene, lambda data: data["plnerf"].update(test=["images/0099.png"]))


@case
def held_out_no_list(scene: Path) -> None:
    edit(scene, lambda data: data["plnerf"].update(test="images/0001.png"))


@case
def invalid_json(scene: Path) -> None:
    (scene / "transforms.json").write_text('{"w": 48,\n "frames": [}')


@case
def json_list(scene: Path) -> None:
    (scene / "transforms.json").write_text("[]")


@case
def not_text(scene: Path) -> None:
    (scene / "transforms.json").write_bytes(b"\xff\xfe\x00")


@case
def no_frames(scene: Path) -> None:
    edit(scene, lambda data: data.update(frames=[]))


@case
def frames_of_another_kind(scene: Path) -> None:
    edit(scene, lambda data: data.pop("frames"))


@case
def frame_without_path(scene: Path) -> None:
    edit(scene, lambda data: data["frames"][2].pop("file_path"))


@case
def missing_intrinsics(scene: Path) -> None:
    edit(scene, lambda data: (data.pop("fl_x"), data.pop("fl_y")))


@case
def focal_length_zero(scene: Path) -> None:
    edit(scene, lambda data: data.update(fl_x=0))


@case
def focal_length_of_words(scene: Path) -> None:
    edit(scene, lambda data: data.update(fl_x="35mm"))


@case
def fisheye(scene: Path) -> None:
    edit(scene, lambda data: data.update(camera_model="OPENCV_FISHEYE"))


@case
def fourth_radial_term(scene: Path) -> None:
    edit(scene, lambda data: data.update(k4=0.01))


@case
def mask_of_wrong_size(scene: Path) -> None:
    Image.new("L", (24, 16), 255).save(scene / "mask.png")
    edit(scene, lambda data: data["frames"][2].update(mask_path="mask.png"))


@case
def missing_mask(scene: Path) -> None:
    edit(scene, lambda data: data["frames"][2].update(mask_path="masks/0002.png"))


@case
def newer_format(scene: Path) -> None:
    edit(scene, lambda data: data["plnerf"].update(format_version=2))


@case
def unknown_unit(scene: Path) -> None:
    edit(scene, lambda data: data["plnerf"].update(unit="feet"))


@case
def plnerf_key_of_wrong_kind(scene: Path) -> None:
    edit(scene, lambda data: data.update(plnerf=True))


@case
def up_is_zero(scene: Path) -> None:
    edit(scene, lambda data: data["plnerf"].update(up=[0, 0, 0]))


@case
def cameras_in_one_place(scene: Path) -> None:
    def stay(data: dict[str, Any]) -> None:
        for frame in data["frames"]:
            for row in frame["transform_matrix"][:3]:
                row[3] = 5.0

    edit(scene, stay)


@case
def too_small(scene: Path) -> None:
    """The scene is good; DOWNSCALE is not."""


@case
def too_small_at_full_size(scene: Path) -> None:
    edit(scene, lambda data: data.update(w=12, h=32))


@case
def downscale_zero(scene: Path) -> None:
    """The scene is good; DOWNSCALE is not."""


@case
def nothing_known(scene: Path) -> None:
    (scene / "transforms.json").unlink()


@case
def no_folder(scene: Path) -> None:
    shutil.rmtree(scene)


@case
def a_photo_instead_of_a_folder(scene: Path) -> None:
    shutil.rmtree(scene)
    scene.write_bytes(b"x")


def to_colmap(scene: Path) -> Path:
    write_colmap(read_listing(scene), scene / "sparse/0", text=True)
    (scene / "transforms.json").unlink()
    return scene / "sparse/0"


@case
def colmap_fisheye(scene: Path) -> None:
    cameras = to_colmap(scene) / "cameras.txt"
    cameras.write_text("1 OPENCV_FISHEYE 48 32 40 40 24 16 0 0 0 0\n")


@case
def colmap_missing_image(scene: Path) -> None:
    to_colmap(scene)
    (scene / "images/0002.png").unlink()


@case
def colmap_without_images(scene: Path) -> None:
    to_colmap(scene)
    shutil.rmtree(scene / "images")


@case
def colmap_not_whole(scene: Path) -> None:
    (to_colmap(scene) / "points3D.txt").unlink()


@case
def colmap_unregistered(scene: Path) -> None:
    model = to_colmap(scene)
    for name in ("images.txt", "frames.txt"):
        (model / name).write_text("")


@case
def colmap_other_size(scene: Path) -> None:
    model = to_colmap(scene)
    (model / "cameras.txt").write_text("1 PINHOLE 96 64 80 80 48 32\n")


@pytest.mark.parametrize("name", CASES)
def test_error_text(
    name: str, tiny_scene: Path, tmp_path: Path, snapshot: Callable[[str, str], None]
) -> None:
    CASES[name](tiny_scene)
    with pytest.raises(SceneError) as caught:
        load_scene(tiny_scene, store=tmp_path / "store", downscale=DOWNSCALE.get(name, 1))
    text = str(caught.value)
    assert "\n" not in text and len(text) < 700
    assert str(tiny_scene) in text or name in {"downscale_zero", "cameras_in_one_place", "vertical_line"}
    text = re.sub(
        r"\(\d+ bytes not processed\)", "(N bytes not processed)", text
    )  # depends on the JPEG library
    snapshot(f"scene_{name}", text.replace(str(tiny_scene), "<scene>"))


def test_small_drift_of_a_pose_is_taken_out(tiny_scene: Path, tmp_path: Path) -> None:
    before = load_scene(tiny_scene, store=tmp_path / "store").cameras
    edit_pose(tiny_scene, lambda pose: pose @ np.diag([1.0005, 0.9995, 1.0, 1.0]))
    after = load_scene(tiny_scene, store=tmp_path / "store").cameras
    assert np.allclose(after.R_scene_camera, before.R_scene_camera, atol=1e-6)


def test_no_stored_text_is_left_over() -> None:
    stored = {path.stem for path in SNAPSHOTS.glob("scene_*.txt")}
    assert stored == {f"scene_{name}" for name in CASES}
