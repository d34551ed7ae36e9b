"""Volume rendering: weights are probabilities, closed forms hold, the float range is finite."""

import math

import numpy as np
import pytest
import torch
from tests.support import numpy_reference
from torch import Tensor

from plnerf.render.volume import (
    accumulation,
    composite,
    depth_deviation,
    expected_depth,
    median_depth,
    weights_from_density,
)

BATCHES = pytest.mark.parametrize("batch", [(), (5,), (2, 3)], ids=str)


def rays(batch: tuple[int, ...], intervals: int, seed: int = 0) -> tuple[Tensor, Tensor]:
    """Densities, some zero, and increasing edges of uneven intervals."""
    generator = torch.Generator().manual_seed(seed)
    sigma = 3 * torch.rand(*batch, intervals, generator=generator, dtype=torch.float64)
    sigma = sigma * (torch.rand(*batch, intervals, generator=generator, dtype=torch.float64) > 0.2)
    steps = torch.rand(*batch, intervals + 1, generator=generator, dtype=torch.float64) + 0.01
    return sigma, steps.cumsum(-1)


def attenuation(sigma: float, edges: Tensor) -> tuple[Tensor, Tensor]:
    """Weights of a ray through constant density."""
    return weights_from_density(torch.full_like(edges[:-1], sigma), edges), edges


@BATCHES
def test_weights_are_those_of_marching_along_the_ray(batch: tuple[int, ...]) -> None:
    sigma, t = rays(batch, 7)
    w = weights_from_density(sigma, t)
    for index in np.ndindex(*batch):
        truth = numpy_reference.weights(sigma[index].numpy(), t[index].numpy())
        np.testing.assert_allclose(w[index], truth, atol=1e-14)


@BATCHES
def test_weights_sum_to_what_the_ray_loses(batch: tuple[int, ...]) -> None:
    sigma, t = rays(batch, 7)
    total = accumulation(weights_from_density(sigma, t))
    torch.testing.assert_close(total, 1 - torch.exp(-(sigma * t.diff()).sum(-1)))


@BATCHES
def test_splitting_an_interval_changes_nothing(batch: tuple[int, ...]) -> None:
    sigma, t = rays(batch, 7)
    w = weights_from_density(sigma, t)
    for i in range(7):
        middle = t[..., i : i + 1] + 0.3 * t.diff()[..., i : i + 1]
        t2 = torch.cat([t[..., : i + 1], middle, t[..., i + 1 :]], -1)
        sigma2 = torch.cat([sigma[..., : i + 1], sigma[..., i:]], -1)
        w2 = weights_from_density(sigma2, t2)
        torch.testing.assert_close(w2[..., i] + w2[..., i + 1], w[..., i])
        others = torch.cat([w2[..., :i], w2[..., i + 2 :]], -1)
        torch.testing.assert_close(others, torch.cat([w[..., :i], w[..., i + 1 :]], -1))
        torch.testing.assert_close(median_depth(w2, t2), median_depth(w, t))


def test_constant_density_is_the_exponential_law() -> None:
    edges = torch.linspace(0, 4, 41, dtype=torch.float64)
    w, _ = attenuation(0.8, edges)
    torch.testing.assert_close(w, torch.exp(-0.8 * edges[:-1]) - torch.exp(-0.8 * edges[1:]))


def test_infinite_density_stops_the_ray() -> None:
    sigma = torch.tensor([0.5, math.inf, 0.5, math.inf], requires_grad=True)
    t = torch.tensor([1.0, 2.0, 3.0, 4.0, 5.0])
    w = weights_from_density(sigma, t)
    assert w[0].item() == pytest.approx(1 - math.exp(-0.5))
    assert accumulation(w).item() == pytest.approx(1)
    assert w[2:].tolist() == [0, 0]
    w.sum().backward()
    assert sigma.grad is not None
    assert bool(sigma.grad.isfinite().all())


def test_weights_and_gradients_are_finite_over_the_float_range() -> None:
    values = torch.cat([torch.zeros(1), torch.logspace(-30, 30, 61)])
    sigma = torch.stack(torch.meshgrid(values, values, values, indexing="ij"), -1).flatten(0, 2)
    sigma.requires_grad_()
    t = torch.tensor([0.05, 0.3, 1.0, 1000.0]).expand(len(sigma), -1)
    w = weights_from_density(sigma, t)
    depth, median = expected_depth(w, t), median_depth(w, t)
    assert bool(((w >= 0) & (w <= 1)).all())
    for out in (w, depth, median):
        assert bool(out.isfinite().all())
        (gradient,) = torch.autograd.grad(out.sum(), sigma, retain_graph=True)
        assert bool(gradient.isfinite().all())


def test_optical_depth_is_summed_in_single_precision() -> None:
    """2000 intervals of 0.001: in half precision the sum would stand still at 1."""
    sigma, t = torch.full((1, 2000), 1e-3, dtype=torch.float16), torch.arange(2001.0)[None].half()
    w = weights_from_density(sigma, t)
    assert w.dtype == torch.float32
    assert accumulation(w).item() == pytest.approx(1 - math.exp(-2), rel=1e-3)


@BATCHES
def test_composite_is_the_weighted_sum(batch: tuple[int, ...]) -> None:
    sigma, t = rays(batch, 7)
    w = weights_from_density(sigma, t)
    value = torch.rand(*batch, 7, 3, generator=torch.Generator().manual_seed(2), dtype=torch.float64)
    found = composite(w, value)
    for index in np.ndindex(*batch):
        np.testing.assert_allclose(found[index], w[index].numpy() @ value[index].numpy())


@BATCHES
def test_depths_lie_on_the_ray(batch: tuple[int, ...]) -> None:
    sigma, t = rays(batch, 7)
    for scale in (0.0, 1e-9, 1e-3, 1.0, 1e9):
        w = weights_from_density(sigma * scale, t)
        for depth in (expected_depth(w, t), median_depth(w, t)):
            assert bool(((depth >= t[..., 0]) & (depth <= t[..., -1])).all())


def test_expected_depth_of_constant_density() -> None:
    """1/sigma behind the first edge, on a ray that is fine and long; of one interval it is the middle."""
    w, t = attenuation(2.0, torch.linspace(1, 31, 30_001, dtype=torch.float64))
    assert expected_depth(w, t).item() == pytest.approx(1.5, rel=1e-6)
    w, t = attenuation(2.0, torch.tensor([1.0, 4.0]))
    assert expected_depth(w, t).item() == pytest.approx(2.5)


@pytest.mark.parametrize("intervals", [1, 3, 100])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64], ids=str)
def test_median_depth_of_constant_density_is_the_half_life(intervals: int, dtype: torch.dtype) -> None:
    """log 2 / sigma behind the first edge, however coarse the intervals."""
    w, t = attenuation(0.7, torch.linspace(2, 12, intervals + 1, dtype=dtype))
    assert median_depth(w, t).item() == pytest.approx(2 + math.log(2) / 0.7, rel=1e-4)


def test_median_depth_of_one_opaque_interval_is_its_near_side() -> None:
    t = torch.tensor([1.0, 2.0, 3.0, 4.0])
    w = weights_from_density(torch.tensor([0.0, 1e9, 5.0]), t)
    assert median_depth(w, t).item() == pytest.approx(2.0, abs=0.05)


def test_median_depth_is_the_far_end_where_half_the_ray_gets_through() -> None:
    w, t = attenuation(0.1, torch.linspace(1, 6, 11))
    assert accumulation(w).item() < 0.5
    assert median_depth(w, t).item() == 6


def test_the_deviation_is_that_of_an_even_interval_and_of_two_surfaces() -> None:
    t = torch.tensor([1.0, 2.0, 4.0, 4.001, 9.0, 9.001], dtype=torch.float64)
    even = depth_deviation(torch.tensor([0.0, 0.7, 0.0, 0.0, 0.0], dtype=torch.float64), t)
    assert even.item() == pytest.approx(2 / math.sqrt(12))
    two = depth_deviation(torch.tensor([0.0, 0.0, 0.2, 0.0, 0.6], dtype=torch.float64), t)
    assert two.item() == pytest.approx(5 * math.sqrt(0.25 * 0.75), rel=1e-6)
    assert depth_deviation(torch.zeros(5, dtype=torch.float64), t).item() == 0


@BATCHES
def test_the_deviation_is_that_of_places_drawn_by_their_weights(batch: tuple[int, ...]) -> None:
    sigma, t = rays(batch, 7)
    w, generator = weights_from_density(sigma, t), np.random.default_rng(0)
    found, moved = depth_deviation(w, t), depth_deviation(w, t + 40)
    torch.testing.assert_close(moved, found)
    for index in np.ndindex(*batch):
        share, edges = w[index].numpy(), t[index].numpy()
        interval = generator.choice(7, 200_000, p=share / share.sum())
        drawn = edges[interval] + generator.random(200_000) * np.diff(edges)[interval]
        assert found[index].item() == pytest.approx(drawn.std(), rel=0.01)
