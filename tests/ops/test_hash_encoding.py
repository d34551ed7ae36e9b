"""The hash encoding: the reference is the equation, its gradients are right, the kernel is the reference."""

import math
from collections.abc import Callable
from typing import Literal

import numba
import numpy as np
import pytest
import torch
from tests.support import numpy_reference
from torch import Tensor

from plnerf.ops import cpu_arrays, cpu_hash, cpu_hash_normals, reference
from plnerf.ops.grid import GridShape

Encode = Callable[[Tensor, Tensor, GridShape], Tensor]
BACKENDS = pytest.mark.parametrize(
    "encode", [reference.hash_encode, cpu_hash.hash_encode], ids=["torch", "numba"]
)
# Every number of features, interpolation and dtype at least once; each costs some seconds of compilation.
CASES = pytest.mark.parametrize(
    ("features", "interpolation", "dtype"),
    [
        (1, "linear", torch.float64),
        (2, "cubic", torch.float32),
        (4, "linear", torch.float32),
        (2, "cubic", torch.float64),
    ],
    ids=str,
)


def make_grid(features: int, interpolation: Literal["linear", "cubic"]) -> GridShape:
    """Levels of 3, 7, 17 and 40 cells: 4^3 and 8^3 = 2^9 vertices are dense (just so), the others hashed."""
    grid = GridShape(4, 3, 40, features, 9, interpolation)
    assert grid.dense == (True, True, False, False)
    return grid


def make_inputs(
    grid: GridShape, points: int, dtype: torch.dtype, seed: int = 0
) -> tuple[Tensor, Tensor, Tensor]:
    """Points in and around the cube, a table, and a cotangent of the encoding."""
    generator = torch.Generator().manual_seed(seed)
    x = torch.rand(points, 3, generator=generator, dtype=torch.float64) * 1.4 - 0.2
    table = torch.randn(grid.rows, grid.features, generator=generator, dtype=torch.float64)
    cotangent = torch.randn(points, grid.width, generator=generator, dtype=torch.float64)
    return x.to(dtype), table.to(dtype), cotangent.to(dtype)


def derivatives(encode: Encode, grid: GridShape, x: Tensor, table: Tensor, cotangent: Tensor) -> list[Tensor]:
    """Encoding, its gradients of x and table, and those of <q, gradient of x> of x, cotangent and table."""
    x, table, cotangent = (value.clone().requires_grad_() for value in (x, table, cotangent))
    out = encode(x, table, grid)
    (g_x,) = torch.autograd.grad(out, x, cotangent, create_graph=True)
    (g_table,) = torch.autograd.grad(out, table, cotangent, retain_graph=True)
    q = torch.randn(x.shape, generator=torch.Generator().manual_seed(1), dtype=torch.float64).to(x)
    second = torch.autograd.grad(g_x, (x, cotangent, table), q)
    return [out.detach(), g_x.detach(), g_table, *second]


@pytest.mark.slow
@CASES
def test_kernel_agrees_with_the_reference(
    features: int, interpolation: Literal["linear", "cubic"], dtype: torch.dtype
) -> None:
    grid = make_grid(features, interpolation)
    inputs = make_inputs(grid, 300, dtype)
    truth = derivatives(reference.hash_encode, grid, *inputs)
    found = derivatives(cpu_hash.hash_encode, grid, *inputs)
    names = ["out", "g_x", "g_table", "second x", "second cotangent", "second table"]
    tolerance = 1e-5 if dtype == torch.float32 else 1e-12
    for name, a, b in zip(names, found, truth, strict=True):
        assert a.dtype == dtype
        scale = float(b.abs().max())
        torch.testing.assert_close(a, b, atol=tolerance * scale, rtol=0, msg=lambda m, n=name: f"{n}: {m}")


@BACKENDS
@pytest.mark.parametrize(("features", "interpolation"), [(1, "linear"), (2, "cubic")])
def test_encoding_is_the_equation(
    encode: Encode, features: int, interpolation: Literal["linear", "cubic"]
) -> None:
    grid = make_grid(features, interpolation)
    x, table, _ = make_inputs(grid, 40, torch.float64)
    truth = numpy_reference.hash_encode(x.numpy(), table.numpy(), 4, 3, 40, 9, interpolation == "cubic")
    np.testing.assert_allclose(encode(x, table, grid).numpy(), truth, atol=1e-12)


@BACKENDS
@pytest.mark.parametrize(("features", "interpolation"), [(1, "linear"), (2, "cubic")])
def test_gradients_are_those_of_finite_differences(
    encode: Encode, features: int, interpolation: Literal["linear", "cubic"]
) -> None:
    grid = GridShape(2, 2, 3, features, 5, interpolation)  # one dense level, one hashed
    assert grid.dense == (True, False)
    x, table, cotangent = (value.requires_grad_() for value in make_inputs(grid, 3, torch.float64, seed=3))

    def position_gradient(x: Tensor, table: Tensor, cotangent: Tensor) -> Tensor:
        (g_x,) = torch.autograd.grad(encode(x, table, grid), x, cotangent, create_graph=True)
        return g_x

    assert torch.autograd.gradcheck(lambda x, table: encode(x, table, grid), (x, table))
    assert torch.autograd.gradcheck(position_gradient, (x, table, cotangent))


@BACKENDS
def test_a_vertex_has_the_table_s_row(encode: Encode) -> None:
    """Of a dense and of a hashed level, on the border too; for cubic weights the slope there is zero."""
    n, log2_table = 8, 10  # powers of two: vertices are exact
    vertex = torch.cartesian_prod(*[torch.arange(n + 1)] * 3)
    i, j, k = vertex.unbind(-1)
    for grid, row in [
        (GridShape(1, n, n, 2, log2_table, "cubic"), i + 9 * j + 81 * k),
        (GridShape(1, n, n, 2, 6, "cubic"), (i ^ j * 2654435761 ^ k * 805459861) % 64),
    ]:
        _, table, _ = make_inputs(grid, 1, torch.float64)
        x = (vertex.double() / n).requires_grad_()
        out = encode(x, table, grid)
        torch.testing.assert_close(out.detach(), table[row], atol=1e-14, rtol=0)
        (g_x,) = torch.autograd.grad(out.sum(), x)
        assert float(g_x.abs().max()) < 1e-12


@BACKENDS
def test_linear_weights_reproduce_a_linear_function(encode: Encode) -> None:
    """Everywhere, and beyond the cube, where the border cell's interpolant goes on."""
    grid = GridShape(1, 5, 5, 1, 9, "linear")
    vertex = (
        torch.cartesian_prod(*[torch.arange(6.0, dtype=torch.float64)] * 3).flip(-1) / 5
    )  # x runs fastest
    slope = torch.tensor([2.0, -3.0, 0.7], dtype=torch.float64)
    x, _, _ = make_inputs(grid, 50, torch.float64)
    out = encode(x, (vertex @ slope + 0.4)[:, None], grid)
    torch.testing.assert_close(out[:, 0], x @ slope + 0.4)


@BACKENDS
def test_weights_sum_to_one(encode: Encode) -> None:
    grid = make_grid(2, "cubic")
    x, table, _ = make_inputs(grid, 50, torch.float64)
    out = encode(x, torch.full_like(table, 3.0), grid)
    torch.testing.assert_close(out, torch.full_like(out, 3.0))


@BACKENDS
def test_cubic_gradient_is_continuous_across_cells(encode: Encode) -> None:
    """The reason for cubic weights.  The gradient of linear ones jumps by the size of the table's entries."""
    jumps = {}
    for interpolation in ("cubic", "linear"):
        grid = GridShape(1, 4, 4, 2 if interpolation == "cubic" else 1, 9, interpolation)
        _, table, _ = make_inputs(grid, 1, torch.float64)
        face = torch.tensor([[0.5, 0.3, 0.6]], dtype=torch.float64)
        step = torch.tensor([[1e-9, 0, 0]], dtype=torch.float64)
        sides = []
        for side in (face - step, face + step):
            x = side.requires_grad_()
            sides.append(torch.autograd.grad(encode(x, table, grid).sum(), x)[0])
        jumps[interpolation] = float((sides[1] - sides[0]).abs().max())
    assert jumps["cubic"] < 1e-6 < 0.1 < jumps["linear"]


@BACKENDS
def test_no_points_are_no_trouble(encode: Encode) -> None:
    grid = make_grid(2, "cubic")
    x, table, cotangent = make_inputs(grid, 0, torch.float32)
    out, g_x, g_table, *second = derivatives(encode, grid, x, table, cotangent)
    assert out.shape == (0, grid.width)
    assert g_x.shape == (0, 3)
    assert not g_table.any()
    assert all(not value.any() for value in second)


def test_results_do_not_depend_on_the_number_of_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nor on into how many parts the work is split: bit for bit."""
    grid = make_grid(2, "cubic")
    inputs = make_inputs(grid, 1001, torch.float32)
    before = numba.get_num_threads()
    runs = []
    try:
        for threads, parts in [
            (1, 1),
            (numba.config.NUMBA_NUM_THREADS, 2),
            (numba.config.NUMBA_NUM_THREADS, 7),
        ]:
            numba.set_num_threads(threads)
            monkeypatch.setattr(cpu_arrays, "num_threads", lambda parts=parts: parts)
            runs.append(derivatives(cpu_hash.hash_encode, grid, *inputs))
    finally:
        numba.set_num_threads(before)
    for run in runs[1:]:
        assert all(torch.equal(a, b) for a, b in zip(run, runs[0], strict=True))


def test_strided_inputs_agree_and_compile_nothing_new() -> None:
    grid = make_grid(2, "cubic")
    x, table, cotangent = make_inputs(grid, 100, torch.float32)
    plain = derivatives(cpu_hash.hash_encode, grid, x, table, cotangent)
    kernels = [*cpu_hash._kernels(2), *cpu_hash_normals._kernels(2)]
    compiled = [len(kernel.signatures) for kernel in kernels]
    strided = [value.t().contiguous().t() for value in (x, table, cotangent)]
    assert not any(value.is_contiguous() for value in strided)
    for a, b in zip(derivatives(cpu_hash.hash_encode, grid, *strided), plain, strict=True):
        assert torch.equal(a, b)
    assert [len(kernel.signatures) for kernel in kernels] == compiled


@CASES
def test_position_gradient_is_the_gradient_of_the_position(
    features: int, interpolation: Literal["linear", "cubic"], dtype: torch.dtype
) -> None:
    """Of both kernels, whether or not positions ask for gradients themselves; and it trains the table."""
    grid = make_grid(features, interpolation)
    x, table, cotangent = make_inputs(grid, 200, dtype)
    truth = derivatives(reference.hash_encode, grid, x, table, cotangent)
    tolerance = 1e-5 if dtype == torch.float32 else 1e-12
    q = torch.randn(x.shape, generator=torch.Generator().manual_seed(1), dtype=torch.float64).to(x)
    for kernel in (reference, cpu_hash):
        for moving in (False, True):
            inputs = (
                x.clone().requires_grad_(moving),
                cotangent.clone().requires_grad_(),
                table.requires_grad_(),
            )
            g_x = kernel.hash_position_gradient(*inputs, grid)
            second = torch.autograd.grad(g_x, inputs[0 if moving else 1 :], q)
            for a, b in zip([g_x, *second], [truth[1], *truth[3 if moving else 4 :]], strict=True):
                torch.testing.assert_close(a, b, atol=tolerance * float(b.abs().max()), rtol=0)
    assert not x.requires_grad


def test_backward_passes_add_to_a_table_s_gradient() -> None:
    """Into nothing, into zeros and onto what is there already, of first and second derivatives alike."""
    grid = make_grid(2, "cubic")
    x, table, cotangent = make_inputs(grid, 200, torch.float32)
    x.requires_grad_()

    def run(encode: Encode, before: Tensor | None, times: int) -> Tensor:
        leaf = table.clone().requires_grad_()
        leaf.grad = before
        for _ in range(times):
            out = encode(x, leaf, grid)
            (g_x,) = torch.autograd.grad(out, x, cotangent, create_graph=True)
            (
                (out * cotangent).sum() + g_x.sum() / grid.finest
            ).backward()  # of one size: neither hides the other
        assert leaf.grad is not None
        return leaf.grad

    once = run(reference.hash_encode, None, 1)
    scale = float(once.abs().max())
    for before, times, truth in [
        (None, 1, once),
        (torch.zeros_like(table), 1, once),
        (torch.full_like(table, scale), 1, once + scale),
        (None, 2, 2 * once),
    ]:
        found = run(cpu_hash.hash_encode, before, times)
        torch.testing.assert_close(found, truth, atol=1e-5 * scale, rtol=0)


def test_the_gradient_of_a_table_s_gradient_is_refused() -> None:
    """Silence would be a wrong number."""
    grid = make_grid(2, "cubic")
    x, table, cotangent = (value.requires_grad_() for value in make_inputs(grid, 3, torch.float32))
    (g_table,) = torch.autograd.grad(
        cpu_hash.hash_encode(x, table, grid), table, cotangent, create_graph=True
    )
    with pytest.raises(NotImplementedError, match="use the reference"):
        g_table.square().sum().backward()


def test_points_that_are_not_numbers_stay_within_the_table() -> None:
    """They give what is not a number, in the rows of a border cell, and leave all other points alone."""
    grid = make_grid(2, "cubic")
    x, table, cotangent = make_inputs(grid, 400, torch.float32)
    bad = torch.arange(400) % 7 == 0
    values = torch.tensor([math.nan, math.inf, -math.inf, 1e30, -1e30])
    broken = x.clone()
    broken[bad] = values[torch.arange(int(bad.sum())) % 5][:, None]
    out = cpu_hash.hash_encode(broken, table, grid)
    assert torch.equal(out[~bad], cpu_hash.hash_encode(x, table, grid)[~bad])
    assert not out[bad].isfinite().all(-1).any()
    fresh, spoilt = torch.zeros_like(table), torch.zeros_like(table)
    cpu_hash.add_table_gradient(x[~bad], cotangent[~bad], fresh, grid)
    cpu_hash.add_table_gradient(broken, cotangent, spoilt, grid)
    untouched = spoilt.isfinite().all(-1)
    assert 0 < int((~untouched).sum()) <= 5 * 8 * grid.levels  # corners of a few border cells
    torch.testing.assert_close(spoilt[untouched], fresh[untouched])
