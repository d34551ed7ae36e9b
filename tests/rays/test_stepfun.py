"""Step functions: resampling keeps the distribution, bounds and losses are those of brute force."""

import numpy as np
import pytest
import torch
from tests.support import numpy_reference
from torch import Tensor

from plnerf.rays.stepfun import (
    distortion_loss,
    even_edges,
    interlevel_loss,
    interpolate,
    outer_measure,
    resample_edges,
    stratified_levels,
)

LIKE = torch.zeros(0, dtype=torch.float64)


def histograms(rays: int, intervals: int, seed: int) -> tuple[Tensor, Tensor]:
    """Random increasing edges in [0, 1] and weights that sum to less than 1, some of them zero."""
    generator = torch.Generator().manual_seed(seed)
    s = torch.rand(rays, intervals + 1, generator=generator, dtype=torch.float64).sort(-1).values
    w = torch.rand(rays, intervals, generator=generator, dtype=torch.float64)
    w = w * (torch.rand(rays, intervals, generator=generator, dtype=torch.float64) > 0.3)
    return s, 0.9 * w / w.sum(-1, keepdim=True).clamp_min(1e-3)


def test_even_edges_are_even() -> None:
    s = even_edges(3, 8, None, LIKE)
    torch.testing.assert_close(s, (torch.arange(9, dtype=torch.float64) / 8).expand(3, -1))


def test_jittered_edges_keep_their_order_their_mean_and_their_stratum() -> None:
    n = 8
    s = even_edges(20_000, n, torch.Generator().manual_seed(0), LIKE)
    even = even_edges(1, n, None, LIKE)
    assert bool((s.diff() >= 0).all())
    assert float(s.min()) == 0  # what would leave [0, 1] is clamped
    assert float(s.max()) == 1
    assert float((s - even).abs().max()) <= 0.5 / n
    assert float((s - even).abs()[:, 1:-1].max()) > 0.49 / n
    # Uniform in one interval: a standard error of the mean of 1/(n sqrt(12 * 20000)) = 2.6e-4.
    torch.testing.assert_close(s.mean(0)[1:-1], even[0, 1:-1], atol=1e-3, rtol=0)
    assert torch.equal(s, even_edges(20_000, n, torch.Generator().manual_seed(0), LIKE))


@pytest.mark.parametrize("seed", [None, 3], ids=["deterministic", "jittered"])
def test_resampling_keeps_the_distribution(seed: int | None) -> None:
    """Of many edges, each source interval gets its share, within one edge at either end."""
    s, w = histograms(6, 10, seed=0)
    n = 20_000
    generator = None if seed is None else torch.Generator().manual_seed(seed)
    edges = resample_edges(s, w, stratified_levels(6, n + 1, generator, s), padding=1e-3)
    assert bool((edges.diff() >= 0).all())
    share = (w + 1e-3) / (w + 1e-3).sum(-1, keepdim=True)
    for ray in range(len(s)):
        counts, _ = np.histogram(edges[ray], bins=s[ray])
        np.testing.assert_allclose(counts / (n + 1), share[ray], atol=3 / n)


def test_resampling_is_uniform_within_an_interval() -> None:
    s = torch.tensor([[0.2, 0.4, 0.8]], dtype=torch.float64)
    w = torch.tensor([[1.0, 0.0]], dtype=torch.float64)
    edges = resample_edges(s, w, stratified_levels(1, 1001, None, s), padding=0.01)
    inside = edges[edges < 0.4]
    assert len(inside) == pytest.approx(1001 * 1.01 / 1.02, abs=1)
    torch.testing.assert_close(
        inside.diff(), torch.full((len(inside) - 1,), float(inside.diff()[0])).double()
    )


def test_resampling_without_a_generator_repeats_itself() -> None:
    s, w = histograms(5, 7, seed=1)

    def resampled(generator: torch.Generator | None) -> torch.Tensor:
        return resample_edges(s, w, stratified_levels(5, 10, generator, s))

    assert torch.equal(resampled(None), resampled(None))
    a, b = (resampled(torch.Generator().manual_seed(seed)) for seed in (0, 1))
    assert not torch.equal(a, b)


def test_annealing_flattens_the_weights() -> None:
    s, w = histograms(5, 7, seed=1)
    u = stratified_levels(5, 10, None, s)
    torch.testing.assert_close(resample_edges(s, w, u, 0.01, 0.3), resample_edges(s, w**0.3, u, 0.01))


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64], ids=str)
def test_resampled_edges_are_increasing_and_inside_whatever_the_weights(dtype: torch.dtype) -> None:
    """All in one interval, nothing anywhere, tiny or even: strictly increasing, so no interval is empty."""
    s = even_edges(4, 16, None, LIKE).to(dtype).contiguous()
    w = torch.zeros(4, 16, dtype=dtype)
    w[0, 5], w[1, :], w[2, :] = 1.0, 1e-30, 1 / 16
    for seed in range(20):
        u = stratified_levels(4, 25, torch.Generator().manual_seed(seed) if seed else None, s)
        edges = resample_edges(s, w, u)
        assert edges.dtype == dtype
        assert edges.shape == (4, 25)
        assert bool((edges.diff() > 0).all())
        assert float(edges.min()) >= 0
        assert float(edges.max()) <= 1


def test_interpolation_passes_through_its_points_and_inverts_itself() -> None:
    xs, _ = histograms(4, 6, seed=2)
    ys, _ = histograms(4, 6, seed=3)
    torch.testing.assert_close(interpolate(xs, xs, ys), ys)
    x = torch.linspace(0, 1, 50, dtype=torch.float64).expand(4, -1).contiguous()
    for ray in range(4):
        truth = np.interp(x[ray], xs[ray], ys[ray])
        np.testing.assert_allclose(interpolate(x, xs, ys)[ray], truth, atol=1e-12)
    inside = x.clamp(xs[:, :1], xs[:, -1:])
    torch.testing.assert_close(interpolate(interpolate(inside, xs, ys), ys, xs), inside)


@pytest.mark.parametrize("shared", [False, True], ids=["own edges", "shared edges"])
def test_outer_measure_is_brute_force(shared: bool) -> None:
    s, _ = histograms(8, 9, seed=4)
    other, w = histograms(8, 12, seed=5)
    if shared:
        other[:, 2:7] = s[:, 3:8]
        other = other.sort(-1).values
    truth = [numpy_reference.outer_measure(*(v[ray].numpy() for v in (s, other, w))) for ray in range(8)]
    np.testing.assert_allclose(outer_measure(s, other, w), np.array(truth), atol=1e-12)


def test_interlevel_loss_is_zero_where_the_proposal_covers() -> None:
    s, w = histograms(8, 9, seed=6)
    assert float(interlevel_loss(s, w, s, w).max()) < 1e-25
    assert float(interlevel_loss(s, w, s, w * 1.3).max()) == 0
    coarse = torch.stack([torch.zeros(8), torch.ones(8)], -1).double()
    assert float(interlevel_loss(s, w, coarse, torch.full((8, 1), 0.95).double()).max()) == 0


def test_interlevel_loss_is_the_sum_over_what_is_uncovered() -> None:
    s, w = histograms(8, 9, seed=6)
    other, w_other = histograms(8, 12, seed=7)
    found = interlevel_loss(s, w, other, w_other)
    for ray in range(8):
        bound = numpy_reference.outer_measure(*(v[ray].numpy() for v in (s, other, w_other)))
        excess = np.maximum(0, w[ray].numpy() - bound)
        truth = sum(e**2 / v for e, v in zip(excess, w[ray].tolist(), strict=True) if v > 0)
        assert float(found[ray]) == pytest.approx(truth, rel=1e-9)
        assert truth > 0


def test_interlevel_loss_trains_the_proposal_only() -> None:
    s, w = (value.requires_grad_() for value in histograms(8, 9, seed=6))
    other, w_other = histograms(8, 12, seed=7)
    w_other.requires_grad_()
    interlevel_loss(s, w, other, w_other).sum().backward()
    assert s.grad is None
    assert w.grad is None
    assert w_other.grad is not None
    assert float(w_other.grad.max()) < 1e-12  # more weight never costs anything
    assert float(w_other.grad.min()) < 0


def test_distortion_loss_is_the_double_sum() -> None:
    s, w = histograms(8, 11, seed=8)
    truth = [numpy_reference.distortion(s[ray].numpy(), w[ray].numpy()) for ray in range(8)]
    np.testing.assert_allclose(distortion_loss(s, w), truth, rtol=1e-10)


def test_distortion_loss_is_blind_to_a_shift_and_scales() -> None:
    s, w = histograms(8, 11, seed=9)
    loss = distortion_loss(s, w)
    torch.testing.assert_close(distortion_loss(s + 3.5, w), loss)
    torch.testing.assert_close(distortion_loss(2.5 * s, 0.3 * w), 2.5 * 0.3**2 * loss)


def test_distortion_loss_is_least_where_the_weight_is_in_one_place() -> None:
    s = even_edges(1, 10, None, LIKE)
    one = torch.zeros(1, 10, dtype=torch.float64)
    one[0, 4] = 1
    near, far = torch.zeros_like(one), torch.zeros_like(one)
    near[0, 4:6] = 0.5
    far[0, [1, 8]] = 0.5
    losses = [float(distortion_loss(s, w)) for w in (one, near, far)]
    assert losses == sorted(losses)
    assert losses[0] == pytest.approx(0.1 / 3)
