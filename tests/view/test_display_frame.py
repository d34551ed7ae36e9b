"""Places in the viewer are near its origin, and keep a tenth of a millimetre of large coordinates."""

import numpy as np
import torch
from tests.support.surveys import FRAME, turned

from plnerf.line.frame import LineFrame
from plnerf.scene.cameras import Cameras, project
from plnerf.scene.transforms import Frames
from plnerf.view.display_frame import DisplayFrame
from plnerf.view.eye import Eye, eye_of, looking

UTM = np.array([691_234.5, 5_334_567.25, 512.75])


def test_places_on_a_map_keep_a_tenth_of_a_millimetre() -> None:
    line = LineFrame(np.eye(3), 1.0, np.zeros(3), "m")  # whose origin is far from the line
    x = UTM + np.random.default_rng(0).uniform(-500, 500, (1000, 3))
    frame = DisplayFrame(line, x.mean(0))
    sent = frame.to_viewer(x)
    assert sent.dtype == np.float32
    assert np.abs(frame.to_line(sent) - x).max() < 1e-4
    # What viser would send by itself is not good enough, nor are float32 coordinates of the map.
    assert np.abs(sent.astype(np.float16).astype(float) - sent).max() * 10 > 0.05
    assert np.abs(x.astype(np.float32) - x).max() > 0.1


def cameras_of(frames: Frames) -> Cameras:
    rng = np.random.default_rng(1)
    R = np.stack([turned(30), turned(-70)]) @ np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])
    return Cameras(
        torch.from_numpy(R).float(), torch.from_numpy(rng.normal(size=(2, 3))).float(),
        torch.tensor([[50.0, 52.0], [40.0, 40.0]]), torch.tensor([[31.0, 17.0], [32.0, 20.0]]),
        torch.zeros(2, 5), torch.tensor([[64, 40], [64, 40]]),
    )  # fmt: skip


def test_cameras_of_a_run_come_into_the_line_and_back() -> None:
    run = Frames(turned(50.0), 0.05, np.array([20.0, 3.0, 100.0]), "m", None, "file")
    frame = DisplayFrame(FRAME, np.array([4.0, 5.0, 6.0]))
    cameras = cameras_of(run)
    moved = frame.line_cameras(run, cameras)
    world = np.random.default_rng(2).normal(size=(20, 3)) * 30 + run.shift_world
    by_run, depth = project(cameras, torch.from_numpy(run.to_scene(world)).float())
    by_line, depth_m = project(moved, torch.from_numpy(FRAME.from_world(world)))
    front = depth > 0.1
    assert front.any() and (by_run - by_line)[front].abs().max() < 0.05
    assert (depth / 0.05 - depth_m)[front].abs().max() < 1e-3
    back = frame.scene_camera(run, moved[[1]])
    assert torch.allclose(back.centre, cameras.centre[[1]], atol=1e-5)
    assert torch.allclose(back.R_scene_camera, cameras.R_scene_camera[[1]], atol=1e-6)
    # A metre is 0.05 of the run's units and a tenth of the viewer's.
    assert np.allclose(frame.depth_to_viewer(run, np.array([[0.05]])), 0.1)


def test_an_eye_sees_what_a_camera_sees() -> None:
    cameras = cameras_of(Frames(np.eye(3), 1.0, np.zeros(3), "m", None, "file"))
    for aspect in (0.7, 1.6, 3.0):
        eye = eye_of(cameras, 1, aspect)
        one = eye.camera(10_000)
        width, height = one.size_px[0].tolist()
        assert abs(width / height - aspect) < 0.02 * aspect
        corners = np.array([[0.0, 0.0], [64.0, 40.0]]) - 0.5 * np.array([64, 40])
        rays = np.stack([*corners.T / 40.0, np.ones(2)], 1)
        places = rays @ eye.R_line_camera.T * 7 + eye.centre
        pixels = project(one, torch.from_numpy(places))[0][0].numpy()
        assert (pixels > -1).all() and (pixels < [width + 1, height + 1]).all()
        assert np.isclose(pixels, 0, atol=1).any()  # and no more than it must


def test_the_viewers_camera_is_read_as_it_is_sent() -> None:
    frame = DisplayFrame(FRAME, np.array([4.0, 5.0, 6.0]))
    eye = looking(np.array([1.0, 2.0, 3.0]), np.array([4.0, 8.0, 1.0]), 0.8, 1.5)
    read = Eye.of_viewer(frame, eye.wxyz, frame.to_viewer(eye.centre), 0.8, 1.5)
    assert np.allclose(read.R_line_camera, eye.R_line_camera) and np.allclose(read.centre, eye.centre)
    assert eye.R_line_camera[2, 1] < 0  # the picture's down is down
    assert np.isclose(np.linalg.det(eye.R_line_camera), 1)
