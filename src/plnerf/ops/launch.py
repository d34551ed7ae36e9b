"""How the kernels of rays are called on a CPU: with arrays of one type, on one thread or on all.

No ray's numbers depend on another's, so that results do not depend on the number of threads.  Waking threads
costs about 40 us, as much as a kernel has to do for some hundred rays: small work stays on one thread.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from torch import Tensor

from plnerf.ops.cpu_arrays import num_threads
from plnerf.ops.threads import share

_WORTH_WAKING_NS = 120_000


def arrays(*tensors: Tensor) -> tuple[np.ndarray, ...]:
    """Contiguous arrays of tensors of one type, float32 or float64; TypeError for others.

    A kernel would be compiled for any mixture, and compute in the wider type.
    """
    found = {tensor.dtype for tensor in tensors}
    if len(found) != 1 or not found <= {torch.float32, torch.float64}:
        raise TypeError(f"The CPU kernels need tensors of one type, float32 or float64, but got {found}.")
    return tuple(tensor.detach().contiguous().numpy() for tensor in tensors)


def launch(kernel: Callable[..., Any], *arguments: Any, rays: int, samples: int, ns: float) -> None:
    """Runs a kernel over all rays; `ns` is about what one thread needs for a sample, in nanoseconds."""
    share(kernel, *arguments, of=rays, threads=num_threads() if samples * ns > _WORTH_WAKING_NS else 1)


def refuse_gradients(op: str, **tensors: Tensor) -> None:
    """Silence would be a wrong gradient: NotImplementedError where a constant of an op asks for one."""
    if torch.is_grad_enabled() and (asking := [k for k, tensor in tensors.items() if tensor.requires_grad]):
        raise NotImplementedError(
            f"The kernel of {op} has no gradient by {', '.join(asking)}: detach it, or use the backend torch."
        )
