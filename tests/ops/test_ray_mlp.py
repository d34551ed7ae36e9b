"""The fused network: its kernel is the reference, whatever the widths, the number of rays and of threads."""

import numba
import pytest
import torch
from torch import Tensor

from plnerf.ops import cpu_mlp, reference
from plnerf.ops.cpu_mlp import BLOCK, SLABS


def inputs(
    rays: int, samples: int, widths: tuple[int, ...], const: int, dtype: torch.dtype
) -> tuple[Tensor, Tensor, Tensor, list[Tensor]]:
    """x, const, base and weights; widths are those of x, of the hidden layers and of the output."""
    generator = torch.Generator().manual_seed(rays + samples)

    def normal(*shape: int) -> Tensor:
        return torch.randn(shape, generator=generator, dtype=torch.float64).to(dtype)

    first, *rest = widths[1:]
    weights = [normal(first, widths[0] + const) * (widths[0] + const) ** -0.5]
    for before, after in zip(widths[1:], rest, strict=False):
        weights += [normal(after, before) * before**-0.5, normal(after)]
    return normal(rays, samples, widths[0]), normal(rays, samples, const), normal(rays, first), weights


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64], ids=str)
@pytest.mark.parametrize(
    ("rays", "samples", "widths", "const"),
    [
        (1, 1, (4, 4, 1), 0),
        (3, 5, (15, 64, 64, 3), 36),
        (2 * SLABS + 1, 24, (32, 64, 16), 0),
        (SLABS - 1, BLOCK, (3, 5, 6, 7, 2), 1),
        (0, 8, (4, 8, 3), 2),
    ],
    ids=str,
)
def test_kernel_is_the_reference(
    rays: int, samples: int, widths: tuple[int, ...], const: int, dtype: torch.dtype
) -> None:
    x, fixed, base, weights = inputs(rays, samples, widths, const, dtype)
    cotangent = torch.randn(rays, samples, widths[-1], generator=torch.Generator().manual_seed(3)).to(dtype)
    found, truth = [], []
    for op, results in ((cpu_mlp.ray_mlp, found), (reference.ray_mlp, truth)):
        leaves = [value.clone().requires_grad_() for value in (x, base, *weights)]
        out = op(leaves[0], fixed, leaves[1], leaves[2:])
        results += [out.detach(), *torch.autograd.grad(out, leaves, cotangent)]
        with torch.no_grad():
            results.append(op(x, fixed, base, weights))
    tolerance = 1e-5 if dtype == torch.float32 else 1e-12
    for a, b in zip(found, truth, strict=True):
        assert a.dtype == dtype
        scale = float(b.abs().max()) if b.numel() else 0.0
        torch.testing.assert_close(a, b, atol=tolerance * scale, rtol=0)


def test_results_do_not_depend_on_threads() -> None:
    x, const, base, weights = inputs(100, 24, (15, 32, 32, 3), 9, torch.float32)
    found = []
    before = numba.get_num_threads()
    for threads in {1, before}:
        numba.set_num_threads(threads)
        leaves = [value.clone().requires_grad_() for value in (x, base, *weights)]
        out = cpu_mlp.ray_mlp(leaves[0], const, leaves[1], leaves[2:])
        found.append([out, *torch.autograd.grad(out.square().sum(), leaves)])
    numba.set_num_threads(before)
    for a, b in zip(found[0], found[-1], strict=True):
        assert torch.equal(a, b)


def test_inputs_need_not_be_contiguous() -> None:
    x, const, base, weights = inputs(7, 5, (6, 8, 2), 3, torch.float64)
    strided = torch.stack([x, x], -1)[..., 0].requires_grad_()
    out = cpu_mlp.ray_mlp(strided, const.transpose(0, 1).contiguous().transpose(0, 1), base, weights)
    torch.testing.assert_close(out, reference.ray_mlp(x, const, base, weights))


def test_constants_have_a_gradient_where_it_is_asked_for() -> None:
    x, const, base, weights = inputs(2, 3, (4, 8, 2), 3, torch.float64)
    const.requires_grad_()
    found, truth = (
        torch.autograd.grad(op(x, const, base, weights).square().sum(), const)[0]
        for op in (cpu_mlp.ray_mlp, reference.ray_mlp)
    )
    torch.testing.assert_close(found, truth)
