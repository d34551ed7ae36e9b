"""Whether memory grows: `python benchmarks/soak.py [--minutes 30] [--surveys 200] [--json OUT]`.

In one process: rounds of training the bundled span further (resumed from its checkpoint) and rendering its
held-out views, for so many minutes; then so many surveys of a small cloud of its true wires.  After each
round two things are noted: the process's own memory (unique set size: what no other process shares), and how
many blocks of memory Python's objects have.  What malloc gives back to the system, and when, moves the first
by megabytes; the second shows what is kept for ever, to the object.

The first third of the rounds, while caches fill, does not count.  Over the others, the median of the slopes
between all pairs of rounds (Theil and Sen) is given with its 95 % interval, and what memory came to.
"""

import argparse
import gc
import json
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import laspy
import numpy as np
import psutil
from scipy.stats import theilslopes

from plnerf.pipeline import bundled_span, render, resume_run, survey, train_scene
from plnerf.score.truth import read_truth

STEPS = 20
"""Of training, in a round."""
Used = tuple[float, int]
"""Megabytes, and blocks of Python's objects."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--surveys", type=int, default=200)
    parser.add_argument("--json", type=Path, help="file of all figures")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        found = {
            "training and rendering": trained(Path(folder), options.minutes),
            "surveys": surveyed(Path(folder), options.surveys),
        }
    print("| what | rounds | memory, first to last | per round (95 %) | blocks per round (95 %) |")
    print("| --- | ---: | ---: | ---: | ---: |")
    for name, used in found.items():
        mb, blocks = zip(*used, strict=True)
        ends = f"{mb[len(mb) // 3]:.1f} to {mb[-1]:.1f} MB"
        print(f"| {name} | {len(used)} | {ends} | {slope(mb, 1e3)} kB | {slope(blocks)} |")
    if options.json is not None:
        options.json.write_text(json.dumps(found))


def memory() -> Used:
    """What belongs to this process alone, after what nobody refers to is freed."""
    gc.collect()
    return psutil.Process().memory_full_info().uss / 1e6, sys.getallocatedblocks()


def slope(values: Sequence[float], unit: float = 1.0) -> str:
    """Per round, over the last two thirds of the rounds."""
    middle, _, low, high = theilslopes(values[len(values) // 3 :])
    return f"{unit * middle:+.1f} ({unit * low:+.1f} to {unit * high:+.1f})"


def trained(folder: Path, minutes: float) -> list[Used]:
    """Memory after each round of training and rendering."""
    run, end, used = folder / "run", time.monotonic() + 60 * minutes, list[Used]()
    train_scene(bundled_span(), run, steps=STEPS, downscale=8)
    while time.monotonic() < end:
        resume_run(bundled_span(), run, steps=STEPS * (len(used) + 2))
        render(run, views="test", outputs=("rgb", "depth"), scale=0.5, video=False)
        used.append(memory())
    return used


def surveyed(folder: Path, count: int) -> list[Used]:
    """Memory after each survey."""
    cloud, used = write_cloud(folder / "cloud.las"), list[Used]()
    for _ in range(count):
        found, _ = survey(cloud, out=folder / "survey")
        assert found.wires
        used.append(memory())
    return used


def write_cloud(path: Path) -> Path:
    """The bundled span's true wires and its supports above level ground, as a scanner would see them."""
    truth = read_truth(bundled_span() / "truth.json")
    draw = np.random.default_rng(0)
    wires = [wire.points(np.arange(0.0, wire.base.length_m, 0.3)) for wire in truth.wires]
    low, high = np.concatenate(wires).min(0) - 15, np.concatenate(wires).max(0) + 15
    ground = draw.uniform(low, high, (6000, 3)) * [1, 1, 0]
    masts = [
        np.c_[np.repeat(foot[None, :2], 200, 0), np.linspace(0, high[2] - 14, 200)]
        + draw.normal(0, 0.1, (200, 3))
        for foot in (np.array(one.foot) for one in truth.structures)
    ]
    las = laspy.LasData(laspy.LasHeader(point_format=6, version="1.4"))
    las.header.scales = np.full(3, 0.001)
    las.x, las.y, las.z = (np.concatenate([*wires, *masts, ground]) + draw.normal(0, 0.02, 3)).T
    las.write(str(path))
    return path


if __name__ == "__main__":
    main()
