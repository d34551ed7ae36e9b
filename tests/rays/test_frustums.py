"""Frustums as Gaussians: moments are integrals over a cone, in any proportion and over the float range."""

import numpy as np
import pytest
import torch
from tests.support import numpy_reference

from plnerf.rays.frustums import Frustums, frustum_moments, ray_frustums
from plnerf.rays.rays import Rays

CONES = [  # t0, t1, radius
    (0.0, 1.0, 0.1),
    (0.0, 1e-3, 2.0),
    (0.5, 3.0, 0.3),
    (2.0, 2.1, 0.01),
    (1000.0, 1000.001, 1e-3),
    (7.0, 7.0, 0.5),
    (1e-4, 1e4, 1.0),
]


@pytest.mark.parametrize(("t0", "t1", "radius"), CONES, ids=str)
def test_moments_are_the_integrals_over_the_cone(t0: float, t1: float, radius: float) -> None:
    arguments = torch.tensor([[t0], [t1], [radius]], dtype=torch.float64)
    found = [float(value) for value in frustum_moments(*arguments)]
    np.testing.assert_allclose(found, numpy_reference.cone_moments(t0, t1, radius), rtol=1e-9)


@pytest.mark.parametrize(("t0", "t1", "radius"), CONES, ids=str)
def test_moments_hold_in_single_precision(t0: float, t1: float, radius: float) -> None:
    """From the float32 edges themselves: however thin the slice far out, no cancellation."""
    arguments = torch.tensor([[t0], [t1], [radius]])
    found = [float(value) for value in frustum_moments(*arguments)]
    truth = numpy_reference.cone_moments(*(float(value) for value in arguments))
    np.testing.assert_allclose(found, truth, rtol=1e-5)


def test_gaussian_is_that_of_points_in_the_cone() -> None:
    """Mean and full covariance, in scene axes, of points drawn uniformly in a slanted cone."""
    origin = np.array([0.3, -1.0, 2.0])
    direction = np.array([2.0, -1.0, 2.0]) / 3
    t0, t1, radius = 1.0, 2.5, 0.4
    rng = np.random.default_rng(0)
    n = 400_000
    t = np.cbrt(rng.uniform(t0**3, t1**3, n))  # density grows with the disc, as t^2
    r, angle = radius * t * np.sqrt(rng.uniform(size=n)), rng.uniform(0, 2 * np.pi, n)
    e1 = np.array([1.0, 2.0, 0.0]) / np.sqrt(5)  # across the direction
    e2 = np.cross(direction, e1)
    x = (
        origin
        + t[:, None] * direction
        + r[:, None] * (np.cos(angle)[:, None] * e1 + np.sin(angle)[:, None] * e2)
    )
    rays = Rays(
        torch.from_numpy(origin)[None], torch.from_numpy(direction)[None],
        torch.tensor([radius], dtype=torch.float64), torch.zeros(1, dtype=torch.long),
    )  # fmt: skip
    frustums = ray_frustums(rays, torch.tensor([[0.5, t0, t1]], dtype=torch.float64))
    assert frustums.mean.shape == (1, 2, 3)
    np.testing.assert_allclose(frustums.mean[0, 1], x.mean(0), atol=3e-3)
    np.testing.assert_allclose(frustums.covariance()[0, 1], np.cov(x.T), atol=1e-3)


def test_indexing_takes_rays_whole() -> None:
    generator = torch.Generator().manual_seed(0)
    mean, direction = torch.rand(2, 5, 4, 3, generator=generator)
    var_t, var_r = torch.rand(2, 5, 4, generator=generator)
    part = Frustums(mean, direction, var_t, var_r)[1:3]
    assert torch.equal(part.mean, mean[1:3])
    assert torch.equal(part.direction, direction[1:3])
    assert torch.equal(part.var_t, var_t[1:3])
    assert torch.equal(part.var_r, var_r[1:3])


def test_moments_and_gradients_are_finite_over_the_float_range() -> None:
    ends = torch.cat([torch.zeros(1), torch.logspace(-30, 17, 95)])
    t0, t1 = torch.meshgrid(ends, ends, indexing="ij")
    ordered = t0 <= t1
    t0, t1 = t0[ordered].requires_grad_(), t1[ordered].requires_grad_()
    radius = torch.full_like(t0, 1e-3).requires_grad_()
    t_mean, var_t, var_r = frustum_moments(t0, t1, radius)
    for value in (t_mean, var_t, var_r):
        assert bool(value.isfinite().all())
        assert bool((value >= 0).all())
        gradients = torch.autograd.grad(value.sum(), (t0, t1, radius), retain_graph=True, allow_unused=True)
        assert all(g is None or bool(g.isfinite().all()) for g in gradients)
    assert bool((t_mean >= t0 * (1 - 1e-6)).all())
    assert bool((t_mean <= t1 * (1 + 1e-6)).all())
