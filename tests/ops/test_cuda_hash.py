"""The Triton kernels are the reference: interpreted on a CPU, or run on a GPU where there is one."""

from typing import Literal

import pytest
import torch
from tests.ops.test_hash_encoding import derivatives, make_grid, make_inputs
from torch import Tensor

from plnerf.ops import cuda_hash, reference
from plnerf.ops.grid import GridShape

NAMES = ("out", "g_x", "g_table", "second x", "second cotangent", "second table")
CASES = pytest.mark.parametrize(
    ("features", "interpolation", "dtype"),
    [
        (1, "linear", torch.float64),
        (2, "cubic", torch.float64),
        (3, "linear", torch.float64),  # no power of two
        (4, "cubic", torch.float32),
    ],
    ids=str,
)


def inputs_on(device: str, grid: GridShape, dtype: torch.dtype, points: int | None = None) -> list[Tensor]:
    """Points that fill a block and a part of another."""
    points = cuda_hash.BLOCK * 5 // 4 if points is None else points
    return [value.to(device) for value in make_inputs(grid, points, dtype)]


def assert_near(a: Tensor, b: Tensor, tolerance: float, name: str = "") -> None:
    """Within a tolerance relative to the largest value."""
    torch.testing.assert_close(
        a, b, atol=tolerance * float(b.detach().abs().max()), rtol=0, msg=lambda m: f"{name}: {m}"
    )


@pytest.mark.slow
@CASES
def test_kernel_agrees_with_the_reference(
    device: str, features: int, interpolation: Literal["linear", "cubic"], dtype: torch.dtype
) -> None:
    grid = make_grid(features, interpolation)
    inputs = inputs_on(device, grid, dtype)
    truth = derivatives(reference.hash_encode, grid, *inputs)
    found = derivatives(cuda_hash.hash_encode, grid, *inputs)
    for name, a, b in zip(NAMES, found, truth, strict=True):
        assert a.dtype == dtype
        assert_near(a, b, 1e-5 if dtype == torch.float32 else 1e-12, name)


def test_neighbours_in_a_cell_are_summed_before_they_are_added(device: str) -> None:
    """Points along three rays: runs in one cell, longer than a block on the coarsest level, and single
    points, and the same cell met again after others."""
    grid = make_grid(2, "cubic")
    _, table, _ = inputs_on(device, grid, torch.float64, points=0)
    per_ray = cuda_hash.BLOCK
    along = torch.linspace(0, 1, per_ray, dtype=torch.float64)[:, None]
    ends = torch.rand(3, 2, 3, generator=torch.Generator().manual_seed(5), dtype=torch.float64)
    ends[1, 1] = ends[1, 0] + 1e-3  # within a cell
    x = torch.cat([a + along * (b - a) for a, b in (*ends, ends[0])])[: 4 * per_ray - 3].to(device)
    cotangent = torch.randn(len(x), grid.width, generator=torch.Generator().manual_seed(6)).to(x)
    gradients = []
    for kernel in (cuda_hash, reference):
        leaf = table.clone().requires_grad_()
        gradients += torch.autograd.grad(kernel.hash_encode(x, leaf, grid), leaf, cotangent)
    assert_near(*gradients, 1e-12)


@pytest.mark.parametrize("dtype", [torch.float16, torch.bfloat16], ids=str)
def test_a_table_of_fewer_bits_is_read_exactly_and_its_gradient_summed_in_float32(
    device: str, dtype: torch.dtype
) -> None:
    """As if the same values were in a float32 table; a thousandth of the table's range is not lost."""
    grid = make_grid(2, "cubic")
    x, table, cotangent = inputs_on(device, grid, torch.float32)
    cotangent = cotangent * 1e-9
    wide = table.to(dtype).float().requires_grad_()
    narrow = table.to(dtype).requires_grad_()
    narrow.grad_dtype = torch.float32
    found, truth = cuda_hash.hash_encode(x, narrow, grid), reference.hash_encode(x, wide, grid)
    assert_near(found, truth, 1e-6)
    for encoded in (found, truth):
        encoded.backward(cotangent)
    assert narrow.grad is not None and wide.grad is not None
    assert narrow.grad.dtype == torch.float32
    assert_near(narrow.grad, wide.grad, 1e-5)


@pytest.mark.slow
def test_a_vertex_has_the_table_s_row(device: str) -> None:
    """Of a dense and of a hashed level, on the border too."""
    n = 8  # a power of two: vertices are exact
    vertex = torch.cartesian_prod(*[torch.arange(n + 1)] * 3)
    i, j, k = vertex.unbind(-1)
    for grid, row in [
        (GridShape(1, n, n, 2, 10, "cubic"), i + 9 * j + 81 * k),
        (GridShape(1, n, n, 2, 6, "cubic"), (i ^ j * 2654435761 ^ k * 805459861) % 64),
    ]:
        _, table, _ = inputs_on(device, grid, torch.float32)
        out = cuda_hash.hash_encode((vertex.float() / n).to(device), table, grid)
        assert torch.equal(out, table[row.to(device)])


def test_no_points_are_no_trouble(device: str) -> None:
    grid = make_grid(2, "cubic")
    out, g_x, g_table, *second = derivatives(
        cuda_hash.hash_encode, grid, *inputs_on(device, grid, torch.float32, points=0)
    )
    assert out.shape == (0, grid.width)
    assert g_x.shape == (0, 3)
    assert not g_table.any()
    assert all(not value.any() for value in second)


@pytest.mark.filterwarnings("ignore:.*encountered in:RuntimeWarning")  # NumPy's, of the interpreter
def test_points_that_are_no_numbers_stay_within_the_table(device: str) -> None:
    """They give what they give, but read and write nothing beyond; others beside them are untouched."""
    grid = make_grid(2, "cubic")
    x, table, cotangent = inputs_on(device, grid, torch.float32, points=8)
    wild = x.clone()
    wild[:4, 0] = torch.tensor([float("nan"), float("inf"), float("-inf"), 3e38])
    guarded = torch.cat([table, torch.full_like(table, 7.0)])
    guarded.grad = torch.zeros_like(guarded)
    out = cuda_hash.hash_encode(wild, guarded.requires_grad_(), grid)
    out.backward(cotangent)
    assert not guarded.grad[len(table) :].any()
    assert torch.equal(out[4:], cuda_hash.hash_encode(x, table, grid)[4:])


@pytest.mark.slow
def test_strided_inputs_agree(device: str) -> None:
    """Of second derivatives too: a copy must not cut the graph."""
    grid = make_grid(2, "cubic")
    x, table, cotangent = inputs_on(device, grid, torch.float64)
    plain = derivatives(cuda_hash.hash_encode, grid, x, table, cotangent)
    strided = [value.t().contiguous().t() for value in (x, table, cotangent)]
    assert not any(value.is_contiguous() for value in strided)
    for name, a, b in zip(NAMES, derivatives(cuda_hash.hash_encode, grid, *strided), plain, strict=True):
        assert_near(a, b, 1e-12, name)


@pytest.mark.parametrize("moving", [False, True])
def test_position_gradient_is_the_gradient_of_the_position(device: str, moving: bool) -> None:
    """Whether or not positions ask for gradients themselves; and it trains the table."""
    grid = make_grid(2, "cubic")
    x, table, cotangent = inputs_on(device, grid, torch.float64)
    inputs = (x.requires_grad_(moving), cotangent.requires_grad_(), table.requires_grad_())
    q = torch.randn(x.shape, generator=torch.Generator().manual_seed(1), dtype=torch.float64).to(x)
    results = []
    for kernel in (reference, cuda_hash):
        g_x = kernel.hash_position_gradient(*inputs, grid)
        results.append([g_x, *torch.autograd.grad(g_x, inputs[0 if moving else 1 :], q)])
    for a, b in zip(results[1], results[0], strict=True):
        assert_near(a, b, 1e-12)


@pytest.mark.slow
def test_backward_passes_add_to_a_table_s_gradient(device: str) -> None:
    """Into nothing, into zeros and onto what is there already, of first and second derivatives alike."""
    grid = make_grid(2, "cubic")
    x, table, cotangent = inputs_on(device, grid, torch.float32)
    x.requires_grad_()

    def run(kernel: object, before: Tensor | None) -> Tensor:
        leaf = table.clone().requires_grad_()
        leaf.grad = before
        out = kernel.hash_encode(x, leaf, grid)  # type: ignore[attr-defined]  # a module
        (g_x,) = torch.autograd.grad(out, x, cotangent, create_graph=True)
        ((out * cotangent).sum() + g_x.sum() / grid.finest).backward()  # of one size: neither hides the other
        assert leaf.grad is not None
        assert before is None or leaf.grad is before
        return leaf.grad

    once = run(reference, None)
    scale = float(once.abs().max())
    for before, truth in [
        (None, once),
        (torch.zeros_like(table), once),
        (torch.full_like(table, scale), once + scale),
    ]:
        torch.testing.assert_close(run(cuda_hash, before), truth, atol=1e-5 * scale, rtol=0)


def test_the_gradient_of_a_table_s_gradient_is_refused(device: str) -> None:
    """Silence would be a wrong number."""
    grid = make_grid(2, "cubic")
    x, table, cotangent = (value.requires_grad_() for value in inputs_on(device, grid, torch.float32, 3))
    (g_table,) = torch.autograd.grad(
        cuda_hash.hash_encode(x, table, grid), table, cotangent, create_graph=True
    )
    with pytest.raises(NotImplementedError, match="use the reference"):
        g_table.square().sum().backward()
