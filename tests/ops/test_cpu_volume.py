"""The CPU kernels of volume rendering: the reference's values and gradients, and the reference's laws."""

import math
from collections.abc import Callable

import pytest
import torch
from torch import Tensor

from plnerf.ops import launch
from plnerf.ops.cpu_volume import render_rays, weights_from_density
from plnerf.render import volume

DTYPES = pytest.mark.parametrize("dtype", [torch.float32, torch.float64], ids=str)
CASES = pytest.mark.parametrize(
    "case", ["random", "empty", "opaque", "thin", "no width", "one interval", "far away", "no rays"]
)
Render = Callable[[Tensor, Tensor, Tensor], tuple[Tensor, ...]]


def inputs(case: str, dtype: torch.dtype = torch.float64) -> tuple[Tensor, Tensor, Tensor]:
    """Densities (some zero), edges and colours of 50 rays."""
    generator = torch.Generator().manual_seed(0)
    rays, intervals = (0 if case == "no rays" else 50), (1 if case == "one interval" else 37)
    sigma, keep = torch.rand(2, rays, intervals, generator=generator, dtype=torch.float64)
    sigma = 3 * sigma * (keep > 0.2)
    steps = torch.rand(rays, intervals + 1, generator=generator, dtype=torch.float64) * 0.2 + 0.01
    sigma = sigma * {"empty": 0.0, "opaque": 1e9, "thin": 1e-7}.get(case, 1.0)
    if case == "no width":
        steps[:, ::2] = 0
        steps[:5] = 0
    t = steps.cumsum(-1) + (1e3 if case == "far away" else 0.0)
    colours = torch.rand(rays, intervals, 3, generator=generator, dtype=torch.float64)
    return sigma.to(dtype), t.to(dtype), colours.to(dtype)


def truth(sigma: Tensor, t: Tensor, colours: Tensor) -> tuple[Tensor, ...]:
    """As in PLNeRF.forward."""
    w = volume.weights_from_density(sigma, t)
    total = volume.accumulation(w)
    colour = volume.composite(w, colours) + (1 - total)[:, None] * colours[:, -1]
    still = w.detach()
    return w, colour, total, volume.expected_depth(still, t), volume.median_depth(still, t)


def with_gradients(
    render: Render, sigma: Tensor, t: Tensor, colours: Tensor, outputs: tuple[int, ...] = (0, 1, 2)
) -> list[Tensor]:
    """All outputs, and the gradients by density and colours of a random sum of some of them."""
    sigma, colours = sigma.clone().requires_grad_(), colours.clone().requires_grad_()
    found = render(sigma, t, colours)
    generator = torch.Generator().manual_seed(1)
    cotangents = [
        torch.randn(found[i].shape, generator=generator, dtype=torch.float64).to(t) for i in outputs
    ]
    gradients = torch.autograd.grad(
        [found[i] for i in outputs], [sigma, colours], cotangents, allow_unused=True
    )
    zero = (torch.zeros_like(sigma), torch.zeros_like(colours))
    return [
        *(v.detach() for v in found),
        *(z if g is None else g for g, z in zip(gradients, zero, strict=True)),
    ]


def assert_close(found: list[Tensor], expected: list[Tensor], tolerance: float) -> None:
    for a, b in zip(found, expected, strict=True):
        assert a.dtype == b.dtype
        scale = max(1.0, float(b.abs().max())) if b.numel() else 1.0
        torch.testing.assert_close(a, b, atol=tolerance * scale, rtol=0)


@CASES
@DTYPES
def test_rendering_is_the_reference(case: str, dtype: torch.dtype) -> None:
    sigma, t, colours = inputs(case, dtype)
    tolerance = 5e-6 if dtype == torch.float32 else 1e-13
    expected = with_gradients(truth, sigma, t, colours)
    assert_close(with_gradients(render_rays, sigma, t, colours), expected, tolerance)


@pytest.mark.parametrize("outputs", [(0,), (1,), (2,), (0, 2)], ids=str)
def test_each_output_has_the_truth_s_gradient_alone(outputs: tuple[int, ...]) -> None:
    given = inputs("random")
    expected = with_gradients(truth, *given, outputs=outputs)
    assert_close(with_gradients(render_rays, *given, outputs=outputs), expected, 1e-13)


@CASES
@DTYPES
def test_weights_are_the_reference(case: str, dtype: torch.dtype) -> None:
    sigma, t, colours = inputs(case, dtype)

    def weights(of: Callable[[Tensor, Tensor], Tensor]) -> list[Tensor]:
        return with_gradients(lambda sigma, t, _: (of(sigma, t),), sigma, t, colours, outputs=(0,))[:2]

    tolerance = 5e-6 if dtype == torch.float32 else 1e-13
    assert_close(weights(weights_from_density), weights(volume.weights_from_density), tolerance)


def test_gradients_are_those_of_finite_differences() -> None:
    sigma, t, colours = (value[:3, :5] for value in inputs("random"))
    t = inputs("random")[1][:3, :6]
    sigma, colours = sigma + 0.1, colours.clone()
    sigma.requires_grad_()
    colours.requires_grad_()
    assert torch.autograd.gradcheck(lambda sigma: weights_from_density(sigma, t), (sigma,))
    assert torch.autograd.gradcheck(lambda sigma, c: tuple(render_rays(sigma, t, c))[:3], (sigma, colours))


def test_weights_sum_to_what_the_ray_loses() -> None:
    sigma, t, colours = inputs("random")
    lost = 1 - torch.exp(-(sigma * t.diff()).sum(-1))
    torch.testing.assert_close(weights_from_density(sigma, t).sum(-1), lost)
    torch.testing.assert_close(render_rays(sigma, t, colours).accumulation, lost)


def test_splitting_an_interval_changes_nothing_that_is_seen() -> None:
    sigma, t, colours = inputs("random")
    whole = render_rays(sigma, t, colours)
    for i in (0, 20, 36):
        middle = t[:, i : i + 1] + 0.3 * t.diff()[:, i : i + 1]
        split = render_rays(
            torch.cat([sigma[:, : i + 1], sigma[:, i:]], -1),
            torch.cat([t[:, : i + 1], middle, t[:, i + 1 :]], -1),
            torch.cat([colours[:, : i + 1], colours[:, i:]], 1),
        )
        torch.testing.assert_close(split.w[:, i] + split.w[:, i + 1], whole.w[:, i])
        torch.testing.assert_close(split.colour, whole.colour)
        torch.testing.assert_close(split.accumulation, whole.accumulation)
        torch.testing.assert_close(split.depth_median, whole.depth_median)


def test_one_colour_everywhere_is_seen_everywhere() -> None:
    sigma, t, colours = inputs("random")
    colour = torch.tensor([0.2, 0.5, 0.9], dtype=torch.float64)
    torch.testing.assert_close(render_rays(sigma, t, colour.expand_as(colours)).colour, colour.expand(50, -1))


def test_infinite_density_stops_the_ray() -> None:
    sigma = torch.tensor([[0.5, math.inf, 0.5, math.inf]], requires_grad=True)
    t = torch.tensor([[1.0, 2.0, 3.0, 4.0, 5.0]])
    colours = torch.rand(1, 4, 3, generator=torch.Generator().manual_seed(0))
    out = render_rays(sigma, t, colours)
    assert out.w[0, 0].item() == pytest.approx(1 - math.exp(-0.5))
    assert out.accumulation.item() == pytest.approx(1)
    assert out.w[0, 2:].tolist() == [0, 0]
    (out.w.sum() + out.colour[:, 0].sum()).backward()
    assert sigma.grad is not None
    assert bool(sigma.grad.isfinite().all())


def test_outputs_and_gradients_are_finite_over_the_float_range() -> None:
    values = torch.cat([torch.zeros(1), torch.logspace(-30, 30, 61), torch.tensor([math.inf])])
    sigma = torch.stack(torch.meshgrid(values, values, values, indexing="ij"), -1).flatten(0, 2)
    t = torch.tensor([0.05, 0.3, 1.0, 1000.0]).expand(len(sigma), -1)
    colours = torch.rand(len(sigma), 3, 3, generator=torch.Generator().manual_seed(0))
    found = with_gradients(render_rays, sigma, t, colours)
    assert all(bool(value.isfinite().all()) for value in found)
    assert bool(((found[0] >= 0) & (found[0] <= 1)).all())
    for depth in found[3:5]:
        assert bool(((depth >= t[:, 0]) & (depth <= t[:, -1])).all())
    sigma.requires_grad_()
    w = weights_from_density(sigma, t)
    assert torch.equal(w, found[0])
    (gradient,) = torch.autograd.grad(w.sum(), sigma)
    assert bool(gradient.isfinite().all())


def test_not_a_number_is_not_hidden() -> None:
    sigma, t, colours = inputs("random", torch.float32)
    sigma[3, 5] = math.nan
    out = render_rays(sigma, t, colours)
    bad = torch.zeros(50, dtype=torch.bool)
    bad[3] = True
    assert torch.equal(out.colour.isnan().any(-1), bad)
    assert torch.equal(weights_from_density(sigma, t).isnan().any(-1), bad)


@pytest.mark.parametrize("intervals", [1, 3, 100])
@DTYPES
def test_median_depth_of_constant_density_is_the_half_life(intervals: int, dtype: torch.dtype) -> None:
    t = torch.linspace(2, 12, intervals + 1, dtype=dtype)[None]
    out = render_rays(torch.full_like(t[:, :-1], 0.7), t, torch.zeros(1, intervals, 3, dtype=dtype))
    assert out.depth_median.item() == pytest.approx(2 + math.log(2) / 0.7, rel=1e-4)


def test_depths_carry_no_gradient_and_others_refuse_a_second() -> None:
    sigma, t, colours = inputs("random")
    out = render_rays(sigma.requires_grad_(), t, colours)
    assert out.w.requires_grad
    assert out.colour.requires_grad
    assert out.accumulation.requires_grad
    assert not out.depth.requires_grad
    assert not out.depth_median.requires_grad
    (gradient,) = torch.autograd.grad(out.colour.square().sum(), sigma, create_graph=True)
    with pytest.raises(RuntimeError, match="once_differentiable"):
        gradient.sum().backward()
    with pytest.raises(NotImplementedError, match="kernel of render_rays has no gradient by t"):
        render_rays(sigma, t.requires_grad_(), colours)


def test_strided_inputs_agree() -> None:
    given = inputs("random", torch.float32)
    strided = [value.transpose(0, 1).contiguous().transpose(0, 1) for value in given]
    for a, b in zip(with_gradients(render_rays, *strided), with_gradients(render_rays, *given), strict=True):
        assert torch.equal(a, b)


def test_results_do_not_depend_on_the_number_of_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    """Bit for bit."""
    sigma, t, colours = inputs("random", torch.float32)

    def run() -> list[Tensor]:
        weights = with_gradients(lambda s, t, _: (weights_from_density(s, t),), sigma, t, colours, (0,))
        return [*with_gradients(render_rays, sigma, t, colours), *weights[:2]]

    alone = run()
    monkeypatch.setattr(launch, "_WORTH_WAKING_NS", 0)
    for parts in (2, 7):
        monkeypatch.setattr(launch, "num_threads", lambda parts=parts: parts)
        assert all(torch.equal(a, b) for a, b in zip(run(), alone, strict=True))
