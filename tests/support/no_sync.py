"""Watches torch for what a CUDA graph cannot hold: waiting for the device, copies to it, masks as indices.

Tensors on the device `meta` stand for those on a GPU, so that no GPU is needed: they have a shape and a type,
and no content that a program could ask for.
"""

import traceback
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import torch
from torch import Tensor
from torch.overrides import TorchFunctionMode
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves

import plnerf

SOURCE = Path(plnerf.__file__).parent
# Ops whose kernels for CUDA read a number back, or whose result's shape depends on the content.
WAITING = {
    "_local_scalar_dense", "is_nonzero", "equal", "nonzero", "masked_select", "bincount", "histc",
    "_unique", "_unique2", "unique_dim", "unique_consecutive", "repeat_interleave", "linalg_matrix_exp",
    "_linalg_svd", "_linalg_eigh", "_linalg_solve_ex", "linalg_lu_factor_ex", "linalg_inv_ex",
}  # fmt: skip
MAKING = (torch.tensor, torch.as_tensor, torch.from_numpy, Tensor.new_tensor)


class Watch:
    """Context manager; `offences` names op, reason and place of everything a graph could not hold."""

    def __init__(self) -> None:
        self.offences: list[str] = []
        self._modes: list[Any] = [_Constants(self.report), _Ops(self.report)]

    def report(self, op: str, reason: str) -> None:
        self.offences.append(f"{_place()}: {op} {reason}")

    def __enter__(self) -> "Watch":
        for mode in self._modes:
            mode.__enter__()
        return self

    def __exit__(self, *error: Any) -> None:
        for mode in reversed(self._modes):
            mode.__exit__(*error)


class _Ops(TorchDispatchMode):
    def __init__(self, report: Callable[[str, str], None]) -> None:
        super().__init__()
        self.report = report

    def __torch_dispatch__(
        self, func: Any, types: Iterable[type], args: Sequence[Any] = (), kwargs: dict[str, Any] | None = None
    ) -> Any:
        name = func.overloadpacket.__name__
        inputs = [value for value in tree_leaves((args, kwargs)) if isinstance(value, Tensor)]
        if name in WAITING and any(value.device.type == "meta" for value in inputs):
            self.report(name, "waits for the device")
        if name in {"index", "index_put", "index_put_"} and any(
            value.dtype == torch.bool for value in tree_leaves(args[1]) if isinstance(value, Tensor)
        ):
            self.report(name, "by a mask has a shape that depends on the content")
        out = func(*args, **(kwargs or {}))
        outputs = [value for value in tree_leaves(out) if isinstance(value, Tensor)]
        if {value.device.type for value in (*inputs, *outputs)} >= {"cpu", "meta"}:
            self.report(name, "copies to or from the device")
        return out


class _Constants(TorchFunctionMode):
    def __init__(self, report: Callable[[str, str], None]) -> None:
        super().__init__()
        self.report = report

    def __torch_function__(
        self, func: Any, types: Iterable[type], args: Sequence[Any] = (), kwargs: dict[str, Any] | None = None
    ) -> Any:
        out = func(*args, **(kwargs or {}))
        if func in MAKING and out.device.type != "cpu":
            self.report(func.__name__, "copies a constant to the device")
        return out


def _place() -> str:
    """The innermost line of the package on the stack."""
    for frame in reversed(traceback.extract_stack()):
        if Path(frame.filename).is_relative_to(SOURCE):
            return f"{Path(frame.filename).relative_to(SOURCE)}:{frame.lineno} {frame.line}"
    return "a backward pass, or outside of the package"
