"""The circumstances of a measurement: machine, versions, memory of this process."""

import platform
import sys
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
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


def peak_resident_bytes() -> int | None:
    """The most memory this process had resident so far (`MEMORY_MEANING`); None where the system tells none.

    Linux's own high-water mark of this program.  What getrusage says there starts from the memory of the
    process that started this one, which is another program; it serves where there is no such mark.
    """
    status = Path("/proc/self/status")
    if status.exists():
        marks = [line for line in status.read_text().splitlines() if line.startswith("VmHWM:")]
        if marks:
            return int(marks[0].split()[1]) * 1024
    if sys.platform == "win32":
        return None
    import resource

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024
