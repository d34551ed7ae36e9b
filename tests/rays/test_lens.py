"""The lens backwards: exact where the lens is invertible, at its edge where it is not."""

import cv2
import numpy as np
import pytest
import torch
from torch import Tensor

from plnerf.rays.lens import undistort_plane
from plnerf.scene.cameras import distort

LENSES = {  # k1 k2 p1 p2 k3
    "none": [0.0] * 5,
    "action camera": [-0.28, 0.09, 8e-4, -6e-4, -0.012],
    "pincushion": [0.3, 0.2, 0.0, 0.0, 0.0],
    "crooked": [-0.1, 0.02, 0.02, -0.015, 0.0],
    "mild": [-0.05, 0.01, 1e-4, 2e-4, 0.0],
}
EACH = pytest.mark.parametrize("lens", LENSES, ids=str)
FOCAL_PX = 800.0


def image_plane(extent: float = 0.9) -> Tensor:
    """Points over an image as wide as `extent` focal lengths to each side."""
    x = torch.linspace(-extent, extent, 21, dtype=torch.float64)
    return torch.cartesian_prod(x, x * 0.6)


def coefficients(lens: list[float], like: Tensor) -> Tensor:
    return torch.tensor(lens, dtype=like.dtype).expand(len(like), -1)


@EACH
def test_it_is_the_inverse(lens: str) -> None:
    """To a millionth of a pixel, at the corners too."""
    d = image_plane()
    k = coefficients(LENSES[lens], d)
    torch.testing.assert_close(distort(undistort_plane(d, k), k), d, atol=1e-6 / FOCAL_PX, rtol=0)
    torch.testing.assert_close(undistort_plane(distort(d, k), k), d, atol=1e-6 / FOCAL_PX, rtol=0)


@EACH
def test_it_is_opencv_s(lens: str) -> None:
    d = image_plane()
    limits = (cv2.TERM_CRITERIA_MAX_ITER | cv2.TERM_CRITERIA_EPS, 300, 1e-13)
    truth = cv2.undistortPoints(d.numpy()[:, None], np.eye(3), np.array(LENSES[lens]), criteria=limits)
    found = undistort_plane(d, coefficients(LENSES[lens], d))
    np.testing.assert_allclose(found.numpy(), truth[:, 0], atol=1e-6 / FOCAL_PX)


def test_without_distortion_nothing_moves() -> None:
    d = image_plane(5.0)
    assert torch.equal(undistort_plane(d, torch.zeros(len(d), 5, dtype=torch.float64)), d)


def test_single_precision_comes_and_goes() -> None:
    d = image_plane().float()
    k = coefficients(LENSES["action camera"], d)
    found = undistort_plane(d, k)
    assert found.dtype == torch.float32
    torch.testing.assert_close(found, undistort_plane(d.double(), k.double()).float())


def test_beyond_the_fold_the_edge_of_the_invertible_part_is_given() -> None:
    """r (1 - r^2/2) grows up to r = sqrt(2/3) only, where it is 0.544: nothing is seen beyond."""
    edge, reach = (2 / 3) ** 0.5, (2 / 3) ** 1.5
    size = torch.cat([torch.linspace(0.01, 0.99, 40) * reach, torch.linspace(1.01, 20, 40) * reach]).double()
    direction = torch.tensor([0.8, -0.6], dtype=torch.float64)
    d = size[:, None] * direction
    k = coefficients([-0.5, 0.0, 0.0, 0.0, 0.0], d)
    found = undistort_plane(d, k)
    torch.testing.assert_close(distort(found, k)[:40], d[:40], atol=1e-9, rtol=0)
    radius = found @ direction
    assert bool((radius <= edge).all())
    assert bool((radius[40:] > 0.8 * edge).all())
    torch.testing.assert_close(found, radius[:, None] * direction)
