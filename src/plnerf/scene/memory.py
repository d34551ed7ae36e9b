"""Whether something fits into memory, asked before it is allocated; and how much a process took.

An allocation that is too large may end the process, or others of the machine, instead of failing.
"""

import math
import sys
from contextlib import suppress
from pathlib import Path

import psutil

from plnerf.errors import ConfigError, PlnerfError

CGROUP = Path("/sys/fs/cgroup")
"""Where Linux states the limits of a container."""
UNASKED = 64e6
"""Bytes that any machine has: so little is not asked for."""


def require_memory(needed: float, what: str, do: str, error: type[PlnerfError] = ConfigError) -> None:
    """Raises an error with the estimate where more bytes are needed than are available.

    needed: an estimate from below.  what: a clause whose subject needs it; do: what needs less.
    """
    if needed > UNASKED and needed > (available := available_bytes()):
        raise error(f"{what} needs at least {_gb(needed)} of memory, but {_gb(available)} are free. {do}")


def require_room_for_threads() -> None:
    """Raises ConfigError where so little memory is left that a new thread may not come to life.

    Python would wait for it for ever.
    """
    require_memory(2 * UNASKED, "A command", "Close other programs, or raise the limit (ulimit -v).")


def available_bytes() -> float:
    """What this process can still allocate: of the machine, its container or its own limit, whichever is
    least."""
    free = min(float(psutil.virtual_memory().available), _below_own_limit())
    with suppress(OSError, ValueError):  # "max" is no number: there is no limit
        limit = float((CGROUP / "memory.max").read_text())
        free = min(free, max(0.0, limit - float((CGROUP / "memory.current").read_text())))
    return free


def peak_resident_bytes() -> int | None:
    """The most memory this process had resident so far; None where the system states none.

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


def _below_own_limit() -> float:
    """What the limit of the process's address space leaves (ulimit -v)."""
    try:
        import resource
    except ImportError:  # Windows has none
        return math.inf
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    if limit == resource.RLIM_INFINITY:
        return math.inf
    return max(0.0, limit - psutil.Process().memory_info().vms)


def _gb(count: float) -> str:
    return f"{count / 1e9:,.1f} GB" if count < 1e15 else f"{count / 1e9:.2g} GB"
