"""A run that is killed in the middle and resumed ends with the bits of one that was not.  Real processes."""

import signal
import time
from pathlib import Path
from typing import Any

import pytest
from tests.support.changed import options
from tests.support.forked import Forked
from tests.support.tiny_run import SMALL, assert_same_bits, log_of, newest_tensors

from plnerf.train.checkpoint import list_checkpoints

STEPS, EVERY = 90, 6  # of a run, and between two checkpoints


def train_arguments(scene: Path, out: Path) -> list[str | Path]:
    settings = (*SMALL, "train.validations=6", f"train.checkpoints={STEPS // EVERY}")
    return ["train", scene, "-o", out, "--steps", str(STEPS), "--seed", "3", *options(settings)]


def newest_step(run: Path) -> int:
    return max(
        (int(path.stem.removeprefix("step-")) for path in list_checkpoints(run / "checkpoints")), default=0
    )


def kill_at(step: int, run: Path, *arguments: str | Path) -> int:
    """Starts the command and kills it once the run's newest checkpoint is of the step; returns that step."""
    process = Forked(*arguments)
    give_up = time.monotonic() + 100
    while newest_step(run) < step:
        assert process.status() is None, f"it ended before it was killed: {process.wait()}"
        assert time.monotonic() < give_up
        time.sleep(0.002)
    process.kill()
    assert process.status() == -signal.SIGKILL
    return newest_step(run)


def told(run: Path) -> list[dict[str, Any]]:
    """The log without what clocks say."""
    return [{k: v for k, v in line.items() if k not in {"seconds", "rays_per_s"}} for line in log_of(run)]


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs a system with SIGKILL")
def test_kill_and_resume_gives_the_bits_of_an_uninterrupted_run(tiny_scene: Path, tmp_path: Path) -> None:
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    status, _, err = Forked(*train_arguments(tiny_scene, whole)).wait()
    assert status == 0, err

    first = kill_at(2 * EVERY, killed, *train_arguments(tiny_scene, killed))
    resume = ["train", tiny_scene, "-o", killed, "--resume"]
    second = kill_at(first + 2 * EVERY, killed, *resume)
    assert 0 < first < second < STEPS
    status, out, err = Forked(*resume).wait()
    assert status == 0, err
    assert f"resumed at step {second}" in out and f"{STEPS} steps in" in out

    assert newest_step(killed) == newest_step(whole) == STEPS
    assert told(killed) == told(whole)  # first, since it says at which step they part
    assert_same_bits(newest_tensors(killed), newest_tensors(whole))
    assert [line["step"] for line in told(whole) if "loss" in line] == [20, 40, 60, 80, 90]
    assert [line["step"] for line in told(whole) if "held_out_psnr_db" in line] == [15, 30, 45, 60, 75, 90]
    leftovers = {path.name for path in (killed / "checkpoints").iterdir()}
    assert leftovers == {f"step-{s}.{suffix}" for s in (84, 90) for suffix in ("json", "safetensors")}
