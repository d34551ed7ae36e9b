"""Projection agrees with OpenCV's; indexing keeps cameras whole."""

import cv2
import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from plnerf.scene.cameras import Cameras, distort, project


def random_cameras(n: int, seed: int) -> Cameras:
    rng = np.random.default_rng(seed)
    return Cameras(
        R_scene_camera=torch.from_numpy(Rotation.random(n, rng=rng).as_matrix()).float(),
        centre=torch.from_numpy(rng.normal(size=(n, 3))).float(),
        focal_px=torch.from_numpy(rng.uniform(50, 90, (n, 2))).float(),
        principal_px=torch.from_numpy(rng.uniform(20, 40, (n, 2))).float(),
        distortion=torch.from_numpy(rng.uniform(-0.05, 0.05, (n, 5))).float(),
        size_px=torch.tensor([[64, 48]]).repeat(n, 1),
    )


def test_projection_is_opencvs() -> None:
    cameras = random_cameras(5, seed=0)
    in_camera = torch.from_numpy(np.random.default_rng(1).uniform([-1, -1, 2], [1, 1, 4], (7, 3))).float()
    for i in range(len(cameras)):
        x_scene = in_camera @ cameras.R_scene_camera[i].T + cameras.centre[i]
        pixels, depth = project(cameras[[i]], x_scene)
        rotation = cameras.R_scene_camera[i].numpy().astype(np.float64).T
        matrix = np.diag([*cameras.focal_px[i].tolist(), 1.0])
        matrix[:2, 2] = cameras.principal_px[i].numpy()
        truth, _ = cv2.projectPoints(
            x_scene.numpy().astype(np.float64),
            cv2.Rodrigues(rotation)[0],
            -rotation @ cameras.centre[i].numpy().astype(np.float64),
            matrix,
            cameras.distortion[i].numpy().astype(np.float64),
        )
        torch.testing.assert_close(pixels[0], torch.from_numpy(truth[:, 0]).float(), atol=2e-3, rtol=0)
        torch.testing.assert_close(depth[0], in_camera[:, 2], atol=1e-4, rtol=0)


def test_no_distortion_is_the_identity() -> None:
    plane = torch.randn(9, 2, generator=torch.Generator().manual_seed(0))
    torch.testing.assert_close(distort(plane, torch.zeros(9, 5)), plane, atol=0, rtol=0)


@pytest.mark.parametrize(
    "index", [slice(1, 4), [3, 0], torch.tensor([2, 2]), torch.tensor([True, False] * 3)]
)
def test_indexing_takes_every_field_in_the_order_given(index: slice | list[int] | torch.Tensor) -> None:
    cameras = random_cameras(6, seed=2)
    chosen = cameras[index]
    order = torch.arange(6)[index]
    assert len(chosen) == len(order)
    for j, i in enumerate(order.tolist()):
        for name in ("R_scene_camera", "centre", "focal_px", "principal_px", "distortion", "size_px"):
            assert torch.equal(getattr(chosen, name)[j], getattr(cameras, name)[i])
