"""Blur and dilation of histograms: mass is kept, brute force agrees, gradients go the right way."""

import numpy as np
import pytest
import torch
from tests.support import numpy_reference
from torch import Tensor

from plnerf.rays.histograms import FLOOR, blurred_interlevel_loss, blurred_weights, dilate
from plnerf.rays.stepfun import even_edges, interlevel_loss, interpolate, resample_edges, stratified_levels

LIKE = torch.zeros(0, dtype=torch.float64)
WIDTHS = pytest.mark.parametrize("h", [1e-4, 0.003, 0.03, 0.7])


def histograms(rays: int, intervals: int, seed: int) -> tuple[Tensor, Tensor]:
    """Random increasing edges in [0, 1] and weights that sum to 0.9, some of them zero."""
    generator = torch.Generator().manual_seed(seed)
    s = torch.rand(rays, intervals + 1, generator=generator, dtype=torch.float64).sort(-1).values
    w = torch.rand(rays, intervals, generator=generator, dtype=torch.float64)
    w = w * (torch.rand(rays, intervals, generator=generator, dtype=torch.float64) > 0.3)
    return s, 0.9 * w / w.sum(-1, keepdim=True).clamp_min(1e-3)


def everywhere(rays: int, count: int) -> Tensor:
    return torch.linspace(-1, 2, count, dtype=torch.float64).expand(rays, -1)


@WIDTHS
def test_blur_keeps_the_weight_and_its_middle(h: float) -> None:
    """A box of any width: the total weight stays, and so does the mean place."""
    s, w = histograms(6, 12, seed=0)
    edges = everywhere(6, 30_001)
    blurred = blurred_weights(s, w, edges, h)
    assert float(blurred.min()) >= 0
    torch.testing.assert_close(blurred.sum(-1), w.sum(-1))
    centre = (w * (s[:, 1:] + s[:, :-1]) / 2).sum(-1)
    torch.testing.assert_close(
        (blurred * (edges[:, 1:] + edges[:, :-1]) / 2).sum(-1), centre, atol=1e-8, rtol=0
    )


@WIDTHS
def test_blur_is_brute_force(h: float) -> None:
    s, w = histograms(4, 9, seed=1)
    edges, _ = histograms(4, 14, seed=2)
    found = blurred_weights(s, w, edges, h)
    for ray in range(4):
        truth = numpy_reference.blurred(*(v[ray].numpy() for v in (s, w, edges)), h)
        np.testing.assert_allclose(found[ray], truth, atol=1e-9)


def test_no_blur_resamples_the_step_function_and_little_blur_is_close_to_it() -> None:
    s, w = histograms(6, 12, seed=0)
    edges, _ = histograms(6, 20, seed=1)
    below = torch.nn.functional.pad(w.cumsum(-1), (1, 0))
    plain = interpolate(edges, s, below).diff()
    torch.testing.assert_close(blurred_weights(s, w, edges, 0.0), plain)
    densest = (w / s.diff()).amax(-1, keepdim=True)
    for h in (1e-2, 1e-4, 1e-6):  # each end of an interval is passed by what is within h
        off = (blurred_weights(s, w, edges, h) - plain).abs()
        assert bool((off <= h * densest + 1e-9).all())


def test_blur_in_single_precision_is_that_in_double() -> None:
    s, w = histograms(6, 12, seed=0)
    edges, _ = histograms(6, 20, seed=1)
    for h in (1e-4, 0.03):
        single = (value.float() for value in (s, w, edges))
        rounded = (value.float().double() for value in (s, w, edges))
        found = blurred_weights(*single, h)
        assert found.dtype == torch.float32
        torch.testing.assert_close(found.double(), blurred_weights(*rounded, h), atol=1e-7, rtol=0)


def test_blurred_loss_is_zero_where_the_proposal_has_enough_and_only_there() -> None:
    s, w = histograms(8, 9, seed=6)
    other, _ = histograms(8, 12, seed=7)
    enough = blurred_weights(s, w, other, 0.03)
    assert not blurred_interlevel_loss(s, w, other, enough, 0.03).any()
    assert not blurred_interlevel_loss(s, w, other, 1.5 * enough + 0.01, 0.03).any()
    lacking = 0.5 * enough
    expected = (lacking**2 / (lacking + FLOOR)).sum(-1)
    torch.testing.assert_close(blurred_interlevel_loss(s, w, other, lacking, 0.03), expected)
    assert bool((expected > 0).all())


def test_blurred_loss_trains_the_proposal_only_and_is_differentiated_right() -> None:
    s, w = (value.requires_grad_() for value in histograms(4, 9, seed=6))
    other, v = histograms(4, 12, seed=7)
    v = (v + 0.01).requires_grad_()
    other.requires_grad_()
    blurred_interlevel_loss(s, w, other, v, 0.03).sum().backward()
    assert s.grad is None
    assert w.grad is None
    assert other.grad is None
    assert v.grad is not None
    assert float(v.grad.max()) <= 0
    assert float(v.grad.min()) < 0
    assert torch.autograd.gradcheck(
        lambda v: blurred_interlevel_loss(s.detach(), w.detach(), other.detach(), v, 0.03), (v,)
    )


def test_a_proposal_that_sees_nothing_of_a_wire_has_a_gradient_that_does_not_vanish() -> None:
    """By the logarithm of its weight, which is what a density field is moved by: with Mip-NeRF 360's bound it
    is as small as the weight itself.
    """
    s = even_edges(1, 64, None, LIKE)
    w = torch.zeros(1, 64, dtype=torch.float64)
    w[0, 20] = 0.5
    log_v = torch.full((1, 64), -10.0, dtype=torch.float64, requires_grad=True)
    loss = blurred_interlevel_loss(s, w, s, log_v.exp(), 0.003).sum()
    (gradient,) = torch.autograd.grad(loss, log_v)
    assert float(gradient[0, 20]) < -1
    assert not gradient[0, :19].any()
    assert not gradient[0, 22:].any()
    (of_bound,) = torch.autograd.grad(interlevel_loss(s, w, s, log_v.exp()).sum(), log_v)
    assert float(of_bound.abs().max()) < 1e-3


@pytest.mark.parametrize("h", [1e-3, 0.02, 0.3, 5.0])
def test_dilation_is_brute_force(h: float) -> None:
    s, w = histograms(5, 13, seed=3)
    found = dilate(s, w, h)
    for ray in range(5):
        truth = numpy_reference.dilated(s[ray].numpy(), w[ray].numpy(), h)
        np.testing.assert_allclose(found[ray], truth * w[ray].sum().item() / truth.sum(), atol=1e-12)


@pytest.mark.parametrize("intervals", [1, 2, 3, 8, 33])
def test_dilation_keeps_the_weight_and_grows_what_is_beside_a_peak(intervals: int) -> None:
    s, w = histograms(7, intervals, seed=4)
    w[0] = 0
    for h in (1e-12, 0.01, 2.0):
        found = dilate(s, w, h)
        torch.testing.assert_close(found.sum(-1), w.sum(-1))
        assert bool((found >= 0).all())
    torch.testing.assert_close(dilate(s, w, 1e-12), w, atol=1e-7, rtol=0)
    # Beyond the length of the ray all is as dense as the densest place.
    even = w.sum(-1, keepdim=True) * s.diff() / (s[:, -1:] - s[:, :1])
    torch.testing.assert_close(dilate(s, w, 2.0), even)


def test_dilation_before_it_is_scaled_never_takes_weight_away() -> None:
    s, w = histograms(7, 20, seed=5)
    found = dilate(s, w, 0.02)
    scale = found.sum(-1) / torch.tensor([
        numpy_reference.dilated(s[ray].numpy(), w[ray].numpy(), 0.02).sum() for ray in range(7)
    ])
    assert bool((found / scale[:, None] >= w - 1e-12).all())
    beside = torch.zeros(1, 10, dtype=torch.float64)
    beside[0, 4] = 1
    found = dilate(even_edges(1, 10, None, LIKE), beside, 0.05)[0]
    torch.testing.assert_close(found[3:6], torch.tensor([0.25, 0.5, 0.25], dtype=torch.float64))
    assert not found[[0, 1, 2, 6, 7, 8, 9]].any()


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64], ids=str)
def test_dilation_is_finite_for_intervals_of_no_width_and_any_weight(dtype: torch.dtype) -> None:
    s, w = histograms(4, 16, seed=8)
    s[:, 3:7], s[:, -3:] = s[:, 3:4], s[:, -1:]
    w[1], w[2] = 0, 1e-38
    s, w = s.to(dtype), w.to(dtype)
    found = dilate(s, w, 0.01)
    assert bool(found.isfinite().all())
    torch.testing.assert_close(found.sum(-1), w.sum(-1))


@pytest.mark.parametrize("scale", [0.0, 1e-38, 1e-20, 1.0, 1.5])
def test_losses_and_gradients_are_finite_whatever_the_weights(scale: float) -> None:
    s, w = (value.float() for value in histograms(5, 9, seed=2))
    v = (w * scale).requires_grad_()
    loss = blurred_interlevel_loss(s, w, s, v, 0.003)
    (gradient,) = torch.autograd.grad(loss.sum(), v)
    assert bool(loss.isfinite().all())
    assert bool(gradient.isfinite().all())


def test_resampling_after_dilation_looks_beside_a_peak() -> None:
    s = even_edges(1, 20, None, LIKE)
    w = torch.zeros(1, 20, dtype=torch.float64)
    w[0, 8] = 0.9
    u = stratified_levels(1, 400, None, s)

    def beside(w: Tensor) -> int:
        edges = resample_edges(s, w, u, 1e-3)
        return int(((edges > 0.35) & (edges < 0.5)).sum() - ((edges > 0.4) & (edges < 0.45)).sum())

    assert beside(dilate(s, w, 0.025)) > 10 * beside(w)
