"""Rays: through the pixel they were cast for, of unit length, and as wide as the pixel."""

import cv2
import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from plnerf.rays.rays import Rays, pixel_rays, undistort
from plnerf.scene.cameras import Cameras, project

WIDE = [-0.28, 0.09, 8e-4, -6e-4, -0.012]  # k1 k2 p1 p2 k3 of an action camera
NONE = [0.0] * 5


def make_cameras(distortions: list[list[float]], dtype: torch.dtype = torch.float32) -> Cameras:
    n = len(distortions)
    rng = np.random.default_rng(0)
    return Cameras(
        R_scene_camera=torch.from_numpy(Rotation.random(n, rng=rng).as_matrix()).to(dtype),
        centre=torch.from_numpy(rng.normal(size=(n, 3))).to(dtype),
        focal_px=torch.tensor([[800.0, 790.0]], dtype=dtype).repeat(n, 1),
        principal_px=torch.tensor([[642.3, 355.1]], dtype=dtype).repeat(n, 1),
        distortion=torch.tensor(distortions, dtype=dtype),
        size_px=torch.tensor([[1280, 720]]).repeat(n, 1),
    )


def corners_and_middle(dtype: torch.dtype) -> torch.Tensor:
    return torch.tensor(
        [[0.5, 0.5], [1279.5, 0.5], [0.5, 719.5], [1279.5, 719.5], [642.3, 355.1], [300.5, 200.5]],
        dtype=dtype,
    )


def test_undistortion_inverts_opencv_s_projection() -> None:
    """At the corners too: to 1e-6 of the plane z = 1, a thousandth of a pixel."""
    cameras = make_cameras([NONE, WIDE], torch.float64)
    pixel = corners_and_middle(torch.float64)
    for index, distortion in enumerate([NONE, WIDE]):
        camera = torch.full((len(pixel),), index)
        plane = undistort(cameras, camera, pixel)
        points = torch.cat([plane, torch.ones_like(plane[:, :1])], -1).numpy()
        matrix = np.array([[800.0, 0, 642.3], [0, 790.0, 355.1], [0, 0, 1]])
        back, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), matrix, np.array(distortion))
        np.testing.assert_allclose(back[:, 0] / [800, 790], pixel.numpy() / [800, 790], atol=1e-6)
    assert (
        float((undistort(cameras, camera, pixel) - undistort(cameras, camera * 0, pixel)).abs().max()) > 0.05
    )


def test_undistortion_of_projected_points_gives_them_back() -> None:
    cameras = make_cameras([WIDE], torch.float64)
    truth = undistort(cameras, torch.zeros(6, dtype=torch.long), corners_and_middle(torch.float64))
    points = torch.cat([truth, torch.ones_like(truth[:, :1])], -1).numpy()
    matrix = np.array([[800.0, 0, 642.3], [0, 790.0, 355.1], [0, 0, 1]])
    pixel, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), matrix, np.array(WIDE))
    found = undistort(cameras, torch.zeros(6, dtype=torch.long), torch.from_numpy(pixel[:, 0]))
    torch.testing.assert_close(found, truth, atol=1e-6, rtol=0)


def test_each_ray_has_its_own_camera() -> None:
    """Cameras in any order in one batch, distorted and not, agree with one batch a camera."""
    cameras = make_cameras([WIDE, NONE, [0.1, 0.0, 0.0, 0.0, 0.0]])
    pixel = corners_and_middle(torch.float32)
    camera = torch.tensor([2, 0, 1, 0, 2, 1])
    mixed = pixel_rays(cameras, camera, pixel)
    assert torch.equal(mixed.camera, camera)
    for index in range(3):
        mine = camera == index
        alone = pixel_rays(cameras[[index]], torch.zeros_like(camera[mine]), pixel[mine])
        torch.testing.assert_close(mixed.directions[mine], alone.directions)
        torch.testing.assert_close(mixed.origins[mine], alone.origins)
        torch.testing.assert_close(mixed.radius[mine], alone.radius)


@pytest.mark.parametrize("distortion", [NONE, WIDE], ids=["pinhole", "wide"])
def test_points_on_a_ray_project_to_its_pixel(distortion: list[float]) -> None:
    cameras = make_cameras([distortion], torch.float64)
    pixel = corners_and_middle(torch.float64)
    rays = pixel_rays(cameras, torch.zeros(len(pixel), dtype=torch.long), pixel)
    torch.testing.assert_close(rays.directions.norm(dim=-1), torch.ones(len(rays), dtype=torch.float64))
    torch.testing.assert_close(rays.origins, cameras.centre.expand(len(rays), -1))
    for t in (0.3, 20.0):
        seen, depth = project(cameras, rays.origins + t * rays.directions)
        assert bool((depth > 0).all())
        torch.testing.assert_close(seen[0], pixel, atol=1e-3, rtol=0)


def test_the_principal_point_looks_along_the_camera_s_axis() -> None:
    cameras = make_cameras([NONE])
    rays = pixel_rays(cameras, torch.zeros(1, dtype=torch.long), cameras.principal_px)
    torch.testing.assert_close(rays.directions[0], cameras.R_scene_camera[0, :, 2])


def test_the_cone_is_as_wide_as_the_pixel() -> None:
    """At distance t the disc has the variance of a square pixel: r^2/4 = a^2/12, a the pixel's width."""
    focal = 640.0
    cameras = make_cameras([NONE], torch.float64)
    cameras = Cameras(
        cameras.R_scene_camera, cameras.centre, torch.full((1, 2), focal, dtype=torch.float64),
        cameras.principal_px, cameras.distortion, cameras.size_px,
    )  # fmt: skip
    pixel = corners_and_middle(torch.float64)
    rays = pixel_rays(cameras, torch.zeros(len(pixel), dtype=torch.long), pixel)
    plane = (pixel - cameras.principal_px) / focal
    cosine = 1 / (1 + plane.square().sum(-1)).sqrt()
    t = 7.0
    width = (
        t * cosine / focal
    )  # the pixel's width on the plane parallel to the image at distance t along the ray
    torch.testing.assert_close((rays.radius * t) ** 2 / 4, width**2 / 12)


def test_indexing_takes_rays_whole() -> None:
    generator = torch.Generator().manual_seed(0)
    rays = Rays(
        *torch.rand(2, 6, 3, generator=generator), torch.rand(6, generator=generator), torch.arange(6)
    )
    part = rays[1:4]
    assert len(rays) == 6
    assert len(part) == 3
    assert torch.equal(part.origins, rays.origins[1:4])
    assert torch.equal(part.directions, rays.directions[1:4])
    assert torch.equal(part.radius, rays.radius[1:4])
    assert torch.equal(part.camera, rays.camera[1:4])
