"""Which implementation of an op runs.  Chosen once, printed, written into the run; never changed silently."""

import os
import warnings
from collections.abc import Sequence
from importlib.util import find_spec
from types import ModuleType
from typing import Literal

from jaxtyping import Float
from torch import Tensor, device

from plnerf.errors import ConfigError
from plnerf.ops import reference
from plnerf.ops.grid import GridShape

Backend = Literal["torch", "numba", "triton"]
BackendChoice = Literal["auto", "torch", "numba", "triton"]


def resolve_backend(choice: BackendChoice, on: device) -> Backend:
    """The backend for a device: Numba on a CPU, Triton on a CUDA device, plain torch elsewhere, unless one is
    asked for.

    Warns where a CUDA device is left with plain torch, since Triton is not installed.  Raises ConfigError
    where the asked-for backend cannot run on the device.
    """
    if choice == "auto":
        return _default_backend(on)
    if choice == "numba" and on.type != "cpu":
        raise ConfigError(
            f"The backend 'numba' runs on a CPU, but the device is {on}. "
            f"Choose --backend torch or --device cpu."
        )
    if choice == "triton":
        _check_triton(on)
    return choice


def _default_backend(on: device) -> Backend:
    if on.type == "cpu":
        return "numba"
    if on.type != "cuda":
        return "torch"
    if find_spec("triton"):
        return "triton"
    warnings.warn(
        "Triton is not installed, so the ops run in plain torch, which is much slower. "
        "It comes with PyTorch's Linux builds for CUDA: pip install triton.",
        stacklevel=2,
    )
    return "torch"


def _check_triton(on: device) -> None:
    if not find_spec("triton"):
        raise ConfigError(
            "The backend 'triton' was asked for, but Triton is not installed. On Linux, pip install triton, "
            "or choose --backend auto."
        )
    interpreted = on.type == "cpu" and os.environ.get("TRITON_INTERPRET") == "1"
    if on.type != "cuda" and not interpreted:
        raise ConfigError(
            f"The backend 'triton' runs on a CUDA device, but the device is {on}. Choose --backend auto; to "
            "try its kernels on a CPU, slowly, set TRITON_INTERPRET=1 in the environment."
        )


def hash_encode(
    x: Float[Tensor, "n 3"], table: Float[Tensor, "rows F"], grid: GridShape, backend: Backend
) -> Float[Tensor, "n LF"]:
    """Multi-resolution hash encoding of points in [0, 1]^3; see `reference.hash_encode`."""
    encoded: Tensor = _twin(backend).hash_encode(x, table, grid)
    return encoded


def hash_position_gradient(
    x: Float[Tensor, "n 3"],
    g_out: Float[Tensor, "n LF"],
    table: Float[Tensor, "rows F"],
    grid: GridShape,
    backend: Backend,
) -> Float[Tensor, "n 3"]:
    """Gradient of <g_out, hash_encode(x)> with respect to x; see `reference.hash_position_gradient`."""
    g_x: Tensor = _twin(backend).hash_position_gradient(x, g_out, table, grid)
    return g_x


def hash_mlp(
    x: Float[Tensor, "n 3"],
    table: Float[Tensor, "rows F"],
    grid: GridShape,
    weights: tuple[Tensor, Tensor, Tensor, Tensor],
    backend: Backend,
) -> Float[Tensor, " n"]:
    """A hash encoding and a network of one hidden layer on top; see `reference.hash_mlp`."""
    if backend == "numba":
        from plnerf.ops import cpu_hash_mlp

        return cpu_hash_mlp.hash_mlp(x, table, grid, weights)
    return reference.mlp_on(_twin(backend).hash_encode(x, table, grid), weights)


def ray_mlp(
    x: Float[Tensor, "r S I"],
    const: Float[Tensor, "r S J"],
    base: Float[Tensor, "r H"],
    weights: Sequence[Tensor],
    backend: Backend,
) -> Float[Tensor, "r S O"]:
    """A network on the samples of rays; see `reference.ray_mlp`.  On a GPU plain torch is what is fast."""
    if backend == "numba":
        from plnerf.ops import cpu_mlp

        return cpu_mlp.ray_mlp(x, const, base, weights)
    return reference.ray_mlp(x, const, base, weights)


def _twin(backend: Backend) -> ModuleType:
    if backend == "torch":
        return reference
    if backend == "triton":
        from plnerf.ops import cuda_hash  # Triton is there on Linux only

        return cuda_hash
    from plnerf.ops import cpu_hash  # Numba takes a third of a second to import: only where it is used

    return cpu_hash
