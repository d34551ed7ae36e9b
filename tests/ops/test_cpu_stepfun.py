"""The CPU kernels of step functions: the reference's values and gradients on any histogram."""

from collections.abc import Callable

import pytest
import torch
from torch import Tensor

from plnerf.ops import cpu_stepfun, launch
from plnerf.rays import stepfun

DTYPES = pytest.mark.parametrize("dtype", [torch.float32, torch.float64], ids=str)
CASES = pytest.mark.parametrize(
    "case", ["random", "no weight", "all in one", "no width", "one interval", "same edges", "no rays"]
)


def histograms(case: str, intervals: int, seed: int, dtype: torch.dtype) -> tuple[Tensor, Tensor]:
    """Increasing edges in [0, 1] and weights that sum to less than 1, some of them zero."""
    generator = torch.Generator().manual_seed(seed)
    intervals = 1 if case == "one interval" else intervals
    rays = 0 if case == "no rays" else 60
    s = torch.rand(rays, intervals + 1, generator=generator, dtype=torch.float64).sort(-1).values
    w, keep = torch.rand(2, rays, intervals, generator=generator, dtype=torch.float64)
    w = w * (keep > 0.3)
    w = 0.9 * w / w.sum(-1, keepdim=True).clamp_min(1e-3)
    if case == "no weight":
        w.zero_()
    if case == "all in one":
        w.zero_()
        w[:, intervals // 3] = 1
    if case == "no width":
        s[:, 1 : intervals // 2] = s[:, 1:2]
        s[:, -4:] = s[:, -1:]
    if case == "same edges":
        s = (torch.arange(intervals + 1) / intervals).expand(rays, -1).double().contiguous()
    return s.to(dtype), w.to(dtype)


def with_gradient(loss: Callable[[Tensor], Tensor], w: Tensor) -> list[Tensor]:
    """The loss of every ray and its gradient by w, for random cotangents."""
    w = w.clone().requires_grad_()
    value = loss(w)
    cotangent = torch.randn(len(value), generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    return [value.detach(), *torch.autograd.grad(value, w, cotangent.to(w))]


def assert_close(found: list[Tensor], expected: list[Tensor], tolerance: float) -> None:
    for a, b in zip(found, expected, strict=True):
        assert a.dtype == b.dtype
        torch.testing.assert_close(a, b, atol=tolerance, rtol=tolerance)


def levels(case: str, count: int, dtype: torch.dtype) -> Tensor:
    rays = 0 if case == "no rays" else 60
    u = torch.rand(rays, count, generator=torch.Generator().manual_seed(9), dtype=torch.float64)
    return u.sort(-1).values.to(dtype)


@CASES
@DTYPES
@pytest.mark.parametrize("anneal", [1.0, 0.3])
def test_resampling_is_the_reference(case: str, dtype: torch.dtype, anneal: float) -> None:
    s, w = histograms(case, 37, 0, dtype)
    u = levels(case, 25, dtype)
    tolerance = 3e-5 if dtype == torch.float32 else 1e-12
    found = cpu_stepfun.resample_edges(s, w, u, 0.03, anneal)
    assert found.shape == u.shape
    assert_close([found], [stepfun.resample_edges(s, w, u, 0.03, anneal)], tolerance)
    assert bool((found.diff() >= 0).all())


def test_samples_carry_no_gradient_and_anneal_may_be_a_tensor() -> None:
    s, w = histograms("random", 16, 0, torch.float64)
    u = ((torch.arange(10, dtype=torch.float64) + 0.5) / 10).repeat(60, 1)
    found = cpu_stepfun.resample_edges(s, w.requires_grad_(), u, 0.01, torch.tensor(0.5))
    assert not found.requires_grad
    torch.testing.assert_close(found, stepfun.resample_edges(s, w.detach(), u, 0.01, 0.5))


def test_levels_at_the_ends_give_the_ends() -> None:
    s, w = histograms("random", 9, 0, torch.float64)
    u = torch.tensor([0.0, 1.0], dtype=torch.float64).expand(60, -1)
    torch.testing.assert_close(cpu_stepfun.resample_edges(s, w, u, 0.01), s[:, [0, -1]])


@DTYPES
def test_resampled_edges_are_increasing_and_inside_whatever_the_weights(dtype: torch.dtype) -> None:
    """All in one interval, nothing anywhere, tiny or even: strictly increasing, so no interval is empty."""
    s = (torch.arange(17) / 16).to(dtype).expand(4, -1)
    w = torch.zeros(4, 16, dtype=dtype)
    w[0, 5], w[1, :], w[2, :] = 1.0, 1e-30, 1 / 16
    for seed in range(20):
        generator = torch.Generator().manual_seed(seed)
        u = (torch.arange(25) + torch.rand(4, 25, generator=generator, dtype=dtype)) / 25
        edges = cpu_stepfun.resample_edges(s, w, u.to(dtype), 1e-5)
        assert bool((edges.diff() > 0).all())
        assert float(edges.min()) >= 0
        assert float(edges.max()) <= 1


@CASES
@pytest.mark.parametrize("proposal_intervals", [1, 24, 64])
def test_interlevel_loss_is_the_reference(case: str, proposal_intervals: int) -> None:
    s, w = histograms(case, 24, 2, torch.float64)
    other, w_other = histograms(case, proposal_intervals, 3, torch.float64)
    found, expected = (
        with_gradient(lambda w_other, of=of: of(s, w, other, w_other), w_other)
        for of in (cpu_stepfun.interlevel_loss, stepfun.interlevel_loss)
    )
    assert_close(found, expected, 1e-12)


@CASES
def test_interlevel_loss_in_single_precision_is_the_reference(case: str) -> None:
    """Weights are multiples of 2^-10, so that no bound is decided by rounding."""
    s, w = histograms(case, 24, 2, torch.float32)
    other, w_other = histograms(case, 64, 3, torch.float32)
    w, w_other = ((value * 1024).round() / 1024 for value in (w, w_other))
    found, expected = (
        with_gradient(lambda w_other, of=of: of(s, w, other, w_other), w_other)
        for of in (cpu_stepfun.interlevel_loss, stepfun.interlevel_loss)
    )
    assert_close(found, expected, 2e-5)


def test_interlevel_loss_is_zero_where_the_proposal_covers() -> None:
    s, w = histograms("random", 9, 6, torch.float64)
    assert float(cpu_stepfun.interlevel_loss(s, w, s, w).max()) < 1e-25
    assert float(cpu_stepfun.interlevel_loss(s, w, s, w * 1.3).max()) == 0


@CASES
@DTYPES
def test_distortion_loss_is_the_reference(case: str, dtype: torch.dtype) -> None:
    s, w = histograms(case, 37, 4, dtype)
    found, expected = (
        with_gradient(lambda w, of=of: of(s, w), w)
        for of in (cpu_stepfun.distortion_loss, stepfun.distortion_loss)
    )
    assert_close(found, expected, 3e-6 if dtype == torch.float32 else 1e-13)


def test_gradients_are_those_of_finite_differences() -> None:
    s, w = (value[:4] for value in histograms("random", 6, 5, torch.float64))
    other, w_other = (value[:4] for value in histograms("random", 9, 6, torch.float64))
    w = w + 0.05  # where a weight is 0 the loss has a kink of the width of rounding
    w_other = (w_other * 0.5).requires_grad_()
    assert torch.autograd.gradcheck(
        lambda w_other: cpu_stepfun.interlevel_loss(s, w, other, w_other), (w_other,)
    )
    assert torch.autograd.gradcheck(
        lambda w: cpu_stepfun.distortion_loss(s, w), (w.clone().requires_grad_(),)
    )


def test_losses_and_gradients_are_finite_for_tiny_and_huge_weights() -> None:
    s, w = histograms("random", 20, 7, torch.float32)
    for scale in (1e-38, 1e-20, 1.0, 1e15):
        losses: list[Callable[[Tensor], Tensor]] = [
            lambda v: cpu_stepfun.distortion_loss(s, v),
            lambda v: cpu_stepfun.interlevel_loss(s, w, s, v),
        ]
        for loss in losses:
            assert all(bool(value.isfinite().all()) for value in with_gradient(loss, w * scale))


def test_constants_stay_constants() -> None:
    s, w = histograms("random", 9, 6, torch.float64)
    other, w_other = histograms("random", 12, 7, torch.float64)
    w.requires_grad_()
    cpu_stepfun.interlevel_loss(s, w, other, w_other.requires_grad_()).sum().backward()
    assert w.grad is None
    assert w_other.grad is not None
    with pytest.raises(NotImplementedError, match="kernel of distortion_loss has no gradient by s"):
        cpu_stepfun.distortion_loss(s.requires_grad_(), w)


def test_strided_inputs_and_threads_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Bit for bit, on one thread or on several."""
    given = [*histograms("random", 24, 2, torch.float32), *histograms("random", 64, 3, torch.float32)]
    u = levels("random", 25, torch.float32)

    def run(s: Tensor, w: Tensor, other: Tensor, w_other: Tensor, u: Tensor) -> list[Tensor]:
        return [
            *with_gradient(lambda w_other: cpu_stepfun.interlevel_loss(s, w, other, w_other), w_other),
            *with_gradient(lambda w: cpu_stepfun.distortion_loss(s, w), w),
            cpu_stepfun.resample_edges(s, w, u, 0.03, 0.5),
        ]

    alone = run(*given, u)
    strided = run(*(value.t().contiguous().t() for value in (*given, u)))
    assert all(torch.equal(a, b) for a, b in zip(strided, alone, strict=True))
    monkeypatch.setattr(launch, "_WORTH_WAKING_NS", 0)
    for parts in (2, 7):
        monkeypatch.setattr(launch, "num_threads", lambda parts=parts: parts)
        assert all(torch.equal(a, b) for a, b in zip(run(*given, u), alone, strict=True))
