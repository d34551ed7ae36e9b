"""The circumstances of a measurement: machine, versions, memory of this process."""

import platform
from datetime import UTC, datetime
from importlib import metadata
from typing import Any

import numba

import plnerf
from plnerf.ops.cpu_arrays import usable_cores
from plnerf.train.protocol import hardware

MEMORY_MEANING = (
    "high-water mark of the process's resident memory: the interpreter, all loaded libraries, weights, "
    "gradients, optimiser state, compiled kernels, and those pages of the memory-mapped pixels that were "
    "touched; on a GPU not the GPU's own memory"
)


def circumstances(device: str) -> dict[str, Any]:
    """Machine, versions and date of a measurement, as JSON values."""
    return {
        "date_utc": datetime.now(UTC).isoformat(timespec="seconds"),
        "device": device,
        **hardware(device),
        "usable_cores": usable_cores(),
        "numba_threads": numba.get_num_threads(),
        "system": platform.platform(),
        "versions": {
            "plnerf": plnerf.__version__,
            "python": platform.python_version(),
            **{name: version(name) for name in ("torch", "numba", "numpy", "triton")},
        },
    }


def version(package: str) -> str | None:
    """The installed version of a package, None where it is not installed."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None
