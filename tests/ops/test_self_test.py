"""What is wrong with kernels is found before they are used, and said."""

from collections.abc import Callable

import pytest
import torch
from torch import Tensor

from plnerf.ops.dispatch import Kernels, kernels
from plnerf.ops.self_test import fault_of


def test_sound_kernels_have_no_fault(device: str) -> None:
    points = 40 if device == "cpu" else 1000  # interpreted, a point takes a tenth of a second
    assert fault_of(kernels("triton"), torch.device(device), points) is None


def test_numba_s_kernels_pass_it_too() -> None:
    assert fault_of(kernels("numba"), torch.device("cpu")) is None


def raising(error: Exception) -> Callable[..., Tensor]:
    def call(*_: object, **__: object) -> Tensor:
        raise error

    return call


def no_sums(param: Tensor, grad: Tensor, m: Tensor, v: Tensor, **_: object) -> None:
    m.add_(0.1 * grad)


SOUND = kernels("numba")


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (SOUND._replace(hash_encode=lambda x, table, grid: 1.001 * SOUND.hash_encode(x, table, grid)),
         "their hash encoding is off by 0.001 of"),
        (SOUND._replace(hash_encode=lambda x, table, grid: SOUND.hash_encode(x, table, grid) / 0),
         "their hash encoding is off by inf of"),
        (SOUND._replace(hash_encode=lambda x, table, grid: SOUND.hash_encode(x, table, grid) * float("nan")),
         "their hash encoding is off by nan of"),
        (SOUND._replace(adam_rows=no_sums), "their second moment of Adam is off by 1 of"),
        (SOUND._replace(hash_position_gradient=raising(RuntimeError("no C compiler\nmore"))),
         "they do not run: RuntimeError: no C compiler"),
        (SOUND._replace(hash_encode=raising(OSError())), "they do not run: OSError: no message"),
    ],
)  # fmt: skip
def test_a_fault_is_said_in_a_line(wrong: Kernels, said: str) -> None:
    fault = fault_of(wrong, torch.device("cpu"))
    assert fault is not None and fault.startswith(said)
    assert "\n" not in fault
