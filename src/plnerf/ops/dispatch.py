"""Which implementation of an op runs: the only place that knows one backend from another.

The backend is chosen once, printed and written into the run; it never changes silently.  Everything else asks
`kernels` for the functions of a backend.
"""

import os
import warnings
from collections.abc import Callable, Sequence
from functools import cache
from importlib.util import find_spec
from typing import NamedTuple

from jaxtyping import Float
from torch import Tensor, device

from plnerf.errors import ConfigError
from plnerf.ops import reference
from plnerf.ops.backends import Backend, BackendChoice
from plnerf.ops.grid import GridShape
from plnerf.ops.rendered import Rendered

FaultOf = Callable[[Backend, device], str | None]
"""What is wrong with a backend's kernels on a device, in words; None where they are sound."""


class RayKernels(NamedTuple):
    """Fused kernels on rays.  The reference of each is where its equation is: `rays/`, `render/volume.py`."""

    s_to_t: Callable[[Tensor, float, float, float], Tensor]
    frustum_features: Callable[..., tuple[Tensor, Tensor]]
    weights_from_density: Callable[[Tensor, Tensor], Tensor]
    resample_edges: Callable[[Tensor, Tensor, Tensor, float, float | Tensor], Tensor]
    render_rays: Callable[[Tensor, Tensor, Tensor], Rendered]
    interlevel_loss: Callable[[Tensor, Tensor, Tensor, Tensor], Tensor]
    distortion_loss: Callable[[Tensor, Tensor], Tensor]
    # None where the reference runs.
    cast_rays: Callable[..., tuple[Tensor, Tensor, Tensor]] | None = None
    blurred_interlevel_loss: Callable[[Tensor, Tensor, Tensor, Tensor, float], Tensor] | None = None
    dilate: Callable[[Tensor, Tensor, float], Tensor] | None = None
    windows: Callable[..., tuple[Tensor, Tensor, Tensor, Tensor]] | None = None
    lay_edges: Callable[..., Tensor] | None = None
    in_tubes: Callable[..., tuple[Tensor, Tensor, Tensor]] | None = None


class Kernels(NamedTuple):
    """What a backend runs; see `reference.py` for what each function computes."""

    hash_encode: Callable[[Tensor, Tensor, GridShape], Tensor]
    hash_position_gradient: Callable[[Tensor, Tensor, Tensor, GridShape], Tensor]
    hash_mlp: Callable[[Tensor, Tensor, GridShape, tuple[Tensor, Tensor, Tensor, Tensor]], Tensor]
    ray_mlp: Callable[[Tensor, Tensor, Tensor, Sequence[Tensor]], Tensor]
    adam_rows: Callable[..., None]
    on_rays: RayKernels | None = None
    """None where the references in plain torch run."""
    supports_graphs: bool = False
    """Whether a CUDA graph can hold a training step."""
    fuses_pruning: bool = False
    """Whether pruned rendering has kernels of its own, without which it does not pay."""


@cache
def kernels(backend: Backend) -> Kernels:
    """The functions of a backend.  Numba and Triton take time to import, so each is imported here only."""
    if backend == "numba":
        return _numba_kernels()
    if backend == "triton":
        from plnerf.ops import cuda_adam, cuda_hash, cuda_lens, cuda_rays, cuda_stepfun, cuda_volume

        def hash_mlp(
            x: Tensor, table: Tensor, grid: GridShape, weights: tuple[Tensor, Tensor, Tensor, Tensor]
        ) -> Tensor:
            return reference.mlp_on(cuda_hash.hash_encode(x, table, grid), weights)

        return Kernels(
            cuda_hash.hash_encode,
            cuda_hash.hash_position_gradient,
            hash_mlp,
            reference.ray_mlp,  # on a GPU plain torch is what is fast
            cuda_adam.adam_rows,
            RayKernels(
                cuda_rays.s_to_t,
                cuda_rays.frustum_features,
                cuda_volume.weights_from_density,
                cuda_stepfun.resample_edges,
                cuda_volume.render_rays,
                cuda_stepfun.interlevel_loss,
                cuda_stepfun.distortion_loss,
                cuda_lens.cast_rays,
            ),
            supports_graphs=True,
        )
    return Kernels(
        reference.hash_encode,
        reference.hash_position_gradient,
        reference.hash_mlp,
        reference.ray_mlp,
        reference.adam_rows,
    )


def _numba_kernels() -> Kernels:
    from plnerf.ops import (
        cpu_adam,
        cpu_curves,
        cpu_hash,
        cpu_hash_mlp,
        cpu_histograms,
        cpu_lens,
        cpu_mlp,
        cpu_rays,
        cpu_stepfun,
        cpu_volume,
    )  # fmt: skip

    return Kernels(
        cpu_hash.hash_encode,
        cpu_hash.hash_position_gradient,
        cpu_hash_mlp.hash_mlp,
        cpu_mlp.ray_mlp,
        cpu_adam.adam_rows,
        RayKernels(
            cpu_rays.s_to_t,
            cpu_rays.frustum_features,
            cpu_volume.weights_from_density,
            cpu_stepfun.resample_edges,
            cpu_volume.render_rays,
            cpu_stepfun.interlevel_loss,
            cpu_stepfun.distortion_loss,
            cpu_lens.cast_rays,
            cpu_histograms.blurred_interlevel_loss,
            cpu_histograms.dilate,
            cpu_curves.windows,
            cpu_curves.lay_edges,
            cpu_curves.in_tubes,
        ),
        fuses_pruning=True,
    )


def resolve_backend(choice: BackendChoice, on: device, fault_of: FaultOf) -> Backend:
    """The backend for a device: Numba on a CPU, Triton on a CUDA device, plain torch elsewhere, unless one is
    asked for.  Triton's kernels are tested by `fault_of` before.

    Warns where a CUDA device is left with plain torch, since Triton is not installed or its kernels do not
    compute there what the reference does.  Raises ConfigError where the asked-for backend cannot run on the
    device.
    """
    if choice == "auto":
        return _default_backend(on, fault_of)
    if choice == "numba" and on.type != "cpu":
        raise ConfigError(
            f"The backend 'numba' runs on a CPU, but the device is {on}. "
            f"Choose --backend torch or --device cpu."
        )
    if choice == "triton":
        _check_triton(on, fault_of)
    return choice


def _default_backend(on: device, fault_of: FaultOf) -> Backend:
    if on.type == "cpu":
        return "numba"
    if on.type != "cuda":
        return "torch"
    if not find_spec("triton"):
        warnings.warn(
            "Triton is not installed, so the ops run in plain torch, which is much slower. "
            "It comes with PyTorch's Linux builds for CUDA: pip install triton.",
            stacklevel=2,
        )
        return "torch"
    if fault := fault_of("triton", on):
        warnings.warn(
            f"The Triton kernels fail their self-test on {on}, so the ops run in plain torch, which is much "
            f"slower: {fault}. Triton needs a C compiler (gcc) and a driver that fits PyTorch's CUDA.",
            stacklevel=2,
        )
        return "torch"
    return "triton"


def _check_triton(on: device, fault_of: FaultOf) -> None:
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
    if on.type == "cuda" and (fault := fault_of("triton", on)):
        raise ConfigError(
            f"The backend 'triton' was asked for, but its kernels fail their self-test on {on}: {fault}. "
            "Choose --backend torch. Triton needs a C compiler (gcc) and a driver that fits PyTorch's CUDA."
        )


def hash_encode(
    x: Float[Tensor, "n 3"], table: Float[Tensor, "rows F"], grid: GridShape, backend: Backend
) -> Float[Tensor, "n LF"]:
    """Multi-resolution hash encoding of points in [0, 1]^3; see `reference.hash_encode`."""
    return kernels(backend).hash_encode(x, table, grid)


def hash_position_gradient(
    x: Float[Tensor, "n 3"],
    g_out: Float[Tensor, "n LF"],
    table: Float[Tensor, "rows F"],
    grid: GridShape,
    backend: Backend,
) -> Float[Tensor, "n 3"]:
    """Gradient of <g_out, hash_encode(x)> with respect to x; see `reference.hash_position_gradient`."""
    return kernels(backend).hash_position_gradient(x, g_out, table, grid)


def hash_mlp(
    x: Float[Tensor, "n 3"],
    table: Float[Tensor, "rows F"],
    grid: GridShape,
    weights: tuple[Tensor, Tensor, Tensor, Tensor],
    backend: Backend,
) -> Float[Tensor, " n"]:
    """A hash encoding and a network of one hidden layer on top; see `reference.hash_mlp`."""
    return kernels(backend).hash_mlp(x, table, grid, weights)


def ray_mlp(
    x: Float[Tensor, "r S I"],
    const: Float[Tensor, "r S J"],
    base: Float[Tensor, "r H"],
    weights: Sequence[Tensor],
    backend: Backend,
) -> Float[Tensor, "r S O"]:
    """A network on the samples of rays; see `reference.ray_mlp`."""
    return kernels(backend).ray_mlp(x, const, base, weights)
