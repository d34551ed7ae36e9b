"""An evaluation finds a model that knows everything right, says what it measured, and how."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image
from scipy.ndimage import distance_transform_edt
from tests.support.oracle import Seen, oracle_run, tiny_world, z_depth_mm

from plnerf.errors import SceneError
from plnerf.rays.rays import Rays
from plnerf.render.views import RenderedView
from plnerf.scene.scene import Scene, load_scene
from plnerf.train.evaluate import evaluate_run, measure, panel_names
from plnerf.train.metrics import Lpips
from plnerf.train.protocol import plain


@pytest.fixture
def scene_with_truth(tiny_scene: Path, tmp_path: Path) -> Scene:
    """The tiny scene with depth pictures and "wire" masks (the ball, found by its colour) for its images."""
    bare = load_scene(tiny_scene, store=tmp_path / "bare")
    data = json.loads((tiny_scene / "transforms.json").read_text())
    for folder in ("depth", "wire_masks"):
        (tiny_scene / folder).mkdir()
    for i, frame in enumerate(data["frames"]):
        name = f"{i:04d}.png"
        Image.fromarray(z_depth_mm(bare, i)).save(tiny_scene / "depth" / name)
        red, green, _ = np.moveaxis(bare.images.image(i).astype(int), -1, 0)
        Image.fromarray(((red > 2 * green) * 255).astype(np.uint8)).save(tiny_scene / "wire_masks" / name)
        frame |= {"depth_path": f"depth/{name}", "wire_mask_path": f"wire_masks/{name}"}
    (tiny_scene / "transforms.json").write_text(json.dumps(data))
    return load_scene(tiny_scene, store=tmp_path / "store")


def read_strictly(path: Path) -> dict:  # type: ignore[type-arg]
    """JSON as the standard has it: no NaN, no Infinity."""

    def refuse(name: str) -> float:
        raise AssertionError(f"{name} is no JSON")

    content: dict = json.loads(path.read_text(), parse_constant=refuse)  # type: ignore[type-arg]
    return content


def test_the_oracle_is_right_to_the_rounding_of_the_photos(scene_with_truth: Scene, tmp_path: Path) -> None:
    told: list[tuple[int, int]] = []
    path = evaluate_run(
        oracle_run(scene_with_truth, tmp_path / "run"), progress=lambda a, b: told.append((a, b))
    )
    content = read_strictly(path)
    assert [image["name"] for image in content["images"]] == ["images/0000.png", "images/0008.png"]
    for score in (*content["images"], content["mean"]):
        assert score["psnr_db"] > 58 and score["wire_psnr_db"] > 58
        assert score["elsewhere_psnr_db"] == "inf", "the floor's and the sky's colours need no rounding"
        assert score["ssim"] > 0.999 and score["lpips"] is None
        assert score["near_wire_psnr_db"] > score["wire_psnr_db"] and score["near_wire_ssim"] > 0.999
        for part in ("wire_depth", "elsewhere_depth"):
            assert score[part]["median_m"] < 6e-4, "half a millimetre of rounding"
            assert score[part]["close_share"] == 1 and score[part]["no_surface_share"] == 0
    assert told == [(1, 2), (2, 2)]


def test_near_wires_are_what_lies_within_three_pixels(scene_with_truth: Scene, tmp_path: Path) -> None:
    """Grey beyond that changes neither measure of the pixels near wires; grey within it changes both."""
    scene, i = scene_with_truth, 0
    photo = scene.images.image(i).astype(np.float32) / 255
    wire = np.asarray(Image.open(scene.wire_masks[i])) > 0
    distance = distance_transform_edt(~wire)
    flat = np.ones(photo.shape[:2], np.float32)
    plain_view = RenderedView(photo, flat, flat, flat, flat, None)
    right = measure(plain_view, scene, i, Lpips())
    assert right.near_wire_psnr_db == math.inf and right.near_wire_ssim == pytest.approx(1)
    far = np.where((distance > 12)[..., None], np.float32(0.5), photo)  # farther than a window reaches
    beyond = measure(replace(plain_view, rgb=far), scene, i, Lpips())
    assert beyond.near_wire_psnr_db == math.inf and beyond.near_wire_ssim == pytest.approx(1)
    assert beyond.psnr_db is not None and beyond.psnr_db < 30
    rim = np.where(((distance > 2) & (distance <= 3))[..., None], np.float32(0.5), photo)
    at_rim = measure(replace(plain_view, rgb=rim), scene, i, Lpips())
    assert at_rim.wire_psnr_db == math.inf and at_rim.near_wire_psnr_db is not None
    assert at_rim.near_wire_psnr_db < 25 and (at_rim.near_wire_ssim or 1) < 0.95


def test_errors_are_found_where_they_are(scene_with_truth: Scene, tmp_path: Path) -> None:
    """The ball grey and half a metre too near: wires suffer, the rest does not."""
    truth = tiny_world(scene_with_truth.frames)

    def see(rays: Rays) -> Seen:
        seen = truth(rays)
        ball = seen.colour[:, 0] > 2 * seen.colour[:, 1]
        grey = torch.where(ball[:, None], torch.tensor(0.5), seen.colour)
        return replace(seen, colour=grey, t=seen.t - 0.5 * scene_with_truth.frames.scale * ball)

    mean = read_strictly(evaluate_run(oracle_run(scene_with_truth, tmp_path / "run", see)))["mean"]
    assert mean["wire_psnr_db"] < 15 and mean["elsewhere_psnr_db"] == "inf"
    assert mean["wire_psnr_db"] < mean["near_wire_psnr_db"] < mean["psnr_db"] < 30
    assert mean["near_wire_ssim"] < mean["ssim"] < 0.99
    assert 0.4 < mean["wire_depth"]["median_m"] <= 0.5 and mean["wire_depth"]["close_share"] == 0
    assert mean["elsewhere_depth"]["median_m"] < 6e-4 and mean["elsewhere_depth"]["close_share"] == 1


def test_a_scene_without_truth_is_measured_by_its_colours(tiny_scene: Path, tmp_path: Path) -> None:
    scene = load_scene(tiny_scene, store=tmp_path / "store")
    path = evaluate_run(oracle_run(scene, tmp_path / "run"))
    mean = read_strictly(path)["mean"]
    assert mean["psnr_db"] > 58
    assert mean["wire_psnr_db"] is mean["wire_depth"] is mean["elsewhere_depth"] is None
    assert mean["near_wire_psnr_db"] is mean["near_wire_ssim"] is None
    assert "wires" not in (path.parent / "summary.md").read_text()


def test_the_protocol_says_all_that_decides_the_numbers(scene_with_truth: Scene, tmp_path: Path) -> None:
    run = oracle_run(scene_with_truth, tmp_path / "run")
    with torch.no_grad():
        run.model.appearance.copy_(torch.arange(36.0).reshape(12, 3))
    protocol = read_strictly(evaluate_run(run))["protocol"]
    assert (
        protocol["held_out"] == ["images/0000.png", "images/0008.png"] and protocol["training_images"] == 10
    )
    assert protocol["resolution_px"] == [[48, 32]] and protocol["downscale"] == 1
    assert protocol["step"] == 7 and protocol["training_seconds"] == 1.5 and protocol["seed"] == 0
    assert protocol["backend"] == "torch" and protocol["device"] == "cpu" and protocol["preset"] == "oracle"
    assert protocol["pose_refinement"] is False and "not refined" in protocol["held_out_poses"]
    assert protocol["rays_per_second"] > 0 and protocol["hardware"]["cpu"] and protocol["torch"]
    # The vector that was used is the one that is stated.
    assert protocol["appearance_vector"] == "mean of the training images' vectors"
    expected = torch.arange(36.0).reshape(12, 3)[list(scene_with_truth.train)].mean(0)
    assert all(torch.allclose(used, expected) for used in run.model.appearances)  # type: ignore[union-attr]


def test_panels_and_summary_go_with_the_numbers(scene_with_truth: Scene, tmp_path: Path) -> None:
    path = evaluate_run(oracle_run(scene_with_truth, tmp_path / "run"))
    panels = sorted((path.parent / "panels").iterdir())
    assert [panel.name for panel in panels] == ["0000.png", "0008.png"]
    with Image.open(panels[0]) as panel:
        assert panel.width > 4 * 320
    summary = (path.parent / "summary.md").read_text()
    assert f"{read_strictly(path)['mean']['psnr_db']:.2f}" in summary and "images/0008.png" in summary
    assert not list(path.parent.rglob("*.partial*"))


def test_a_broken_mask_stops_and_leaves_the_earlier_evaluation(
    scene_with_truth: Scene, tmp_path: Path
) -> None:
    run = oracle_run(scene_with_truth, tmp_path / "run")
    path = evaluate_run(run)
    before = {one: one.read_bytes() for one in path.parent.rglob("*.*")}
    (scene_with_truth.root / "wire_masks" / "0008.png").write_text("gone")
    with pytest.raises(SceneError, match=r"0008\.png cannot be read"):
        evaluate_run(run)
    assert {one: one.read_bytes() for one in path.parent.rglob("*.*")} == before and len(before) == 4


def test_infinity_is_written_as_text() -> None:
    value = plain({"a": [math.inf, 1.0, (-math.inf, None)], "b": {"c": 2}})
    assert value == {"a": ["inf", 1.0, ["-inf", None]], "b": {"c": 2}}


def test_panels_of_images_with_like_names_stay_apart() -> None:
    assert panel_names(["images/0001.jpg", "images/a/0001.jpg"]) == ["0001", "a-0001"]
    assert panel_names(["images/1.jpg", "images/1.png"]) == ["1.jpg", "1.png"]
