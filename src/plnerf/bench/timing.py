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
    """Seconds of the reference and of its kernel, in the order of measuring; the i-th of both are a pair."""

    reference_s: tuple[float, ...]
    kernel_s: tuple[float, ...]

    def __post_init__(self) -> None:
        if not self.reference_s or len(self.reference_s) != len(self.kernel_s):
            raise ConfigError(
                "Paired times need one of the reference for each of the kernel, but got "
                f"{len(self.reference_s)} and {len(self.kernel_s)}."
            )

    @property
    def reference_median_s(self) -> float:
        """Median seconds of the reference."""
        return statistics.median(self.reference_s)

    @property
    def kernel_median_s(self) -> float:
        """Median seconds of the kernel."""
        return statistics.median(self.kernel_s)

    @property
    def ratio(self) -> float:
        """Speed-up of the kernel: the median of the pairs' ratios, not the ratio of the medians."""
        return statistics.median(a / b for a, b in zip(self.reference_s, self.kernel_s, strict=True))


def alternate(reference: Sample, kernel: Sample, *, least: int, seconds: float) -> tuple[PairedTimes, ...]:
    """Measures A B A B ...: at least `least` pairs, and more until `seconds` have gone by; one entry a pass.

    Both are done once before, unmeasured: that compiles kernels and fills caches.
    """
    reference(), kernel()
    pairs: list[tuple[tuple[float, ...], tuple[float, ...]]] = []
    end = time.perf_counter() + seconds
    while len(pairs) < least or time.perf_counter() < end:
        pairs.append((reference(), kernel()))
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
