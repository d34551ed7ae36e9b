"""Rendering a run: as many pictures as asked for, depth that reads back, nothing stale or half-written."""

import json
from dataclasses import replace
from pathlib import Path

import imageio.v2 as imageio
import numpy as np
import pytest
import torch
from PIL import Image
from tests.support.oracle import oracle_run, tiny_config, z_depth_mm

from plnerf.errors import ConfigError
from plnerf.ops.backends import Backend
from plnerf.render.model import PLNeRF
from plnerf.render.pictures import DepthRange, rgb_picture, uncertainty_picture, world_deviation
from plnerf.render.views import render_view, resized
from plnerf.scene.scene import Scene, load_scene
from plnerf.train.evaluate import mean_appearance
from plnerf.train.render_run import FLIGHT, evenly, refined_cameras, render_run, shots_of


@pytest.fixture
def scene(tiny_scene: Path, tmp_path: Path) -> Scene:
    return load_scene(tiny_scene, store=tmp_path / "store")


def pictures(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_held_out_views_show_the_photos_and_the_true_depth(scene: Scene, tmp_path: Path) -> None:
    told: list[tuple[int, int]] = []
    folder = render_run(
        oracle_run(scene, tmp_path / "run"),
        views="test",
        outputs=("rgb", "depth", "normals", "accumulation"),
        video=False,
        progress=lambda a, b: told.append((a, b)),
    )
    assert folder == tmp_path / "run" / "renders" / "test" and told == [(1, 2), (2, 2)]
    for kind in ("rgb", "depth", "normals", "accumulation", "depth_16bit"):
        assert pictures(folder / kind) == ["0000.png", "0001.png"]
    for number, i in enumerate(scene.test):
        rgb = np.asarray(Image.open(folder / "rgb" / f"{number:04d}.png"))
        assert np.abs(rgb.astype(int) - scene.images.image(i)).max() <= 1
        truth_mm = z_depth_mm(scene, i).astype(int)
        raw = np.asarray(Image.open(folder / "depth_16bit" / f"{number:04d}.png")).astype(int)
        assert ((raw == 0) == (truth_mm == 0)).all() and np.abs(raw - truth_mm).max() <= 1
        metres = np.load(folder / "depth_npy" / f"{number:04d}.npy")
        np.testing.assert_allclose(metres[truth_mm < 65535] * 1000, truth_mm[truth_mm < 65535], atol=0.6)
        alpha = np.asarray(Image.open(folder / "accumulation" / f"{number:04d}.png"))
        assert ((alpha == 255) == (truth_mm > 0)).all()
    assert not list((tmp_path / "run").rglob("*.mp4"))


def test_a_video_has_the_frames_that_were_asked_for(scene: Scene, tmp_path: Path) -> None:
    folder = render_run(
        oracle_run(scene, tmp_path / "run"),
        views="path",
        outputs=("rgb", "depth"),
        frames=7,
        fps=5.0,
        scale=1.07,
    )
    assert pictures(folder / "rgb") == [f"{i:04d}.png" for i in range(7)]
    assert pictures(folder.parent) == ["path", "path-depth.mp4", "path-rgb.mp4"]
    with Image.open(folder / "rgb" / "0003.png") as picture:
        assert picture.size == (51, 34)
    with imageio.get_reader(folder.parent / "path-rgb.mp4") as video:
        frames = [np.asarray(frame).astype(int) for frame in video]
        assert video.get_meta_data()["fps"] == 5.0 and video.get_meta_data()["pix_fmt"].startswith("yuv420p")
    assert len(frames) == 7 and frames[0].shape == (34, 50, 3)
    still = np.asarray(Image.open(folder / "rgb" / "0003.png")).astype(int)[:34, :50]
    assert np.abs(frames[3] - still).mean() < 12
    assert not (folder / "depth_16bit").exists()


def test_training_views_have_their_own_appearance_and_refined_pose(scene: Scene, tmp_path: Path) -> None:
    run = oracle_run(scene, tmp_path / "run")
    with torch.no_grad():
        run.model.appearance.copy_(torch.arange(36.0).reshape(12, 3))
        run.model.poses.correction[:, 3:] = torch.tensor([0.1, 0.0, 0.0])
    run = replace(run, config=replace(run.config, train=replace(run.config.train, pose_refinement=True)))
    folder = render_run(run, views="train", outputs=("rgb",), scale=0.25, video=False)
    used = run.model.appearances  # type: ignore[union-attr]
    assert [round(float(vector[0, 0])) for vector in used] == [3 * i for i in scene.train]
    content = json.loads((folder / "render.json").read_text())
    assert content["poses"] == "as refined in training" and content["rgb"].endswith("each image's own")
    for view, i in zip(content["cameras"]["views"], scene.train, strict=True):
        T = np.array(view["T_world_camera"])
        moved = scene.frames.to_scene(T[:3, 3]) - scene.cameras.centre[i].numpy()
        np.testing.assert_allclose(moved, [0.1, 0, 0], atol=1e-5)
        np.testing.assert_allclose(
            scene.frames.R_scene_world @ T[:3, :3], scene.cameras.R_scene_camera[i], atol=1e-5
        )


def test_cameras_are_refined_as_training_refines_their_rays(scene: Scene, tmp_path: Path) -> None:
    from plnerf.rays.rays import pixel_rays

    model = oracle_run(scene, tmp_path / "run").model
    with torch.no_grad():
        model.poses.correction.normal_(0, 0.1, generator=torch.Generator().manual_seed(0))
    index = torch.arange(12)
    pixels = torch.rand(12, 2, generator=torch.Generator().manual_seed(1)) * 30
    corrected = model.poses(pixel_rays(scene.cameras, index, pixels))
    rays = pixel_rays(refined_cameras(model, scene.cameras), index, pixels)
    torch.testing.assert_close(rays.origins, corrected.origins)
    torch.testing.assert_close(rays.directions, corrected.directions)


def test_a_later_call_with_fewer_frames_leaves_nothing_stale(scene: Scene, tmp_path: Path) -> None:
    run = oracle_run(scene, tmp_path / "run")
    render_run(run, views="path", outputs=("rgb", "accumulation"), frames=5, scale=0.3)
    folder = render_run(run, views="path", outputs=("rgb",), frames=3, scale=0.3, video=False)
    assert pictures(folder / "rgb") == ["0000.png", "0001.png", "0002.png"]
    assert pictures(folder / "accumulation") == [f"{i:04d}.png" for i in range(5)]
    assert pictures(folder.parent) == ["path", "path-accumulation.mp4"]


def test_the_description_says_what_was_rendered_and_stays_with_its_pictures(
    scene: Scene, tmp_path: Path
) -> None:
    run = oracle_run(scene, tmp_path / "run")
    folder = render_run(run, views="test", outputs=("depth",), scale=0.5, video=False)
    content = json.loads((folder / "render.json").read_text())
    assert content["outputs"] == ["depth"] and content["frames"] == 2 and content["fps"] is None
    assert "value / 1000" in content["depth"]["depth_16bit"] and content["depth"]["unit"] == "m"
    assert [view["name"] for view in content["cameras"]["views"]] == ["images/0000.png", "images/0008.png"]
    assert content["cameras"]["views"][0]["size_px"] == [24, 16]

    class Stopped(Exception):
        pass

    def stop(done: int, total: int) -> None:
        raise Stopped

    before = (folder / "depth" / "0000.png").read_bytes()
    with pytest.raises(Stopped):
        render_run(run, views="test", outputs=("depth",), scale=0.25, video=False, progress=stop)
    assert json.loads((folder / "render.json").read_text()) == content
    assert (folder / "depth" / "0000.png").read_bytes() == before
    assert {path.name for path in folder.parent.iterdir()} == {"test"}


@pytest.mark.parametrize("backend", ["numba", "torch"])
def test_frames_of_a_flight_are_pruned_on_a_cpu_and_say_so(
    scene: Scene, tmp_path: Path, backend: Backend
) -> None:
    run = oracle_run(scene, tmp_path / "run")
    config = tiny_config()
    config = replace(config, sampler=replace(config.sampler, final=48))
    model = PLNeRF(config, len(scene.names), backend, torch.Generator().manual_seed(0))
    with torch.no_grad():
        model.field.grid.table *= 1e4
    run = replace(run, model=model.eval())
    pruning = FLIGHT if backend == "numba" else None
    for views, expected in (("path", pruning), ("test", None)):
        folder = render_run(run, views=views, outputs=("rgb",), frames=2, scale=0.5, video=False)
        told = json.loads((folder / "render.json").read_text())["pruning"]
        assert told == (None if expected is None else {"weight_budget": expected.weight_budget})
        shot = shots_of(run, views, 2, 0.5)[0]
        view = render_view(model, shot.camera, shot.appearance, normals=False, pruning=expected)
        rgb = np.asarray(Image.open(folder / "rgb" / "0000.png"))
        assert np.array_equal(rgb, rgb_picture(view.rgb))
        assert (view.coloured < 1) == (expected is not None)


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"views": "all"}, "test, train, path, but got 'all'"),
        ({"outputs": ("rgb", "heat")}, "rgb, depth, normals, uncertainty, accumulation .* but got 'heat'"),
        ({"outputs": ()}, "but got none"),
        ({"views": "path", "frames": 1}, "at least 2 frames"),
        ({"fps": 0.0}, "positive number of frames"),
        ({"scale": 0.0}, "positive factor"),
    ],
)
def test_options_that_cannot_be_are_errors_in_words(
    scene: Scene, tmp_path: Path, options: dict[str, object], text: str
) -> None:
    """Annotations would stop the wrong words before; the command line does not read annotations."""
    inner = render_run
    while hasattr(inner, "__wrapped__"):
        inner = inner.__wrapped__
    with pytest.raises(ConfigError, match=text):
        inner(oracle_run(scene, tmp_path / "run"), **{"views": "test", "outputs": ("rgb",), **options})
    assert not (tmp_path / "run").exists()


def test_normals_of_a_model_without_any_are_refused(scene: Scene, tmp_path: Path) -> None:
    run = oracle_run(scene, tmp_path / "run")
    config = run.model.config
    run.model.config = replace(config, field=replace(config.field, normals=False))
    with pytest.raises(ConfigError, match="predicts no normals"):
        render_run(run, views="test", outputs=("rgb", "normals"))


def test_views_are_chosen_evenly() -> None:
    assert evenly(range(10), 20) == list(range(10))
    assert evenly(range(101), 5) == [0, 25, 50, 75, 100]


def test_uncertainty_is_rendered_with_its_range_and_unit(tiny_scene: Path, tmp_path: Path) -> None:
    scene = load_scene(tiny_scene, store=tmp_path / "store")
    run = oracle_run(scene, tmp_path / "run")
    model = PLNeRF(tiny_config(), len(scene.names), "torch", torch.Generator().manual_seed(3)).eval()
    with torch.no_grad():  # a fog, in which rays end somewhere
        model.field.density_network[-1].bias.fill_(6.0)
    run = replace(run, model=model)
    folder = render_run(run, views="test", outputs=("uncertainty",), scale=0.5, video=False)
    assert pictures(folder / "uncertainty") == ["0000.png", "0001.png"]
    described = json.loads((folder / "render.json").read_text())["uncertainty"]
    assert described["unit"] == "m" and 0 < described["least"] < described["greatest"]
    picture = np.asarray(Image.open(folder / "uncertainty" / "0000.png"))
    camera = resized(scene.cameras[[scene.test[0]]], 0.5)
    view = render_view(model, camera, mean_appearance(run), normals=False, deviation=True)
    height, width = view.accumulation.shape
    assert picture.shape[0] > height and picture.shape[1] == width  # a legend below
    shown = DepthRange(described["least"], described["greatest"], "m")
    expected = uncertainty_picture(world_deviation(view, scene.frames), shown)
    assert expected.std() > 1 and np.array_equal(picture[:height], expected)
