"""Which implementation of an op runs.  Chosen once, printed, written into the run; never changed silently."""

from types import ModuleType
from typing import Literal

from jaxtyping import Float
from torch import Tensor, device

from plnerf.errors import ConfigError
from plnerf.ops import reference
from plnerf.ops.grid import GridShape

Backend = Literal["torch", "numba"]
BackendChoice = Literal["auto", "torch", "numba"]


def resolve_backend(choice: BackendChoice, on: device) -> Backend:
    """The backend for a device: Numba's twins on a CPU, plain torch elsewhere, unless one is asked for.

    Raises ConfigError where the asked-for backend cannot run on the device.
    """
    if choice == "auto":
        return "numba" if on.type == "cpu" else "torch"
    if choice == "numba" and on.type != "cpu":
        raise ConfigError(
            f"The backend 'numba' runs on a CPU, but the device is {on}. "
            f"Choose --backend torch or --device cpu."
        )
    return choice


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


def _twin(backend: Backend) -> ModuleType:
    if backend == "torch":
        return reference
    from plnerf.ops import cpu_hash  # Numba takes a third of a second to import: only where it is used

    return cpu_hash
