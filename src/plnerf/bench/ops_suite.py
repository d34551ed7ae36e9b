"""The suite `ops`: each op against its plain-torch reference, and against what the machine can do at most."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import torch
from torch import Tensor

from plnerf.bench.case import Op, OpCase, Work
from plnerf.bench.ceilings import Ceilings, Rate, measure_ceilings
from plnerf.bench.tables import Table, figure, percent
from plnerf.bench.timing import PairedTimes, alternate, timed
from plnerf.errors import PlnerfError
from plnerf.scene.build_store import Progress

NOTES = (
    "Times are medians of pairs measured in turn, reference and kernel; times faster is the median of the "
    "pairs' ratios. Gradients are added to those that are there, as in training.",
    "Shares are the kernel's, of the best rates measured in the same run with all threads: memory is the "
    "triad's, random that of 64-byte lines fetched from a table of the size of the op's largest level, "
    "arithmetic that of float32 matrix products. The work is counted from the equations: what is not needed "
    "counts for nothing. What stays in the caches can go beyond 100 % of the memory's rate, and "
    "points that share lines with their neighbours beyond 100 % of the random rate.",
)


@dataclass(frozen=True)
class Shares:
    """Parts of the ceilings that one pass reaches."""

    memory: float
    random: float | None
    """None for an op without a table."""
    arithmetic: float


@dataclass(frozen=True)
class PassFigures:
    """One pass of one op."""

    op: str
    shape: str
    direction: str
    times: PairedTimes
    work: Work
    shares: Shares
    difference: float
    """Largest difference of kernel and reference, relative to the reference's largest value."""


def measure_ops(
    cases: Sequence[OpCase],
    device: torch.device,
    *,
    least: int,
    seconds: float,
    seed: int = 0,
    small: bool = False,
    progress: Progress | None = None,
) -> tuple[Ceilings, list[PassFigures]]:
    """The ceilings, then every case: at least `least` pairs and `seconds` of each.

    Raises PlnerfError where a kernel does not compute what its reference does: its times would mean nothing.
    """
    ceilings = measure_ceilings([case.table_bytes for case in cases if case.table_bytes], device, small=small)
    figures: list[PassFigures] = []
    for done, case in enumerate(cases, start=1):
        figures += measure_op(case, ceilings, device, least=least, seconds=seconds, seed=seed)
        if progress is not None:
            progress(done, len(cases))
    return ceilings, figures


def measure_op(
    case: OpCase, ceilings: Ceilings, device: torch.device, *, least: int, seconds: float, seed: int
) -> list[PassFigures]:
    """One case: its forward pass and, where it has one, its backward pass."""
    reference, kernel = (_Run(case, op, device, seed) for op in (case.reference, case.kernel))
    reference.sample(), kernel.sample()
    differences = [difference(a, b) for a, b in zip(reference.values(), kernel.values(), strict=True)]
    wrong = [value for value in differences if not value <= case.tolerance]  # NaN is wrong, too
    if wrong:
        raise PlnerfError(
            f"The kernel of {case.name!r} ({case.shape}) does not compute what its reference does: outputs "
            f"or gradients differ by {wrong[0]:.2g} of the reference's largest value, where "
            f"{case.tolerance:.2g} is allowed. No times were written. Run the tests of this op; "
            "another --backend may be sound."
        )
    times = alternate(reference.sample, kernel.sample, least=least, seconds=seconds)
    works = [("forward", case.forward), *([("backward", case.backward)] if case.backward else [])]
    rate = ceilings.gather(case.table_bytes) if case.table_bytes else None
    return [
        PassFigures(
            op=case.name,
            shape=case.shape,
            direction=direction,
            times=paired,
            work=work,
            shares=shares_of(work, paired.kernel_median_s, ceilings, rate),
            difference=max(differences),
        )
        for (direction, work), paired in zip(works, times, strict=True)
    ]


def shares_of(work: Work, seconds: float, ceilings: Ceilings, gather: Rate | None) -> Shares:
    """What a pass of so many seconds reaches of each ceiling."""
    return Shares(
        memory=work.bytes_moved / seconds / ceilings.triad.per_second,
        random=None if gather is None else work.lines / seconds / gather.per_second,
        arithmetic=work.flops / seconds / ceilings.float32.per_second,
    )


def difference(found: Tensor, reference: Tensor) -> float:
    """Largest difference of two tensors, relative to the largest value of the second; NaN with a NaN."""
    scale = reference.abs().max().clamp_min(torch.finfo(reference.dtype).tiny)
    return float(((found - reference).abs().max() / scale).item())


class _Run:
    """An op with inputs of its own, drawn from the seed: the same for reference and kernel."""

    def __init__(self, case: OpCase, op: Op, device: torch.device, seed: int) -> None:
        inputs = case.setup(torch.Generator().manual_seed(seed))
        self._op, self._device, self._backward = op, device, case.backward is not None
        self._prepare = case.prepare
        self._inputs = tuple(_moved(value, device) for value in inputs)
        self._outputs: tuple[Tensor, ...] = ()
        self._cotangents: tuple[Tensor, ...] = ()

    def sample(self) -> tuple[float, ...]:
        """Seconds of the forward pass and, if there is one, of the backward pass."""
        if self._prepare is not None:
            self._prepare(*self._inputs)
        seconds, out = timed(lambda: self._op(*self._inputs), self._device)
        self._outputs = out if isinstance(out, tuple) else (out,)
        if not self._backward:
            return (seconds,)
        outputs = [output for output in self._outputs if output.requires_grad]
        if not self._cotangents:
            generator = torch.Generator().manual_seed(3)
            self._cotangents = tuple(
                torch.randn(output.shape, generator=generator).to(output) for output in outputs
            )
        back, _ = timed(lambda: torch.autograd.backward(outputs, self._cotangents), self._device)
        return seconds, back

    def values(self) -> list[Tensor]:
        """What one sample computed: outputs, then gradients."""
        gradients = [value.grad for value in self._inputs if value.grad is not None]
        return [value.detach().clone() for value in (*self._outputs, *gradients)]


def _moved(value: Tensor, device: torch.device) -> Tensor:
    moved = value.detach().clone().to(device)
    if value.requires_grad:
        moved.requires_grad_()
        moved.grad = torch.zeros_like(moved)
    return moved


def ops_tables(ceilings: Ceilings, figures: Sequence[PassFigures]) -> tuple[Table, ...]:
    """The ops, and the ceilings they are compared with."""
    rows = []
    for one in figures:
        times, shares = one.times, one.shares
        medians = (times.reference_median_s, times.kernel_median_s)
        milliseconds = (figure(1e3 * seconds) for seconds in medians)
        parts = (percent(share) for share in (shares.memory, shares.random, shares.arithmetic))
        rows.append((f"{one.op}: {one.direction}", *milliseconds, figure(times.ratio), *parts))
    columns = ("op: pass", "reference ms", "kernel ms", "times faster", "memory", "random", "arithmetic")
    shapes = "; ".join(dict.fromkeys(f"{one.op}: {one.shape}" for one in figures))
    gathers = [rate for _, rate in ceilings.gathers]
    rates = (ceilings.copy, ceilings.triad, ceilings.float32, ceilings.bfloat16, *gathers)
    ceiling_rows = tuple(
        (rate.name, f"{figure(rate.per_second / 1e9)} G{rate.unit}/s", figure(rate.spread)) for rate in rates
    )
    return (
        Table("Ops", columns, tuple(rows), (f"{shapes}.", *NOTES)),
        Table(
            "Ceilings", ("what", "best rate", "median time / best"), ceiling_rows,
            ("Best of several repeats with all threads.",),
        ),
    )  # fmt: skip


def ops_json(ceilings: Ceilings, figures: Sequence[PassFigures]) -> dict[str, Any]:
    """Everything measured, as JSON values."""
    cases = []
    for one in figures:
        derived = {
            "reference_median_s": one.times.reference_median_s,
            "kernel_median_s": one.times.kernel_median_s,
            "median_ratio": one.times.ratio,
        }
        cases.append({**asdict(one), **derived})
    return {"ceilings": asdict(ceilings), "cases": cases}
