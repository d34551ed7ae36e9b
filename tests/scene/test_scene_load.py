"""A loaded scene: cameras, pixels and frames fit together, whichever format it came in."""

import json
import time
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image
from scipy.spatial.transform import Rotation

from plnerf.errors import SceneError
from plnerf.scene.cameras import project
from plnerf.scene.formats import read_listing
from plnerf.scene.formats_colmap import write_colmap
from plnerf.scene.scene import Scene, load_scene, split
from plnerf.scene.transforms import Frames


def edit(scene: Path, **keys: object) -> None:
    data = json.loads((scene / "transforms.json").read_text())
    data["plnerf"].update({
        key.removeprefix("plnerf_"): keys.pop(key) for key in list(keys) if "plnerf_" in key
    })
    data.update(keys)
    (scene / "transforms.json").write_text(json.dumps(data))


def test_points_of_the_scene_show_their_colour_in_every_photo(tiny_scene: Path, tmp_path: Path) -> None:
    """World point -> scene -> pixel -> colour: the red ball's centre is red from everywhere, at any
    downscale."""
    for downscale in (1, 2):
        scene = load_scene(tiny_scene, store=tmp_path / str(downscale), downscale=downscale)
        ball = torch.from_numpy(scene.frames.to_scene(np.array([[0.0, 0.0, 0.5]]))).float()
        pixels, depth = project(scene.cameras, ball)
        assert (depth > 0).all()
        for i in range(len(scene.names)):
            x, y = pixels[i, 0].int().tolist()
            red, green, blue = scene.images.image(i)[y, x].tolist()
            assert red > 100 and red > 2 * green and red > 2 * blue
            # One pixel beyond the silhouette (radius 0.5 m) on the camera's left and right is not the ball.
            edge = 0.5 * scene.frames.scale * float(scene.cameras.focal_px[i, 0]) / float(depth[i, 0])
            for side in (x - edge - 1.5, x + edge + 1.5):
                red, green, _ = scene.images.image(i)[y, round(side)].tolist()
                assert red < 2 * green


def test_intrinsics_follow_the_true_size_ratio_of_each_axis(tiny_scene: Path, tmp_path: Path) -> None:
    full = load_scene(tiny_scene, store=tmp_path / "1").cameras
    for path in (tiny_scene / "images").iterdir():
        Image.new("RGB", (47, 33)).save(path)
    edit(tiny_scene, w=47, h=33)
    small = load_scene(tiny_scene, store=tmp_path / "2", downscale=2).cameras
    assert small.size_px[0].tolist() == [23, 16]
    torch.testing.assert_close(small.focal_px[0], full.focal_px[0] * torch.tensor([23 / 47, 16 / 33]))
    torch.testing.assert_close(small.principal_px[0], torch.tensor([24 * 23 / 47, 16 * 16 / 33]))
    assert torch.equal(small.centre, full.centre)


def relative_geometry(scene: Scene) -> np.ndarray:
    """Camera centres and view directions back in the world, from the float32 scene."""
    centres = scene.frames.to_world(scene.cameras.centre.double().numpy())
    views = scene.cameras.R_scene_camera[:, :, 2].double().numpy() @ scene.frames.R_scene_world
    return np.concatenate([centres, views], axis=1)


@pytest.mark.parametrize("text", [False, True])
def test_colmap_and_transforms_are_the_same_scene(tiny_scene: Path, tmp_path: Path, text: bool) -> None:
    one = load_scene(tiny_scene, store=tmp_path / "1")
    write_colmap(read_listing(tiny_scene), tiny_scene / "sparse/0", text=text)
    (tiny_scene / "transforms.json").unlink()
    two = load_scene(tiny_scene, store=tmp_path / "2")
    assert (one.names, one.train, one.test) == (two.names, two.train, two.test)
    assert (one.format, two.format) == ("nerfstudio", "colmap")
    np.testing.assert_allclose(relative_geometry(two), relative_geometry(one), atol=1e-5)
    torch.testing.assert_close(two.cameras.focal_px, one.cameras.focal_px)
    assert all(np.array_equal(one.images.image(i), two.images.image(i)) for i in range(12))


def test_every_eighth_image_by_name_is_held_out(tiny_scene: Path, tmp_path: Path) -> None:
    scene = load_scene(tiny_scene, store=tmp_path / "s")
    assert scene.test == (0, 8) and sorted(scene.train + scene.test) == list(range(12))


def test_the_files_own_lists_decide_the_split(tiny_scene: Path) -> None:
    edit(tiny_scene, plnerf_test=["images/0011.png", "images/0003.png"])
    assert split(read_listing(tiny_scene)) == ((0, 1, 2, 4, 5, 6, 7, 8, 9, 10), (3, 11))
    edit(tiny_scene, train_filenames=["images/0001.png", "images/0002.png"])
    assert split(read_listing(tiny_scene)) == ((1, 2), (3, 11))
    edit(tiny_scene, plnerf_test=None)
    assert split(read_listing(tiny_scene)) == ((1, 2), (0, *range(3, 12)))
    edit(tiny_scene, test_filenames=["images/0002.png"])
    with pytest.raises(SceneError, match="train on images that they also hold out"):
        split(read_listing(tiny_scene))


def test_left_out_images_are_a_warning(tiny_scene: Path, tmp_path: Path) -> None:
    edit(tiny_scene, aabb_scale=1)
    (tiny_scene / "images/0004.png").unlink()
    with pytest.warns(UserWarning, match=r"Left out.* 1 of the 12 images .*\(images/0004\.png\)"):
        scene = load_scene(tiny_scene, store=tmp_path / "s")
    assert scene.left_out == ("images/0004.png",) and len(scene.cameras) == 11


@pytest.mark.data
@pytest.mark.parametrize("as_colmap", [False, True])
def test_fox_loads_quickly(shared_data: Path, tmp_path: Path, as_colmap: bool) -> None:
    source = shared_data / "fox"
    if as_colmap:
        (tmp_path / "fox").mkdir()
        (tmp_path / "fox/images").symlink_to(source / "images")
        write_colmap(read_listing(source), tmp_path / "fox/sparse/0")
        source = tmp_path / "fox"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        scene = load_scene(source, store=tmp_path / "store", downscale=8)
        begin = time.perf_counter()
        again = load_scene(source, store=tmp_path / "store", downscale=8)
        seconds = time.perf_counter() - begin
    assert len(scene.names) == 50 and len(scene.test) == 7 and len(scene.train) == 43
    assert scene.images.image(49).shape == (240, 135, 3)
    assert len(scene.left_out) == (0 if as_colmap else 17)
    assert scene.frames.unit == "unscaled" and "estimated" in scene.frames.up_source
    assert torch.equal(scene.cameras.centre, again.cameras.centre)
    assert seconds < 1.0  # 0.01 s alone on an idle core; the bound only catches a rebuild
    # The photos are portraits of a fox taken upright: camera up is within 60 degrees of scene up.
    assert (-scene.cameras.R_scene_camera[:, 2, 1] > 0.5).all()


def test_a_scene_in_other_frames_shows_the_same(tiny_scene: Path, tmp_path: Path) -> None:
    """Places of the world have the same pixels; in its own frames it is itself to the bit; pixels stay."""
    scene = load_scene(tiny_scene, store=tmp_path / "s")
    turn = Rotation.from_euler("z", 0.8).as_matrix()
    other = replace(
        scene.frames, R_scene_world=turn @ scene.frames.R_scene_world, scale=3 * scene.frames.scale,
        shift_world=scene.frames.shift_world + np.array([0.3, -0.2, 0.1]),
    )  # fmt: skip
    box = np.array([[-1.0, -1, -1], [1, 1, 1]])
    moved = scene.in_frames(other, box)
    assert moved.frames is other and moved.box is box and moved.images is scene.images
    world = scene.frames.to_world(0.3 * np.random.default_rng(0).normal(size=(50, 3)))
    (before, depth), (after, deeper) = (
        project(one.cameras, torch.from_numpy(one.frames.to_scene(world)).float()) for one in (scene, moved)
    )
    front = depth > 0.1
    assert (before - after)[front].abs().max() < 1e-2 and front.any()
    torch.testing.assert_close(deeper[front], 3 * depth[front], rtol=1e-4, atol=1e-5)
    back = moved.in_frames(scene.frames, scene.box)
    torch.testing.assert_close(back.cameras.centre, scene.cameras.centre, atol=1e-6, rtol=0)
    same = scene.in_frames(Frames.from_json(scene.frames.to_json()), box)
    assert same.cameras is scene.cameras and same.frames is scene.frames and same.box is box
