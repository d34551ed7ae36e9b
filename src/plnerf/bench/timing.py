"""Times of two things measured in turn, so that whatever else the machine does meets both alike.

All times are wall-clock seconds.  A pass is what is done before the clock is read again: forward, backward.
"""

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import torch

from plnerf.errors import ConfigError

T = TypeVar("T")
Sample = Callable[[], tuple[float, ...]]
"""Does its work once and returns the seconds of each of its passes."""


@dataclass(frozen=True)
class PairedTimes:
    """Seconds of the truth and of its twin, in the order of measuring; the i-th of both belong together."""

    truth_s: tuple[float, ...]
    twin_s: tuple[float, ...]

    def __post_init__(self) -> None:
        if not self.truth_s or len(self.truth_s) != len(self.twin_s):
            raise ConfigError(
                f"Paired times need one of the truth for each of the twin, but got {len(self.truth_s)} and "
                f"{len(self.twin_s)}."
            )

    @property
    def truth_median_s(self) -> float:
        """Median seconds of the truth."""
        return statistics.median(self.truth_s)

    @property
    def twin_median_s(self) -> float:
        """Median seconds of the twin."""
        return statistics.median(self.twin_s)

    @property
    def ratio(self) -> float:
        """How many times faster the twin is: the median over the pairs, not the ratio of the medians."""
        return statistics.median(a / b for a, b in zip(self.truth_s, self.twin_s, strict=True))


def alternate(truth: Sample, twin: Sample, *, least: int, seconds: float) -> tuple[PairedTimes, ...]:
    """Measures A B A B ...: at least `least` pairs, and more until `seconds` have gone by; one entry a pass.

    Both are done once before, unmeasured: that compiles kernels and fills caches.
    """
    truth(), twin()
    pairs: list[tuple[tuple[float, ...], tuple[float, ...]]] = []
    end = time.perf_counter() + seconds
    while len(pairs) < least or time.perf_counter() < end:
        pairs.append((truth(), twin()))
    passes = range(len(pairs[0][0]))
    return tuple(PairedTimes(tuple(a[i] for a, _ in pairs), tuple(b[i] for _, b in pairs)) for i in passes)


def timed(call: Callable[[], T], device: torch.device) -> tuple[float, T]:
    """Seconds that a call took until the device had done all of it, and what it returned."""
    wait(device)
    clock = time.perf_counter()
    result = call()
    wait(device)
    return time.perf_counter() - clock, result


def wait(device: torch.device) -> None:
    """Returns once the device has done all that it was given; a CPU always has."""
    if device.type == "cuda":
        torch.cuda.synchronize(device)
