"""The optimiser: Adam on networks, by rows on tables; the kernel agrees with the reference; states load."""

import math

import numba
import pytest
import torch
from torch import Tensor

from plnerf.ops import cpu_adam, cpu_arrays, reference
from plnerf.ops.backends import Backend
from plnerf.train.optimizer import TableAdam

BACKENDS = pytest.mark.parametrize("backend", ["torch", "numba"])
SETTINGS = {"rate": 0.02, "betas": (0.9, 0.99), "eps": 1e-15}


def make_table(rows: int, features: int, dtype: torch.dtype = torch.float32, seed: int = 0) -> list[Tensor]:
    """A table, its gradient, of which every third row is zero or so, and its moments."""
    generator = torch.Generator().manual_seed(seed)
    param, grad, m, v = (torch.randn(rows, features, generator=generator, dtype=dtype) for _ in range(4))
    grad *= torch.rand(rows, 1, generator=generator) < 0.6
    grad *= torch.rand(rows, features, generator=generator) < 0.8  # zeros inside of rows do not count
    return [param, grad, m * 0.1, v.square()]


@pytest.mark.parametrize("features", [1, 2, 3, 4, 20])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64], ids=str)
def test_kernel_agrees_with_the_reference(features: int, dtype: torch.dtype) -> None:
    """On tables that do and do not fill whole vectors."""
    tolerance = 1e-6 if dtype == torch.float32 else 1e-14
    for rows in (1, 101):
        truth, found = make_table(rows, features, dtype), make_table(rows, features, dtype)
        for step in (1, 2, 1000):
            for tensors in (truth, found):
                tensors[1].copy_(make_table(rows, features, dtype, seed=step)[1])
            reference.adam_rows(*truth, step=step, **SETTINGS)
            cpu_adam.adam_rows(*found, step=step, **SETTINGS)
            for a, b in zip(found, truth, strict=True):
                torch.testing.assert_close(a, b, atol=tolerance * float(b.abs().max()), rtol=0)


@BACKENDS
def test_with_a_gradient_in_every_row_it_is_torch_s_adam(backend: Backend) -> None:
    table, gradients = make_table(50, 4)[0], torch.randn(5, 50, 4)
    ours, theirs = table.clone().requires_grad_(), table.clone().requires_grad_()
    optimizer = TableAdam([{"params": [ours], "by_row": True, "lr": 0.02}], backend)
    truth = torch.optim.Adam([theirs], lr=0.02, betas=(0.9, 0.99), eps=1e-15)
    for gradient in gradients:
        ours.grad, theirs.grad = gradient.clone(), gradient.clone()
        optimizer.step()
        truth.step()
        assert not ours.grad.any()
        torch.testing.assert_close(ours, theirs)
    assert optimizer.state[ours].keys() == truth.state[theirs].keys()
    for key, value in truth.state[theirs].items():
        torch.testing.assert_close(optimizer.state[ours][key], value)


@BACKENDS
def test_rows_without_a_gradient_keep_their_bits(backend: Backend) -> None:
    """The rows of a table, not those of a network, which momentum carries on."""
    param, grad, *_ = make_table(300, 4)
    still = ~(grad != 0).any(-1)
    assert 0 < int(still.sum()) < 300
    table, network = param.clone().requires_grad_(), param.clone().requires_grad_()
    optimizer = TableAdam(
        [{"params": [table], "by_row": True, "lr": 0.02}, {"params": [network], "lr": 0.02}], backend
    )
    pushes = [make_table(300, 4, seed=seed)[0] for seed in (1, 2)]
    assert all(bool(push.all()) for push in pushes)  # one in ten million draws is zero, and pushes nothing
    table.grad, network.grad = pushes
    optimizer.step()
    before = [table.detach().clone(), *(optimizer.state[table][k].clone() for k in ("exp_avg", "exp_avg_sq"))]
    carried = network.detach().clone()
    table.grad, network.grad = grad.clone(), grad.clone()
    optimizer.step()
    after = [table.detach(), *(optimizer.state[table][k] for k in ("exp_avg", "exp_avg_sq"))]
    for old, new in zip(before, after, strict=True):
        assert torch.equal(old[still], new[still])
        assert bool((old != new)[~still].any(-1).all())
    assert bool((network.detach() != carried)[still].all())


@BACKENDS
def test_a_row_that_rested_goes_on_with_its_moments(backend: Backend) -> None:
    """By hand: gradient g at steps 1 and 3, none at step 2."""
    g, rate, (beta1, beta2) = 0.5, 0.1, (0.9, 0.99)
    table = torch.zeros(1, 1, dtype=torch.float64).requires_grad_()
    optimizer = TableAdam([{"params": [table], "by_row": True, "lr": rate}], backend)
    for gradient in (g, 0.0, g):
        table.grad = torch.full((1, 1), gradient, dtype=torch.float64)
        optimizer.step()
    m, v = (1 - beta1) * g * (1 + beta1), (1 - beta2) * g * g * (1 + beta2)
    moved = rate + rate * m / (1 - beta1**3) / math.sqrt(v / (1 - beta2**3))
    assert table.item() == pytest.approx(-moved, rel=1e-12)


@BACKENDS
def test_not_a_number_is_a_gradient(backend: Backend) -> None:
    """Silently skipped, it would hide that training has failed."""
    table = torch.ones(3, 2).requires_grad_()
    optimizer = TableAdam([{"params": [table], "by_row": True, "lr": 0.1}], backend)
    table.grad = torch.tensor([[0.0, 0.0], [0.0, math.nan], [1e-12, 0.0]])
    optimizer.step()
    assert table[0].eq(1).all() and table[1, 1].isnan() and table[2, 0] < 1


def test_results_do_not_depend_on_the_number_of_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    before, runs = numba.get_num_threads(), []
    try:
        for threads, parts in [(1, 1), (numba.config.NUMBA_NUM_THREADS, 7)]:
            numba.set_num_threads(threads)
            monkeypatch.setattr(cpu_arrays, "num_threads", lambda parts=parts: parts)
            tensors = make_table(1003, 4)
            cpu_adam.adam_rows(*tensors, step=3, **SETTINGS)
            runs.append(tensors)
    finally:
        numba.set_num_threads(before)
    assert all(torch.equal(a, b) for a, b in zip(*runs, strict=True))


def test_what_cannot_be_changed_in_place_is_refused() -> None:
    param, grad, m, v = make_table(8, 4)
    for wrong in (grad.t().contiguous().t(), grad.double()):
        with pytest.raises(ValueError, match="contiguous tensors of one type"):
            cpu_adam.adam_rows(param, wrong, m, v, step=1, **SETTINGS)


def test_gradients_are_emptied() -> None:
    """Of networks by zero_grad, of tables by the step; thrown away, all of them."""
    table, network = torch.ones(3, 2).requires_grad_(), torch.ones(4).requires_grad_()
    optimizer = TableAdam([{"params": [table], "by_row": True}, {"params": [network]}], "torch")
    table.grad, network.grad = torch.ones(3, 2), torch.ones(4)
    kept = table.grad, network.grad
    optimizer.step()
    assert not table.grad.any() and network.grad.all()
    optimizer.zero_grad(set_to_none=False)
    assert (table.grad, network.grad) == kept and not network.grad.any()
    optimizer.zero_grad()
    assert table.grad is None and network.grad is None
    optimizer.step()
    assert optimizer.state[table]["step"] == optimizer.state[network]["step"] == 1


@BACKENDS
def test_a_loaded_state_goes_on_with_the_same_bits(backend: Backend) -> None:
    gradients = torch.randn(6, 20, 4) * (torch.rand(6, 20, 1) < 0.5)

    def start() -> tuple[list[Tensor], TableAdam]:
        values = [torch.ones(20, 4).requires_grad_(), torch.ones(20, 4).requires_grad_()]
        groups = [{"params": [values[0]], "by_row": True}, {"params": [values[1]]}]
        return values, TableAdam(groups, backend)

    def run(values: list[Tensor], optimizer: TableAdam, part: Tensor) -> None:
        for gradient in part:
            for value in values:
                value.grad = gradient.clone()
            optimizer.step()

    whole, optimizer = start()
    run(whole, optimizer, gradients)
    first, optimizer = start()
    run(first, optimizer, gradients[:3])
    second, resumed = start()
    for value, saved in zip(second, first, strict=True):
        value.data.copy_(saved.data)
    resumed.load_state_dict(optimizer.state_dict())
    run(second, resumed, gradients[3:])
    assert all(torch.equal(a, b) for a, b in zip(second, whole, strict=True))


def test_moments_of_what_is_no_longer_trained_are_left_out() -> None:
    """As where poses, the last group, are no longer refined."""
    network, poses = (torch.ones(3, requires_grad=True) for _ in range(2))
    both = TableAdam([{"params": [network]}, {"params": [poses]}], "torch")
    for value in (network, poses):
        value.grad = torch.ones(3)
    both.step()
    alone = TableAdam([{"params": [network]}], "torch")
    alone.load_state_dict(both.state_dict())
    assert alone.state_dict().keys() == {0}
    assert torch.equal(alone.state[network]["exp_avg"], both.state[network]["exp_avg"])
