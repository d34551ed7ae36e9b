"""Where the time of a training step goes: torch.profiler's own times, each given to one part of the method.

A part is found by, in this order: the op itself (hash encoding, fused ops, matrix products); the nearest
labelled function around it; for an op of the backward pass, the label of the op whose gradient it is.  What
no part claims, and the time between ops, is "other".  The profiler slows small ops more than large ones.
For a CPU: on a GPU these are the times of handing the work over, not of doing it.
"""

import os
import re
import statistics
import sys
from collections import defaultdict
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import wraps
from importlib import import_module
from itertools import pairwise
from pathlib import Path
from typing import Any

from rich.console import Console
from torch import Tensor
from torch.autograd import Function
from torch.autograd.profiler_util import FunctionEvent
from torch.profiler import ProfilerActivity, profile, record_function

from plnerf.bench.config import BenchConfig
from plnerf.bench.tables import Table, figure, percent
from plnerf.bench.train_suite import scene_of, settings_of
from plnerf.console import bar
from plnerf.pipeline import train_scene
from plnerf.scene.build_store import Progress
from plnerf.train.report import SilentReport

WARM_STEPS, PROFILED_STEPS = 60, 60
LABELS = (
    ("plnerf.train.pixels", "PixelSampler.draw", "batch"),
    ("plnerf.train.optimizer", "TableAdam.step", "optimiser"),
    ("plnerf.train.optimizer", "TableAdam.zero_grad", "optimiser"),
    ("plnerf.rays.rays", "pixel_rays", "batch"),
    ("plnerf.render.model", "PLNeRF.forward", "field and rendering, rest"),
    ("plnerf.render.proposals", "sample_along_rays", "sampling, rest"),
    ("plnerf.train.losses", "loss_terms", "losses"),
)
"""Module, function or method of a class there, and the part it belongs to; the innermost counts."""
_NETWORKS = "networks, matrix products"
OP_FILES = {
    "cpu_hash": "hash encoding",
    "cpu_hash_normals": "hash encoding",
    "cpu_mlp": _NETWORKS,
    "cuda_hash": "hash encoding",
    "cpu_hash_mlp": "proposal densities, fused",
}
"""Parts of the autograd functions of plnerf.ops, by file; those of other files go where they are called."""
_PRODUCT = re.compile(r"aten::(addmm|mm|bmm|baddbmm|addmv|mv|linear|mkldnn_linear)$")
_STEP, _LABEL = "a step", "part: "


@dataclass(frozen=True)
class Breakdown:
    """Seconds of one step: the mean over the quieter half of the profiled steps."""

    all_steps_s: tuple[float, ...]
    """Wall-clock seconds of every profiled step."""
    step_s: float
    """Mean of the quieter half of them."""
    unprofiled_step_s: float
    """Mean of the quieter half of the steps before, without the profiler."""
    parts_s: tuple[tuple[str, float], ...]
    """By part, the largest first, "other" last; they add up to `step_s`."""


class _ProfilingReport(SilentReport):
    """Starts the profiler once the run is warm, and has it know where a step begins and ends."""

    def __init__(self, progress: Progress) -> None:
        super().__init__()
        self._profile = profile(activities=[ProfilerActivity.CPU])
        self._range = record_function(_STEP)
        self._progress, self._seconds = progress, list[float]()

    def step(self, step: int, seconds: float, progress: float, terms: Mapping[str, Tensor]) -> None:
        """Ends the range of one step and begins that of the next."""
        super().step(step, seconds, progress, terms)
        self._progress(step, WARM_STEPS + PROFILED_STEPS)
        if step > WARM_STEPS:
            self._range.__exit__(None, None, None)
        else:
            self._seconds.append(seconds)
        if step == WARM_STEPS:
            self._profile.start()
        if step == WARM_STEPS + PROFILED_STEPS:
            self._profile.stop()
        elif step >= WARM_STEPS:
            self._range = record_function(_STEP)
            self._range.__enter__()

    def breakdown(self) -> Breakdown:
        """Own times of all events by part."""
        before = sorted(b - a for a, b in pairwise(self._seconds[WARM_STEPS // 3 :]))
        events = list(self._profile.events() or [])
        return summed(events, statistics.fmean(before[: len(before) // 2]))


def profile_training(bench: BenchConfig, out: Path, console: Console) -> Breakdown:
    """Trains some steps of the bench's scene into a new run folder, the last of them profiled."""
    os.environ.setdefault("KINETO_LOG_LEVEL", "99")  # the profiler would say on the console that it begins
    settings = settings_of(bench)
    train = replace(settings.train, validations=0, checkpoints=1)  # nothing but steps
    with bar(console, "profile") as progress, labelled():
        report = _ProfilingReport(progress)
        train_scene(
            scene_of(bench), out, preset=bench.preset, steps=WARM_STEPS + PROFILED_STEPS,
            model=settings.model, train=train, detect=settings.detect, downscale=bench.downscale,
            seed=bench.seed, device=bench.device, backend=bench.backend, report=report,
        )  # fmt: skip
    return report.breakdown()


@contextmanager
def labelled() -> Iterator[None]:
    """Has the profiler know the functions of `LABELS`, wherever they are called from, within the context."""
    replaced: list[tuple[Any, str, Any]] = []
    try:
        for module, name, part in LABELS:
            owner: Any = import_module(module)
            *outer, last = name.split(".")
            for attribute in outer:
                owner = getattr(owner, attribute)
            original = getattr(owner, last)
            marked = _with_label(original, part)
            for place in [owner] if outer else _plnerf_modules():
                if vars(place).get(last) is original:
                    replaced.append((place, last, original))
                    setattr(place, last, marked)
        yield
    finally:
        for place, last, original in replaced:
            setattr(place, last, original)


def _plnerf_modules() -> list[Any]:
    """Those that are loaded: each may have imported the function by its name."""
    return [module for name, module in sys.modules.items() if name.startswith("plnerf.")]


def _with_label(function: Any, part: str) -> Any:
    @wraps(function)
    def with_label(*args: Any, **kwargs: Any) -> Any:
        with record_function(_LABEL + part):
            return function(*args, **kwargs)

    return with_label


def op_parts() -> dict[str, str]:
    """Part of each autograd function of plnerf.ops that is loaded, by its name."""
    parts = {}
    for module, part in OP_FILES.items():
        loaded = sys.modules.get(f"plnerf.ops.{module}")
        for name, value in vars(loaded).items() if loaded else ():
            if isinstance(value, type) and issubclass(value, Function) and value is not Function:
                parts[name] = parts[f"{name}Backward"] = part
    return parts


def summed(events: list[FunctionEvent], unprofiled_step_s: float) -> Breakdown:
    """The own times of profiler events by part, over the quieter half of the steps."""
    ops, by_sequence = op_parts(), dict[int, str]()
    for event in events:
        # The last forward op with a sequence number is the one that made the node of the graph.
        if event.scope == 0 and event.sequence_nr >= 0 and (label := _label_around(event)):
            by_sequence[event.sequence_nr] = label
    steps = [event for event in events if event.name == _STEP]
    quiet = sorted(steps, key=lambda step: step.cpu_time_total)[: max(1, len(steps) // 2)]
    chosen = {step.id for step in quiet}
    totals: dict[str, float] = defaultdict(float)
    for event in events:
        if _root(event).id in chosen:
            totals[_part(event, ops, by_sequence)] += 1e-6 * event.self_cpu_time_total / len(quiet)
    other = totals.pop("other", 0.0)
    parts = sorted(totals.items(), key=lambda item: -item[1])
    return Breakdown(
        all_steps_s=tuple(1e-6 * step.cpu_time_total for step in steps),
        step_s=statistics.fmean(1e-6 * step.cpu_time_total for step in quiet),
        unprofiled_step_s=unprofiled_step_s,
        parts_s=(*parts, ("other", other)),
    )


def _root(event: FunctionEvent) -> FunctionEvent:
    while event.cpu_parent is not None:
        event = event.cpu_parent
    return event


def _part(event: FunctionEvent, ops: Mapping[str, str], by_sequence: Mapping[int, str]) -> str:
    if _PRODUCT.match(event.name):
        return _NETWORKS
    place: FunctionEvent | None = event
    while place is not None:
        if place.name in ops:
            return ops[place.name]
        if place.name.startswith(_LABEL):
            return place.name.removeprefix(_LABEL)
        if place.name.startswith("autograd::engine::evaluate_function"):
            node = place.name.split(": ")[-1]
            return ops.get(node) or by_sequence.get(place.sequence_nr, "other")
        place = place.cpu_parent
    return "other"


def _label_around(event: FunctionEvent) -> str | None:
    place: FunctionEvent | None = event
    while place is not None:
        if place.name.startswith(_LABEL):
            return place.name.removeprefix(_LABEL)
        place = place.cpu_parent
    return None


def breakdown_table(breakdown: Breakdown) -> Table:
    """The parts of a step."""
    rows = [
        (part, figure(1e3 * seconds), percent(seconds / breakdown.step_s))
        for part, seconds in breakdown.parts_s
    ]
    rows.append(("**a step**", figure(1e3 * breakdown.step_s), percent(1.0)))
    note = (
        f"Mean of the quieter half of {len(breakdown.all_steps_s)} steps under torch.profiler, forward and "
        f"backward together; without it, just before, {figure(1e3 * breakdown.unprofiled_step_s)} ms. "
        "Other is what no part claims: Python between the ops, reading the loss, the graph's own work."
    )
    return Table("A training step", ("part", "ms", "share"), tuple(rows), (note,))
