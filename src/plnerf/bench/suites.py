"""All suites in order, each in a process of its own, and what they write: bench.json and bench.md.

A process of its own has neither the other suites' memory nor their compiled kernels.  A suite is a function
of the `BenchConfig` that returns a `SuiteResult`; a new one is an entry of `_RUNNERS` and a name in
`config.SUITES`.
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import torch
from rich.console import Console

from plnerf.bench.breakdown import breakdown_table, profile_training
from plnerf.bench.cases import op_cases
from plnerf.bench.config import BenchConfig
from plnerf.bench.coverage_suite import measure_coverage
from plnerf.bench.fresh_process import in_fresh_process
from plnerf.bench.machine import circumstances
from plnerf.bench.ops_suite import measure_ops, ops_json, ops_tables
from plnerf.bench.render_suite import (
    measure_rendering,
    render_json,
    render_table,
    renderers_of,
    run_to_render,
)
from plnerf.bench.span_suite import measure_spans, span_table
from plnerf.bench.tables import Table
from plnerf.bench.train_suite import measure_training, train_json, train_tables
from plnerf.console import bar
from plnerf.errors import ConfigError
from plnerf.ops import reference
from plnerf.ops.dispatch import kernels
from plnerf.pipeline import choose_device
from plnerf.presets._find import find_preset
from plnerf.render.picture_files import write_text
from plnerf.render.self_test import resolve_backend
from plnerf.terminal import Terminal
from plnerf.train.protocol import plain

FORMAT_VERSION = 1


@dataclass(frozen=True)
class SuiteResult:
    """What one suite measured."""

    tables: tuple[Table, ...]
    measured: Mapping[str, Any]
    """JSON values, every raw timing among them."""


def run_bench(bench: BenchConfig, console: Console) -> Path:
    """Runs the suites, prints their tables and returns the path of bench.json, written last.

    Raises PlnerfError where anything cannot be measured; what earlier suites printed stays on the console.
    """
    find_preset(bench.preset)
    device = choose_device(bench.device)
    backend = resolve_backend(bench.backend, torch.device(device))
    about = {
        "format_version": FORMAT_VERSION,
        **circumstances(device),
        "backend": backend,
        "seed": bench.seed,
        "arguments": json.loads(json.dumps(asdict(bench), default=str)),
    }
    suites, pages = dict[str, Any](), [_heading(about)]
    for name in bench.suites:
        result = in_fresh_process(_RUNNERS[name], bench)
        for table in result.tables:
            console.print(table.for_console())
            pages.append(table.markdown())
        suites[name] = result.measured
    write_text(bench.out / "bench.md", "\n".join(pages))
    content = plain({**about, "suites": suites})
    write_text(bench.out / "bench.json", json.dumps(content, indent=1, allow_nan=False) + "\n")
    console.print(f"measures: {bench.out / 'bench.json'}, bench.md", markup=False, soft_wrap=True)
    return bench.out / "bench.json"


def run_ops(bench: BenchConfig) -> SuiteResult:
    """The suite `ops`.  Raises ConfigError for the backend that is the truth itself."""
    device = torch.device(choose_device(bench.device))
    backend = resolve_backend(bench.backend, device)
    if kernels(backend).hash_encode is reference.hash_encode:
        raise ConfigError(
            "The suite ops compares a backend with plain torch, but the backend is torch. Choose another "
            "--backend, or other suites with --suite train render."
        )
    cases = op_cases(backend, small=bench.quick)
    least, seconds = (3, 0.0) if bench.quick else (9, 3.0)
    with bar(Terminal(), "ops") as progress:
        ceilings, figures = measure_ops(
            cases, device, least=least, seconds=seconds, seed=bench.seed, small=bench.quick, progress=progress
        )
    return SuiteResult(ops_tables(ceilings, figures), ops_json(ceilings, figures))


def run_train(bench: BenchConfig) -> SuiteResult:
    """The suite `train`: one run measured, then, on a CPU, a few steps profiled."""
    figures = measure_training(bench, bench.out / "train", Terminal())
    tables, measured = train_tables(figures, bench.targets_db), train_json(figures, bench.targets_db)
    if figures.config.device == "cuda":  # a GPU's ops end long after the CPU has handed them over
        return SuiteResult(tables, measured)
    breakdown = profile_training(bench, bench.out / "profile", Terminal())
    return SuiteResult((*tables, breakdown_table(breakdown)), {**measured, "breakdown": asdict(breakdown)})


def run_render(bench: BenchConfig) -> SuiteResult:
    """The suite `render`."""
    run = run_to_render(bench, Terminal())
    repeats, views = (1, 1) if bench.quick else (3, 3)
    with bar(Terminal(), "render") as progress:
        figures = measure_rendering(run, renderers_of(run), views=views, repeats=repeats, progress=progress)
    return SuiteResult((render_table(run, figures),), render_json(run, figures))


def run_span(bench: BenchConfig) -> SuiteResult:
    """The suite `span`."""
    results = measure_spans(bench, Terminal())
    return SuiteResult((span_table(results, bench.seconds),), {"runs": results})


def run_coverage(bench: BenchConfig) -> SuiteResult:
    """The suite `coverage`."""
    return SuiteResult(*measure_coverage(bench, Terminal()))


_RUNNERS: dict[str, Callable[[BenchConfig], SuiteResult]] = {
    "ops": run_ops,
    "train": run_train,
    "render": run_render,
    "span": run_span,
    "coverage": run_coverage,
}


def _heading(about: Mapping[str, Any]) -> str:
    versions = ", ".join(f"{name} {value}" for name, value in about["versions"].items() if value)
    return (
        f"# plnerf bench\n\n{about['date_utc']}, {about['cpu']}, {about['usable_cores']} cores "
        f"({about['torch_threads']} torch threads, {about['numba_threads']} Numba threads)"
        f"{', ' + about['gpu'] if about['gpu'] else ''}; {versions}; device {about['device']}, backend "
        f"{about['backend']}, seed {about['seed']}.\n"
    )
