"""The CPU kernels of blur and dilation: the reference's values and gradients on any histogram."""

import pytest
import torch
from tests.ops.test_cpu_stepfun import CASES, DTYPES, assert_close, histograms, with_gradient
from torch import Tensor

from plnerf.ops import cpu_histograms, launch
from plnerf.rays import histograms as truth

HALF_WIDTHS = pytest.mark.parametrize("h", [0.0, 1e-3, 0.03, 3.0])


@CASES
@DTYPES
@HALF_WIDTHS
@pytest.mark.parametrize("proposal_intervals", [1, 24, 64])
def test_blurred_loss_is_the_reference(
    case: str, dtype: torch.dtype, h: float, proposal_intervals: int
) -> None:
    """A proposal with next to nothing divides by the floor: relative tolerances."""
    s, w = histograms(case, 24, 2, dtype)
    other, v = histograms(case, proposal_intervals, 3, dtype)
    found, expected = (
        with_gradient(lambda v, of=of: of(s, w, other, v, h), v)
        for of in (cpu_histograms.blurred_interlevel_loss, truth.blurred_interlevel_loss)
    )
    tolerance = 1e-3 if dtype == torch.float32 else 1e-9
    scale = [max(1.0, float(value.abs().max())) if value.numel() else 1.0 for value in expected]
    assert_close(
        [value / size for value, size in zip(found, scale, strict=True)],
        [value / size for value, size in zip(expected, scale, strict=True)],
        tolerance,
    )


@CASES
@DTYPES
@pytest.mark.parametrize("h", [1e-6, 1e-3, 0.03, 3.0])
def test_dilation_is_the_reference(case: str, dtype: torch.dtype, h: float) -> None:
    s, w = histograms(case, 37, 4, dtype)
    found, expected = cpu_histograms.dilate(s, w, h), truth.dilate(s, w, h)
    assert_close([found], [expected], 2e-5 if dtype == torch.float32 else 1e-12)


def test_the_floor_is_the_references() -> None:
    assert cpu_histograms.FLOOR == truth.FLOOR


def test_gradients_are_those_of_finite_differences() -> None:
    s, w = (value[:4] for value in histograms("random", 6, 5, torch.float64))
    other, v = (value[:4] for value in histograms("random", 9, 6, torch.float64))
    v = (0.5 * v + 0.01).requires_grad_()
    assert torch.autograd.gradcheck(
        lambda v: cpu_histograms.blurred_interlevel_loss(s, w, other, v, 0.03), (v,)
    )


def test_constants_stay_constants() -> None:
    s, w = histograms("random", 9, 6, torch.float64)
    other, v = histograms("random", 12, 7, torch.float64)
    w.requires_grad_()
    cpu_histograms.blurred_interlevel_loss(s, w, other, v.requires_grad_(), 0.03).sum().backward()
    assert w.grad is None
    assert v.grad is not None
    assert not cpu_histograms.dilate(s, w, 0.01).requires_grad


@pytest.mark.parametrize("scale", [0.0, 1e-38, 1e-20, 1.0, 1.5])
def test_losses_and_gradients_are_finite_whatever_the_weights(scale: float) -> None:
    s, w = histograms("random", 20, 7, torch.float32)
    values = [
        *with_gradient(lambda v: cpu_histograms.blurred_interlevel_loss(s, w, s, v, 0.003), w * scale),
        cpu_histograms.dilate(s, w * scale, 0.003),
    ]
    assert all(bool(value.isfinite().all()) for value in values)


def test_strided_inputs_and_threads_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Bit for bit, on one thread or on several."""
    given = [*histograms("random", 24, 2, torch.float32), *histograms("random", 64, 3, torch.float32)]

    def run(s: Tensor, w: Tensor, other: Tensor, v: Tensor) -> list[Tensor]:
        blurred = cpu_histograms.blurred_interlevel_loss
        return [
            *with_gradient(lambda v: blurred(s, w, other, v, 0.03), v),
            cpu_histograms.dilate(s, w, 0.01),
        ]

    alone = run(*given)
    strided = run(*(value.t().contiguous().t() for value in given))
    assert all(torch.equal(a, b) for a, b in zip(strided, alone, strict=True))
    monkeypatch.setattr(launch, "_WORTH_WAKING_NS", 0)
    for parts in (2, 7):
        monkeypatch.setattr(launch, "num_threads", lambda parts=parts: parts)
        assert all(torch.equal(a, b) for a, b in zip(run(*given), alone, strict=True))
