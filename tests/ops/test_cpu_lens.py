"""The CPU kernel of casting rays is its reference, for any mixture of cameras."""

import pytest
import torch

from plnerf.ops import launch
from plnerf.rays.rays import Rays, pixel_rays
from plnerf.scene.cameras import Cameras

LENSES = [  # k1 k2 p1 p2 k3: none, wide, pincushion, one that folds inside of the image
    [0.0] * 5,
    [-0.28, 0.09, 8e-4, -6e-4, -0.012],
    [0.3, 0.2, 0.0, 0.0, 0.0],
    [-0.5, 0.0, 0.01, 0.0, 0.0],
]
DTYPES = pytest.mark.parametrize("dtype", [torch.float32, torch.float64], ids=str)


def make_cameras(dtype: torch.dtype) -> Cameras:
    generator = torch.Generator().manual_seed(0)
    n = len(LENSES)
    R = torch.linalg.qr(torch.randn(n, 3, 3, generator=generator, dtype=torch.float64)).Q
    return Cameras(
        R_scene_camera=(R * R.det()[:, None, None]).to(dtype),
        centre=torch.randn(n, 3, generator=generator, dtype=torch.float64).to(dtype),
        focal_px=(700 + 100 * torch.rand(n, 2, generator=generator, dtype=torch.float64)).to(dtype),
        principal_px=torch.tensor([[642.3, 355.1]], dtype=dtype).repeat(n, 1),
        distortion=torch.tensor(LENSES, dtype=dtype),
        size_px=torch.tensor([[1280, 720]]).repeat(n, 1),
    )


def pixels(n: int, dtype: torch.dtype) -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(1)
    camera = torch.randint(len(LENSES), (n,), generator=generator)
    size = torch.tensor([1280.0, 720.0], dtype=torch.float64)
    return camera, (torch.rand(n, 2, generator=generator, dtype=torch.float64) * size).to(dtype)


def fields(rays: Rays) -> list[torch.Tensor]:
    return [rays.origins, rays.directions, rays.radius, rays.camera]


@DTYPES
def test_rays_are_the_reference(dtype: torch.dtype) -> None:
    cameras, (camera, pixel) = make_cameras(dtype), pixels(500, dtype)
    truth = pixel_rays(cameras, camera, pixel)
    found = pixel_rays(cameras, camera, pixel, "numba")
    for a, b in zip(fields(found), fields(truth), strict=True):
        assert a.dtype == b.dtype
        tolerance = 1e-6 if dtype == torch.float32 else 1e-12
        torch.testing.assert_close(a, b, atol=tolerance, rtol=tolerance)


def test_rays_of_single_precision_are_computed_in_double() -> None:
    cameras, (camera, pixel) = make_cameras(torch.float32), pixels(500, torch.float32)
    exact = Cameras(**{
        name: value.double() if value.is_floating_point() else value for name, value in vars(cameras).items()
    })
    truth = pixel_rays(exact, camera, pixel.double())
    found = pixel_rays(cameras, camera, pixel, "numba")
    torch.testing.assert_close(found.directions.double(), truth.directions, atol=6e-8, rtol=0)  # 2^-24


def test_results_do_not_depend_on_the_number_of_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    cameras, (camera, pixel) = make_cameras(torch.float32), pixels(101, torch.float32)
    alone = pixel_rays(cameras, camera, pixel, "numba")
    monkeypatch.setattr(launch, "_WORTH_WAKING_NS", 0)
    monkeypatch.setattr(launch, "num_threads", lambda: 3)
    for a, b in zip(fields(pixel_rays(cameras, camera, pixel, "numba")), fields(alone), strict=True):
        assert torch.equal(a, b)


def test_no_rays_are_no_trouble_and_no_camera_is_an_error() -> None:
    cameras, (camera, pixel) = make_cameras(torch.float32), pixels(3, torch.float32)
    assert len(pixel_rays(cameras, camera[:0], pixel[:0], "numba")) == 0
    for wrong in (-1, len(LENSES)):
        camera[1] = wrong
        with pytest.raises(IndexError, match="Camera indices must lie in 0 to 3"):
            pixel_rays(cameras, camera, pixel, "numba")
