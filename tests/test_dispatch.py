"""The backend is chosen by device, and never changed silently."""

import pytest
import torch

from plnerf.errors import ConfigError
from plnerf.ops.dispatch import Backend, hash_encode, resolve_backend
from plnerf.ops.grid import GridShape


def test_auto_is_numba_on_a_cpu_and_torch_elsewhere() -> None:
    assert resolve_backend("auto", torch.device("cpu")) == "numba"
    assert resolve_backend("auto", torch.device("cuda")) == "torch"
    assert resolve_backend("auto", torch.device("mps")) == "torch"


@pytest.mark.parametrize("device", ["cpu", "cuda"])
def test_torch_runs_anywhere(device: str) -> None:
    assert resolve_backend("torch", torch.device(device)) == "torch"


def test_numba_elsewhere_is_refused() -> None:
    with pytest.raises(
        ConfigError, match=r"'numba' runs on a CPU, but the device is cuda:1.*--backend torch"
    ):
        resolve_backend("numba", torch.device("cuda:1"))


def test_backends_compute_the_same() -> None:
    grid = GridShape(3, 3, 20, 2, 9, "cubic")
    x = torch.rand(50, 3, generator=torch.Generator().manual_seed(0))
    table = torch.randn(grid.rows, 2, generator=torch.Generator().manual_seed(1))
    backends: tuple[Backend, ...] = ("torch", "numba")
    a, b = (hash_encode(x, table, grid, backend) for backend in backends)
    torch.testing.assert_close(a, b, atol=1e-5, rtol=0)
    assert not torch.equal(a, torch.zeros_like(a))
