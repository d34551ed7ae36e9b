"""Whether a step of training is as fast as in another checkout: `paired_speed.py BEFORE AFTER [--pairs 20]`.

Pairs of runs on the bundled span, one of each checkout, in turn the one or the other first, so that what else
the machine does falls on both.  Of a run counts the median time of a step between two lines of its log:
start-up, the loading of kernels and checkpoints do not.  The median of the ratios AFTER / BEFORE is given
with its 95 % interval (of order statistics).  Both compile their kernels in a run that does not count.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from scipy.stats import quantile_test

SPAN = Path("src/plnerf/data/span")
PRESET = "pl-nerf"
WARM = 60
"""Steps at the beginning that do not count."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("checkouts", type=Path, nargs=2, metavar=("BEFORE", "AFTER"))
    parser.add_argument("--pairs", type=int, default=20)
    parser.add_argument("--steps", type=int, default=400)
    options = parser.parse_args()
    before, after = (checkout.resolve() for checkout in options.checkouts)
    for checkout in (before, after):
        step_s(checkout, WARM + 40)
    print("| pair | before, ms a step | after, ms a step | ratio |\n| ---: | ---: | ---: | ---: |")
    ratios = []
    for pair in range(options.pairs):
        order = (before, after) if pair % 2 == 0 else (after, before)
        took = {checkout: step_s(checkout, options.steps) for checkout in order}
        ratios.append(took[after] / took[before])
        ms = " | ".join(f"{1e3 * took[one]:.2f}" for one in (before, after))
        print(f"| {pair} | {ms} | {ratios[-1]:.3f} |", flush=True)
    low, high = quantile_test(ratios, q=1.0, p=0.5).confidence_interval(0.95)
    print(f"\nAFTER / BEFORE: {np.median(ratios):.3f} ({low:.3f} to {high:.3f}, 95 %), {len(ratios)} pairs.")


def step_s(checkout: Path, steps: int) -> float:
    """Seconds of a step of a run in a process of its own."""
    with tempfile.TemporaryDirectory() as folder:
        run = Path(folder) / "run"
        subprocess.run(
            [
                sys.executable, "-m", "plnerf.cli.main", "train", checkout / SPAN, "-o", run,
                "--preset", PRESET, "--steps", str(steps), "--downscale", "4",
            ],
            env={**os.environ, "PYTHONPATH": str(checkout / "src")}, cwd=folder,
            check=True, stdout=subprocess.DEVNULL,
        )  # fmt: skip
        lines = [json.loads(line) for line in (run / "metrics.jsonl").read_text().splitlines()]
    logged = [(line["step"], line["seconds"]) for line in lines if line["step"] >= WARM and "loss" in line]
    step, seconds = np.array(logged).T
    return float(np.median(np.diff(seconds) / np.diff(step)))


if __name__ == "__main__":
    main()
