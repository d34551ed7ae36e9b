"""The backend is chosen by device, and never changed silently."""

import ast
from pathlib import Path
from typing import get_args

import pytest
import torch

import plnerf
from plnerf.errors import ConfigError
from plnerf.ops import dispatch
from plnerf.ops.backends import Backend, BackendChoice
from plnerf.ops.dispatch import hash_encode
from plnerf.ops.grid import GridShape


def sound(backend: Backend, on: torch.device) -> str | None:
    """A self-test that kernels pass, for which most machines have no device."""


def resolve_backend(choice: BackendChoice, on: torch.device) -> Backend:
    return dispatch.resolve_backend(choice, on, sound)


def test_auto_is_numba_on_a_cpu_and_triton_on_cuda() -> None:
    assert resolve_backend("auto", torch.device("cpu")) == "numba"
    assert resolve_backend("auto", torch.device("cuda")) == "triton"
    assert resolve_backend("auto", torch.device("mps")) == "torch"


def test_cuda_without_triton_is_plain_torch_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dispatch, "find_spec", lambda name: None)
    with pytest.warns(UserWarning, match="Triton is not installed.*plain torch"):
        assert resolve_backend("auto", torch.device("cuda")) == "torch"
    with pytest.raises(ConfigError, match=r"'triton' was asked for.*pip install triton"):
        resolve_backend("triton", torch.device("cuda"))


def test_kernels_that_fail_their_self_test_are_left_alone() -> None:
    """Loudly where the choice is the program's; an error where it is the user's."""

    def fault_of(backend: Backend, on: torch.device) -> str | None:
        return f"the table of {backend} is off by 0.3"

    with pytest.warns(UserWarning, match=r"self-test on cuda.*plain torch.*triton is off.*C compiler"):
        assert dispatch.resolve_backend("auto", torch.device("cuda"), fault_of) == "torch"
    with pytest.raises(ConfigError, match=r"self-test on cuda: the table.*0\.3\. .*--backend torch"):
        dispatch.resolve_backend("triton", torch.device("cuda"), fault_of)
    assert dispatch.resolve_backend("auto", torch.device("cpu"), fault_of) == "numba"


def test_triton_on_a_cpu_needs_the_interpreter(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TRITON_INTERPRET", "1")
    assert resolve_backend("triton", torch.device("cpu")) == "triton"
    monkeypatch.delenv("TRITON_INTERPRET")
    assert resolve_backend("triton", torch.device("cuda:1")) == "triton"
    with pytest.raises(
        ConfigError, match=r"'triton' runs on a CUDA device, but the device is cpu.*--backend"
    ):
        resolve_backend("triton", torch.device("cpu"))


@pytest.mark.parametrize("device", ["cpu", "cuda"])
def test_torch_runs_anywhere(device: str) -> None:
    assert resolve_backend("torch", torch.device(device)) == "torch"


def test_numba_elsewhere_is_refused() -> None:
    with pytest.raises(
        ConfigError, match=r"'numba' runs on a CPU, but the device is cuda:1.*--backend torch"
    ):
        resolve_backend("numba", torch.device("cuda:1"))


@pytest.mark.skipif(torch.cuda.is_available(), reason="Triton's kernels are not interpreted beside a GPU")
def test_backends_compute_the_same() -> None:
    grid = GridShape(3, 3, 20, 2, 9, "cubic")
    x = torch.rand(50, 3, generator=torch.Generator().manual_seed(0))
    table = torch.randn(grid.rows, 2, generator=torch.Generator().manual_seed(1))
    backends: tuple[Backend, ...] = ("torch", "numba", "triton")
    truth, *found = (hash_encode(x, table, grid, backend) for backend in backends)
    assert not torch.equal(truth, torch.zeros_like(truth))
    for kernel in found:
        torch.testing.assert_close(kernel, truth, atol=1e-5, rtol=0)


def test_nothing_else_compares_the_names_of_backends() -> None:
    """Everything else asks `dispatch.kernels` for functions or what a backend can do."""
    package = Path(plnerf.__file__).parent
    found = []
    for path in package.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            parts = [node.left, *node.comparators] if isinstance(node, ast.Compare) else []
            constants = {c.value for part in parts for c in ast.walk(part) if isinstance(c, ast.Constant)}
            if constants & set(get_args(Backend)):
                found.append(f"{path.relative_to(package)}:{node.lineno}")
    assert [place for place in found if not place.startswith("ops/dispatch.py")] == []
    assert any(place.startswith("ops/dispatch.py") for place in found)
