"""What this machine can do at most, measured beside the ops: memory in order, memory at random, arithmetic.

Each is the best of several repeats, as STREAM counts (McCalpin 1995): bytes that the program reads and
writes, without what the processor fetches to be able to write.
"""

import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import torch
from torch import Tensor
from torch.nn.functional import embedding_bag

from plnerf.bench.timing import timed

LINE_BYTES = 64
"""What a processor fetches at once."""
_BAG = 64  # rows that are summed: what is written is then little beside what is read


@dataclass(frozen=True)
class Rate:
    """The best rate of some repeats."""

    name: str
    unit: str
    per_second: float
    raw_s: tuple[float, ...]

    @property
    def spread(self) -> float:
        """Median time over the best one: above 1.1 the machine was busy with something else."""
        return statistics.median(self.raw_s) / min(self.raw_s)


@dataclass(frozen=True)
class Ceilings:
    """All threads together."""

    copy: Rate
    triad: Rate
    """a = b + s c over arrays far larger than the caches, in bytes."""
    float32: Rate
    """Product of square matrices, in floating-point operations."""
    bfloat16: Rate
    gathers: tuple[tuple[int, Rate], ...]
    """By the bytes of a table: lines of 64 bytes fetched from random places of it."""

    def gather(self, table_bytes: int) -> Rate:
        """The rate at which lines are fetched from a table of this size."""
        return dict(self.gathers)[table_bytes]


def measure_ceilings(
    tables: Sequence[int], device: torch.device, *, small: bool = False, repeats: int = 7
) -> Ceilings:
    """Measures all of them; `tables` are the sizes in bytes to fetch at random from.

    small: arrays small enough for tests, whose rates are those of the caches.
    """
    entries, side, lines = (2**16, 128, 2**12) if small else (2**26, 2048, 2**22)
    generator = torch.Generator(device).manual_seed(0)

    def best(name: str, unit: str, amount: int, call: Callable[[], Tensor]) -> Rate:
        call()
        raw = tuple(timed(call, device)[0] for _ in range(repeats))
        return Rate(name, unit, amount / min(raw), raw)

    a, b, c = (torch.ones(entries, device=device) for _ in range(3))
    copy = best("copy", "B", 8 * entries, partial(a.copy_, b))
    triad = best("triad", "B", 12 * entries, partial(torch.add, b, c, alpha=3.0, out=a))
    products = []
    for dtype in (torch.float32, torch.bfloat16):
        square = torch.randn(side, side, generator=generator, device=device).to(dtype)
        name = f"matrix product, {str(dtype).removeprefix('torch.')}"
        products.append(best(name, "flop", 2 * side**3, partial(torch.mm, square, square)))
    gathers = []
    for size in sorted(set(tables)):
        rows = max(1, size // LINE_BYTES)
        table = torch.ones(rows, LINE_BYTES // 4, device=device)
        index = torch.randint(rows, (lines // _BAG, _BAG), generator=generator, device=device).int()
        call = partial(embedding_bag, index, table, mode="sum")
        gathers.append((size, best(f"gather from {size / 2**20:.1f} MiB", "line", index.numel(), call)))
    return Ceilings(copy, triad, products[0], products[1], tuple(gathers))
