"""`plnerf reconstruct SOURCE -o OUT`, and its stages by themselves, in seconds and to the same bits.

The command line, its handling of signals and errors and all stages are those of users; the model is small,
the budget is in steps in place of seconds, and the path has two frames.  Each process is forked from a server
that has imported everything, may be disturbed, and shares nothing else with the one that tests.
"""

import multiprocessing
import os
import resource
import signal
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from multiprocessing.context import ForkServerProcess
from pathlib import Path
from typing import Any

from tests.faults.changes import NONE, Changes, Fault

STEPS = 24
ONE_THREAD = {name: "1" for name in ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS", "OPENBLAS_NUM_THREADS")}
"""Idle threads would spin; that results are equal for any number of threads is tested elsewhere."""
LIMIT_S = 300.0


def start(
    source: Path,
    out: Path,
    fault: Fault = NONE,
    command: Sequence[str] = (),
    environment: Mapping[str, str] | None = None,
    **limits: int,
) -> ForkServerProcess:
    """Starts the command; what it prints goes to `log_of(out)`.

    command: the arguments of plnerf in place of `reconstruct SOURCE -o OUT`.
    environment: further variables of the process.
    limits: by the names of `resource`, such as RLIMIT_FSIZE, in bytes.
    """
    arguments = [*command] or ["reconstruct", str(source), "-o", str(out)]
    os.environ.update(ONE_THREAD)
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["tests.faults.preloaded"])
    process = context.Process(target=_main, args=(arguments, str(out), fault, environment or {}, limits))
    process.start()
    return process


def run(source: Path, out: Path, fault: Fault = NONE, command: Sequence[str] = (), **limits: int) -> int:
    """Exit status of the command, or minus the signal that ended it; arguments as of `start`."""
    process = start(source, out, fault, command, **limits)
    process.join(LIMIT_S)
    if process.exitcode is None:
        process.kill()
        raise AssertionError(f"still runs after {LIMIT_S:g} s: {log_of(out).read_text()}")
    return process.exitcode


def log_of(out: Path) -> Path:
    """Standard output and error of the last command."""
    return out.with_name(f"{out.name}.log")


def stages_of(out: Path) -> dict[str, range]:
    """The stages that the last command began, each with its changes of files, numbered from 1.

    Of one that was killed, the last stage has one change.
    """
    lines = [line.split() for line in out.with_name(f"{out.name}.stages").read_text().splitlines()]
    firsts = [int(first) for _, first in lines]
    ends = [*firsts[1:], firsts[-1] + 1]
    named = zip(lines, firsts, ends, strict=True)
    return {name: range(first, end) for (name, _), first, end in named if name != "end"}


def _main(
    arguments: list[str], out: str, fault: Fault, environment: Mapping[str, str], limits: dict[str, int]
) -> None:
    os.environ.update(environment)
    log = os.open(log_of(Path(out)), os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    for stream in (1, 2):
        os.dup2(log, stream)
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background jobs ignore it
    for name, value in limits.items():
        resource.setrlimit(getattr(resource, name), (value, value))
    changes = Changes(Path(out), fault)
    with Path(out).with_name(f"{Path(out).name}.stages").open("w", buffering=1) as stages:

        def begun(stage: str) -> None:
            stages.write(f"{stage} {changes.count + 1}\n")
            changes.begin(stage)

        _make_small(begun)
        sys.addaudithook(changes)
        from plnerf.cli.main import main

        sys.argv = ["plnerf", *arguments]
        begun("start")
        try:
            main()
        finally:
            for number in (signal.SIGINT, signal.SIGTERM):
                signal.signal(number, signal.SIG_IGN)  # they come too late
            begun("end")


def _make_small(begun: Callable[[str], None]) -> None:
    """Has the command line call its stages with small settings; begun: called with each stage's name."""
    from tests.support.tiny_run import small

    import plnerf.cli.capture as making
    import plnerf.cli.survey as measuring
    import plnerf.cli.train as training
    from plnerf.capture.capture import CaptureConfig
    from plnerf.capture.sfm import SfmConfig

    lens = CaptureConfig(SfmConfig(camera_model="SIMPLE_PINHOLE", features=1500, threads=1))
    settings = small("train.checkpoints=4", "train.rays=64", "train.find_wires=true")

    def noted(name: str, stage: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any, **options: Any) -> Any:
            begun(name)
            return stage(*arguments, **options)

        return call

    def train(*places: Any, preset: str, seconds: float, **options: Any) -> None:
        in_full(*places, **settings, steps=STEPS, **options)

    in_full, capture = training.train_shown, making.capture_shown
    making.capture_shown = noted("capture", lambda *places: capture(*places[:3], lens))  # type: ignore[assignment]
    training.train_shown = noted("train", train)  # type: ignore[assignment]
    training.resume_shown = noted("train", training.resume_shown)  # type: ignore[assignment]
    training.eval_shown = noted("eval", training.eval_shown)  # type: ignore[assignment]
    training.render_shown = noted("render", partial(training.render_shown, frames=2))  # type: ignore[assignment]
    survey = measuring.survey_shown

    def surveyed(console: Any, source: Path, *places: Any, **options: Any) -> bool:
        begun("survey" if (source / "config.json").exists() else "first")
        return survey(console, source, *places, **options)

    measuring.survey_shown = surveyed
