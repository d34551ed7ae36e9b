"""The commands that measure: the machine, and systems against one another."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import tyro

from plnerf.cli.options import AsOptions, BackendName, Device, Out, PresetName, PresetNames
from plnerf.errors import ConfigError
from plnerf.terminal import Terminal
from plnerf.train.config import Settings


@dataclass(frozen=True)
class Measuring:
    """A command that needs the settings of several presets, parsed for one of them."""

    settings: Settings
    run: Callable[[Mapping[str, Settings]], object]


def measure(parsed: Mapping[str, Measuring]) -> None:
    """Runs a command that was parsed once for each preset: its options on top of each one's settings."""
    next(iter(parsed.values())).run({name: one.settings for name, one in parsed.items()})


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
    device: Device = "auto",
    backend: BackendName = "auto",
    quick: bool = False,
    seeds: tuple[int, ...] = tuple(range(41, 80, 2)),
    image_seeds: tuple[int, ...] = (),
    scenes: tuple[Path, ...] = (),
    settings: AsOptions,
) -> Measuring:
    """Measure this machine with plnerf: ops against plain torch, training, rendering; if intervals hold.

    Args:
        suite: What to measure: ops, train, render, span (wires found by each preset), coverage (whether
            the intervals of surveys hold; an interrupted one goes on).
        out: New folder for bench.json, bench.md and the runs that are made.
        scene: Scene to train on, for the suite span also a folder of scenes; the bundled span when left out.
        run: Finished run to render; one is trained when left out.
        preset: Named settings to start from; --help-all shows their values.
        downscale: Integer factor by which images are made smaller.
        seconds: Training budget of the suite train.
        targets: Held-out PSNRs in dB whose times are reported.
        seed: Decides the initial weights and every random draw.
        device: Where to measure.
        backend: Implementation of the ops.
        quick: Small shapes and few repeats: to see that all works, not to quote.
        seeds: Seeds of the LiDAR flights over spans in wind that the suite coverage simulates.
        image_seeds: Seeds of the random scenes that it renders, minutes each.
        scenes: Folders of rendered scenes that it takes as they are.
        settings: Settings of the runs.
    """
    from plnerf.bench.config import BenchConfig
    from plnerf.bench.suites import run_bench

    config = BenchConfig(
        out, suite, scene, run, preset, {}, downscale, seconds, targets, seed, device, backend, quick,
        seeds, image_seeds, scenes,
    )  # fmt: skip
    return Measuring(settings, lambda systems: run_bench(replace(config, systems=systems), Terminal()))


def compare(  # noqa: PLR0913 (an argument is an option)
    scene: tyro.conf.Positional[Path],
    *,
    out: Out = Path("runs/compare"),
    presets: PresetNames = (),
    steps: int | None = None,
    seconds: float | None = None,
    downscale: int = 1,
    seed: int = 0,
    device: Device = "auto",
    backend: BackendName = "auto",
    settings: AsOptions,
) -> Measuring:
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
        settings: Settings changed in all of them; what is not given stays as each preset has it.
    """
    from plnerf.bench.compare import CompareConfig
    from plnerf.bench.compare import compare as run_comparison
    from plnerf.console import say

    if steps is None and seconds is None:
        seconds = 240.0
    if len(set(presets)) < len(presets):
        raise ConfigError(f"--presets takes one or more, each once, but got {' '.join(presets)}.")

    def run(systems: Mapping[str, Settings]) -> None:
        console = Terminal()
        config = CompareConfig(scene, out, systems, steps, seconds, downscale, seed, device, backend)
        page = run_comparison(config, console).with_name("compare.html")
        say(console, f"comparison: {page}, compare.md, compare.json")

    return Measuring(settings, run)
