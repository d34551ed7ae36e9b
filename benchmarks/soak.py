"""Whether memory grows: `python benchmarks/soak.py [--minutes 30] [--surveys 200] [--json OUT]`.

In one process: rounds of training the bundled span further (resumed from its checkpoint) and rendering a
held-out view, for so many minutes; then so many surveys of a small cloud of its true wires.  After each round
the process's own memory (unique set size: what no other process shares) is noted.

The first third of the rounds, while caches fill, does not count.  Over the others, the median of the slopes
between all pairs of rounds (Theil and Sen) is given with its 95 % interval, and what memory came to.
"""

import argparse
import gc
import json
import tempfile
import time
from pathlib import Path

import laspy
import numpy as np
import psutil
from scipy.stats import theilslopes

from plnerf.pipeline import bundled_span, render, resume_run, survey, train_scene
from plnerf.score.truth import read_truth

STEPS = 20
"""Of training, in a round."""


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
    print("| what | rounds | memory, first to last | slope per round (95 %) |\n| --- | ---: | ---: | ---: |")
    for name, mb in found.items():
        print(f"| {name} | {len(mb)} | {mb[len(mb) // 3]:.1f} to {mb[-1]:.1f} MB | {slope(mb)} |")
    if options.json is not None:
        options.json.write_text(json.dumps(found))


def memory_mb() -> float:
    """What belongs to this process alone, after what nobody refers to is freed."""
    gc.collect()
    return float(psutil.Process().memory_full_info().uss / 1e6)


def slope(mb: list[float]) -> str:
    """In kB, over the last two thirds of the rounds."""
    middle, _, low, high = theilslopes(mb[len(mb) // 3 :])
    return f"{1e3 * middle:+.1f} kB ({1e3 * low:+.1f} to {1e3 * high:+.1f})"


def trained(folder: Path, minutes: float) -> list[float]:
    """Memory after each round of training and rendering."""
    run, end, used = folder / "run", time.monotonic() + 60 * minutes, []
    train_scene(bundled_span(), run, steps=STEPS, downscale=8)
    while time.monotonic() < end:
        resume_run(bundled_span(), run, steps=STEPS * (len(used) + 2))
        render(run, views="test", outputs=("rgb", "depth"), scale=0.5, video=False)
        used.append(memory_mb())
    return used


def surveyed(folder: Path, count: int) -> list[float]:
    """Memory after each survey."""
    cloud, used = write_cloud(folder / "cloud.las"), []
    for _ in range(count):
        found, _ = survey(cloud, out=folder / "survey")
        assert found.wires
        used.append(memory_mb())
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
