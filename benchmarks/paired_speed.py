"""Whether a step of training is as fast as in another checkout: `paired_speed.py BEFORE AFTER [--rounds 8]`.

With --view AFTER trains with `--view`, while no browser is connected; both may be the same checkout.

Both checkouts train on the bundled span at the same time, each in a process of its own, and take turns: the
one waits while the other takes a block of steps.  A pair is a block of each, in turn the one or the other
first, so that what else the machine does for longer than a second falls on both.  Start-up, the loading of
kernels and the first steps do not count.  Two processes of one checkout differ, too, by where their memory
happens to lie; so there are several rounds, each with new processes, of which in turn the one or the other
starts first.

For each round the median of its ratios AFTER / BEFORE is given: of the time that passes, and of the time
that processors work, which other processes disturb less and in which waiting does not count.  Over all rounds
it is their geometric mean, with its 95 % interval (Student's t of the rounds' logarithms).
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from scipy.stats import t as student

SPAN = Path("src/plnerf/data/span")
PRESET = "pl-nerf"
WARM = 5
"""Pairs at the beginning of a round that do not count: kernels are compiled in them."""

TURNS = """
import os, sys, time
from plnerf.cli.main import main
from plnerf.train import loop

block, answers = int(sys.argv.pop(1)), os.fdopen(int(sys.argv.pop(1)), "w")
usual, began, worked, taken = loop.set_learning_rates, 0.0, 0.0, -1

def in_turn(*arguments):
    "The first thing that a step does: after each block it waits for its next turn."
    global began, worked, taken
    taken += 1
    if taken % block == 0:
        if taken:
            print(time.perf_counter() - began, time.process_time() - worked, file=answers, flush=True)
        if not sys.stdin.readline():
            os._exit(0)
        began, worked = time.perf_counter(), time.process_time()
    usual(*arguments)

loop.set_learning_rates = in_turn
main()
"""
"""The program of a process: the command line, with a wait at the beginning of every block of steps."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("checkouts", type=Path, nargs=2, metavar=("BEFORE", "AFTER"))
    parser.add_argument("--rounds", type=int, default=8, help="(default: 8)")
    parser.add_argument("--pairs", type=int, default=50, help="of a round at most (default: 50)")
    parser.add_argument("--seconds", type=float, default=600.0, help="of all rounds at most (default: 600)")
    parser.add_argument("--block", type=int, default=10, help="steps of a turn (default: 10)")
    parser.add_argument("--view", action="store_true", help="AFTER trains with --view")
    options = parser.parse_args()
    extra = [[], ["--view"] if options.view else []]
    checkouts = [checkout.resolve() for checkout in options.checkouts]
    medians, count, end = [], 0, time.monotonic() + options.seconds
    print("| round | pairs | before, ms a step | after, ms a step | ratio | ratio of work |")
    print("| ---: | ---: | ---: | ---: | ---: | ---: |")
    for number in range(options.rounds):
        took = one_round(checkouts, options.pairs, options.block, end, extra, swapped=number % 2 == 1)
        if len(took) < 3:  # out of time
            break
        ms = 1e3 * np.median(took[:, :, 0], axis=0) / options.block
        medians.append(np.median(took[:, 1] / took[:, 0], axis=0))
        count += len(took)
        shown = (
            " | ".join(f"{one:.2f}" for one in ms) + " | " + " | ".join(f"{one:.3f}" for one in medians[-1])
        )
        print(f"| {number} | {len(took)} | {shown} |", flush=True)
    print()
    for name, ratios in zip(("time that passes", "processors' work"), np.array(medians).T, strict=True):
        print(f"AFTER / BEFORE, {name}: {mean_of(ratios)}, {len(ratios)} rounds, {count} pairs.")


def one_round(
    checkouts: list[Path], pairs: int, block: int, end: float, extra: list[list[str]], *, swapped: bool
) -> np.ndarray:
    """Seconds that pass and that processors work, of each pair and checkout (pairs, 2, 2).

    end: by time.monotonic; extra: options of each checkout's command; swapped: whether the second checkout
    starts first.
    """
    took = []
    with tempfile.TemporaryDirectory() as folder:
        steps = (WARM + pairs) * block + 1
        both = {
            k: Training(checkouts[k], Path(folder) / str(k), block, steps, extra[k])
            for k in ((1, 0) if swapped else (0, 1))
        }
        for pair in range(-WARM, pairs):
            if time.monotonic() > end:
                break
            of = {k: both[k].block_s() for k in ((0, 1) if pair % 2 == 0 else (1, 0))}
            if pair >= 0:
                took.append([of[0], of[1]])
        for one in both.values():
            one.end()
    return np.array(took).reshape(-1, 2, 2)


def mean_of(ratios: np.ndarray) -> str:
    """The geometric mean of ratios with its 95 % interval, in words."""
    logs, n = np.log(ratios), len(ratios)
    half = student.ppf(0.975, n - 1) * logs.std(ddof=1) / np.sqrt(n) if n > 1 else np.inf
    low, middle, high = np.exp(logs.mean() + half * np.array([-1.0, 0.0, 1.0]))
    return f"{middle:.3f} ({low:.3f} to {high:.3f}, 95 %)"


class Training:
    """A process that trains a checkout's model, a block of steps whenever it is asked."""

    def __init__(self, checkout: Path, run: Path, block: int, steps: int, extra: list[str]) -> None:
        answers, to_us = os.pipe()
        self._process = subprocess.Popen(
            [
                sys.executable, "-c", TURNS, str(block), str(to_us), "train", checkout / SPAN, "-o", run,
                "--preset", PRESET, "--steps", str(steps), "--downscale", "4", *extra,
            ],
            # Threads that wait for work must not take the other process's cores.
            env={**os.environ, "PYTHONPATH": str(checkout / "src"), "OMP_WAIT_POLICY": "passive"},
            stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True, bufsize=1, pass_fds=[to_us],
        )  # fmt: skip
        os.close(to_us)
        self._answers = os.fdopen(answers)

    def block_s(self) -> tuple[float, float]:
        """Seconds of the next block of steps: that pass, and that processors work."""
        assert self._process.stdin is not None
        self._process.stdin.write("go\n")
        if not (answer := self._answers.readline()):
            sys.exit(f"A training ended early, with status {self._process.wait()}.")
        passed, worked = answer.split()
        return float(passed), float(worked)

    def end(self) -> None:
        """Ends the process where it waits."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait()


if __name__ == "__main__":
    main()
