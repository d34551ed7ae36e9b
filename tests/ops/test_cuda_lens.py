"""The Triton kernel of casting rays is the reference: interpreted on a CPU, or run on a GPU."""

import pytest
import torch
from tests.ops.test_cpu_lens import LENSES, fields, make_cameras, pixels

from plnerf.rays.rays import pixel_rays

DTYPES = pytest.mark.parametrize("dtype", [torch.float32, torch.float64], ids=str)


@DTYPES
@pytest.mark.parametrize("count", [0, 1, 300])
def test_rays_are_the_reference(count: int, dtype: torch.dtype, device: str) -> None:
    cameras, (camera, pixel) = make_cameras(dtype).to(device), pixels(count, dtype)
    camera, pixel = camera.to(device), pixel.to(device)
    truth = pixel_rays(cameras, camera, pixel)
    found = pixel_rays(cameras, camera, pixel, "triton")
    for a, b in zip(fields(found), fields(truth), strict=True):
        assert a.dtype == b.dtype
        tolerance = 1e-6 if dtype == torch.float32 else 1e-12
        torch.testing.assert_close(a, b, atol=tolerance, rtol=tolerance)


def test_a_camera_that_does_not_exist_has_no_rays(device: str) -> None:
    """The others' are not touched by it."""
    cameras, (camera, pixel) = make_cameras(torch.float32).to(device), pixels(5, torch.float32)
    camera[1], camera[3] = -1, len(LENSES)
    found = pixel_rays(cameras, camera.to(device), pixel.to(device), "triton")
    for value in fields(found)[:3]:
        lost = value.isnan().reshape(5, -1).all(1)
        assert lost.tolist() == [False, True, False, True, False]
        assert bool(value[~lost].isfinite().all())


def test_strided_inputs_and_gradients(device: str) -> None:
    cameras, (camera, pixel) = make_cameras(torch.float32).to(device), pixels(7, torch.float32)
    camera, pixel = camera.to(device), pixel.to(device)
    strided = pixel_rays(cameras, camera.repeat_interleave(2)[::2], pixel.t().contiguous().t(), "triton")
    for a, b in zip(fields(strided), fields(pixel_rays(cameras, camera, pixel, "triton")), strict=True):
        assert torch.equal(a, b)
    with pytest.raises(NotImplementedError, match="kernel of cast_rays has no gradient by pixel"):
        pixel_rays(cameras, camera, pixel.requires_grad_(), "triton")
