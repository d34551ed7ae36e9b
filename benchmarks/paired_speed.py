"""Whether a step of training is as fast as in another checkout: `paired_speed.py BEFORE AFTER [--pairs 500]`.

Both checkouts train on the bundled span at the same time, each in a process of its own, and take turns: the
one waits while the other takes a block of steps.  A pair is a block of each, in turn the one or the other
first, so that what else the machine does for longer than a second falls on both.  Start-up, the loading of
kernels and the first steps do not count.  The median of the ratios AFTER / BEFORE is given with its 95 %
interval (of order statistics).
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from scipy.stats import quantile_test

SPAN = Path("src/plnerf/data/span")
PRESET = "pl-nerf"
WARM = 5
"""Pairs at the beginning that do not count: kernels are compiled in them."""

TURNS = """
import os, sys, time
from plnerf.cli.main import main
from plnerf.train import loop

block, answers = int(sys.argv.pop(1)), os.fdopen(int(sys.argv.pop(1)), "w")
usual, began, taken = loop.set_learning_rates, 0.0, -1

def in_turn(*arguments):
    "The first thing that a step does: after each block it waits for its next turn."
    global began, taken
    taken += 1
    if taken % block == 0:
        if taken:
            print(time.perf_counter() - began, file=answers, flush=True)
        if not sys.stdin.readline():
            os._exit(0)
        began = time.perf_counter()
    usual(*arguments)

loop.set_learning_rates = in_turn
main()
"""
"""The program of a process: the command line, with a wait at the beginning of every block of steps."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("checkouts", type=Path, nargs=2, metavar=("BEFORE", "AFTER"))
    parser.add_argument("--pairs", type=int, default=500, help="at most (default: 500)")
    parser.add_argument("--seconds", type=float, default=3600.0, help="of all pairs at most (default: 3600)")
    parser.add_argument("--block", type=int, default=20, help="steps of a turn (default: 20)")
    options = parser.parse_args()
    steps = (WARM + options.pairs) * options.block + 1
    with tempfile.TemporaryDirectory() as folder:
        before, after = (
            Training(checkout.resolve(), Path(folder) / name, options.block, steps)
            for name, checkout in zip(("before", "after"), options.checkouts, strict=True)
        )
        took, end = [], time.monotonic() + options.seconds
        for pair in range(-WARM, options.pairs):
            if time.monotonic() > end:
                break
            order = (before, after) if pair % 2 == 0 else (after, before)
            seconds = {one: one.block_s() for one in order}
            if pair >= 0:
                took.append((seconds[before], seconds[after]))
        before.end()
        after.end()
    ms = 1e3 * np.median(took, axis=0) / options.block
    ratios = [after_s / before_s for before_s, after_s in took]
    low, high = quantile_test(ratios, q=1.0, p=0.5).confidence_interval(0.95)
    print(f"before {ms[0]:.2f}, after {ms[1]:.2f} ms a step (medians)")
    print(f"AFTER / BEFORE: {np.median(ratios):.3f} ({low:.3f} to {high:.3f}, 95 %), {len(ratios)} pairs.")


class Training:
    """A process that trains a checkout's model, a block of steps whenever it is asked."""

    def __init__(self, checkout: Path, run: Path, block: int, steps: int) -> None:
        answers, to_us = os.pipe()
        self._process = subprocess.Popen(
            [
                sys.executable, "-c", TURNS, str(block), str(to_us), "train", checkout / SPAN, "-o", run,
                "--preset", PRESET, "--steps", str(steps), "--downscale", "4",
            ],
            # Threads that wait for work must not take the other process's cores.
            env={**os.environ, "PYTHONPATH": str(checkout / "src"), "OMP_WAIT_POLICY": "passive"},
            stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True, bufsize=1, pass_fds=[to_us],
        )  # fmt: skip
        os.close(to_us)
        self._answers = os.fdopen(answers)

    def block_s(self) -> float:
        """Seconds of the next block of steps."""
        assert self._process.stdin is not None
        self._process.stdin.write("go\n")
        if not (answer := self._answers.readline()):
            sys.exit(f"A training ended early, with status {self._process.wait()}.")
        return float(answer)

    def end(self) -> None:
        """Ends the process where it waits."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait()


if __name__ == "__main__":
    main()
