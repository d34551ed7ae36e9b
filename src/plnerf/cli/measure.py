"""The commands that measure: the machine, and systems against one another."""

from pathlib import Path
from typing import Literal

import tyro
from rich.console import Console

from plnerf.cli.options import Out, PresetName, PresetNames


def bench(  # noqa: PLR0913 (an argument is an option)
    *,
    suite: tuple[str, ...] = ("ops", "train", "render"),
    out: Out = Path("runs/bench"),
    scene: Path | None = None,
    run: Path | None = None,
    preset: PresetName = "pl-nerf",
    downscale: int = 1,
    seconds: float = 60.0,
    targets: tuple[float, ...] = (18.0, 20.0, 22.0),
    seed: int = 0,
    device: Literal["auto", "cpu", "cuda"] = "auto",
    backend: Literal["auto", "torch", "numba", "triton"] = "auto",
    set: tyro.conf.UseAppendAction[tuple[str, ...]] = (),
    quick: bool = False,
) -> None:
    """Measure this machine with plnerf: ops against plain torch, training, rendering.

    Args:
        suite: What to measure: ops, train, render, span (wires found by each preset).
        out: New folder for bench.json, bench.md and the runs that are made.
        scene: Scene to train on, for the suite span also a folder of scenes; the bundled span when left out.
        run: Finished run to render; one is trained when left out.
        preset: Named settings to start from.
        downscale: Integer factor by which images are made smaller.
        seconds: Training budget of the suite train.
        targets: Held-out PSNRs in dB whose times are told.
        seed: Decides the initial weights and every random draw.
        device: Where to measure.
        backend: Implementation of the ops.
        set: A setting to change, as path.to.key=value.
        quick: Small shapes and few repeats: to see that all works, not to quote.
    """
    from plnerf.bench.config import BenchConfig
    from plnerf.bench.suites import run_bench

    config = BenchConfig(
        out, suite, scene, run, preset, set, downscale, seconds, targets, seed, device, backend, quick
    )
    run_bench(config, Console())


def compare(  # noqa: PLR0913 (an argument is an option)
    scene: tyro.conf.Positional[Path],
    *,
    out: Out = Path("runs/compare"),
    presets: PresetNames = (),
    steps: int | None = None,
    seconds: float | None = None,
    downscale: int = 1,
    seed: int = 0,
    device: Literal["auto", "cpu", "cuda"] = "auto",
    backend: Literal["auto", "torch", "numba", "triton"] = "auto",
    set: tyro.conf.UseAppendAction[tuple[str, ...]] = (),
) -> None:
    """Train several systems on one scene at the same budget, and write what each makes of it side by side.

    Args:
        scene: Scene folder.
        out: Folder for the runs, compare.md, compare.html, compare.json, curves.svg and sheet.png.
        presets: Systems to compare, in this order.
        steps: Budget of each in steps.
        seconds: Budget of each in seconds of training; 240 when neither this nor --steps is given.
        downscale: Integer factor by which images are made smaller.
        seed: Decides the initial weights and every random draw, in all of them.
        device: Where to train.
        backend: Implementation of the ops.
        set: A setting to change in all of them, as path.to.key=value.
    """
    from plnerf.bench.compare import CompareConfig
    from plnerf.bench.compare import compare as run_comparison
    from plnerf.pipeline import presets_by_year

    if steps is None and seconds is None:
        seconds = 240.0
    config = CompareConfig(
        scene, out, presets or presets_by_year(), steps, seconds, downscale, set, seed, device, backend
    )
    console = Console()
    page = run_comparison(config, console).parent / "compare.html"
    console.print(f"comparison: {page}, compare.md, compare.json", markup=False, soft_wrap=True)
