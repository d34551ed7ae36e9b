"""Whether memory and the time of a step grow with the number of images.

    python benchmarks/many_images.py OUT [--counts 100 2000] [--steps 300] [--downscale 1]

Makes a scene for each count: the photos of a source scene, enlarged to 1920x1080, each with noise, a
brightness and a pose of its own, in `--files` different files, of which further images are hard links (the
store of pixels holds each image by itself, links or not).  Trains all scenes side by side in processes of
their own, which take turns of 25 steps, and prints of each: the time from the start to the first step, the
median time of a step, the same against the first scene by turns, and the peak of resident memory with the
part of it that is not the file of pixels.  Seed 0.
"""

import argparse
import json
import os
import resource
import statistics
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path

import cv2
import numpy as np
from torch import Tensor

from plnerf.pipeline import bundled_span, train_scene
from plnerf.train.report import SilentReport

SIZE = (1920, 1080)
TURN = 25
"""Steps that one process takes before the next one's turn."""


def make_scene(source: Path, folder: Path, count: int, files: int) -> Path:
    """A scene of `count` images; returns its folder, which is left as it is where it is there already."""
    if (folder / "transforms.json").exists():
        return folder
    rng, data = np.random.default_rng(0), json.loads((source / "transforms.json").read_text())
    (folder / "images").mkdir(parents=True, exist_ok=True)
    frames, written = [], list[Path]()
    for k in range(count):
        frame = dict(data["frames"][k % len(data["frames"])])
        path = folder / "images" / f"{k:05d}.jpg"
        if k < files:
            image = cv2.resize(
                cv2.imread(str(source / frame["file_path"])), SIZE, interpolation=cv2.INTER_CUBIC
            )
            noise = rng.normal(0, 3, image.shape).astype(np.float32)
            image = np.clip(image * rng.uniform(0.95, 1.05) + noise, 0, 255).astype(np.uint8)
            cv2.imwrite(str(path), image, [cv2.IMWRITE_JPEG_QUALITY, 90])
            written.append(path)
        else:
            path.unlink(missing_ok=True)
            os.link(written[k % len(written)], path)
        pose = np.array(frame["transform_matrix"])
        pose[:3, 3] += rng.normal(0, 0.01, 3)
        frames.append({"file_path": f"images/{path.name}", "transform_matrix": pose.tolist()})
    x, y = SIZE[0] / data["w"], SIZE[1] / data["h"]
    lens = {
        "w": SIZE[0], "h": SIZE[1], "fl_x": data["fl_x"] * x, "fl_y": data["fl_y"] * y,
        "cx": data["cx"] * x, "cy": data["cy"] * y,
    }  # fmt: skip
    ours = {key: data["plnerf"][key] for key in ("format_version", "unit", "crs", "up")}
    (folder / "transforms.json").write_text(json.dumps({**lens, "plnerf": ours, "frames": frames}))
    return folder


class Paced(SilentReport):
    """Reports a turn's steps on standard output, and waits for a line before the next turn."""

    def __init__(self) -> None:
        super().__init__()
        self._began, self._times, self._before = time.perf_counter(), list[float](), 0.0

    def step(self, step: int, seconds: float, progress: float, terms: Mapping[str, Tensor]) -> None:
        """The first step, which compiles, is its own turn."""
        super().step(step, seconds, progress, terms)
        self._times.append(seconds - self._before)
        self._before = seconds
        if self.steps == 1:
            self._times = [time.perf_counter() - self._began]
        if self.steps % TURN == 1:
            print(f"TURN {statistics.median(self._times)}", flush=True)
            self._times = []
            sys.stdin.readline()


def child(scene: Path, out: Path, steps: int, downscale: int) -> None:
    """Trains one scene by turns, and reports its memory."""
    train_scene(scene, out, steps=steps + 1, downscale=downscale, report=Paced())
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    status = Path("/proc/self/status").read_text().splitlines()
    own = next(int(line.split()[1]) / 1e6 for line in status if line.startswith("RssAnon"))
    print(f"MEMORY {peak} {own}", flush=True)


def value(process: "subprocess.Popen[str]", word: str) -> list[float]:
    """The numbers of the child's next line that begins with the word."""
    assert process.stdout is not None
    for line in process.stdout:
        if line.startswith(word):
            return [float(text) for text in line.split()[1:]]
    raise SystemExit(f"a training ended with status {process.wait()}")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("out", type=Path)
    parser.add_argument("--source", type=Path, default=bundled_span())
    parser.add_argument("--counts", type=int, nargs="+", default=[100, 2000])
    parser.add_argument("--files", type=int, default=288)
    parser.add_argument("--steps", type=int, default=300)
    parser.add_argument("--downscale", type=int, default=1)
    parser.add_argument("--child", type=int, default=0, help="used by this script alone")
    chosen = parser.parse_args()
    if count := chosen.child:
        child(chosen.out / f"{count}", chosen.out / f"run-{count}", chosen.steps, chosen.downscale)
        return
    processes, first = [], []
    for count in chosen.counts:
        make_scene(chosen.source, chosen.out / f"{count}", count, chosen.files)
        again = [*sys.argv, "--child", str(count)]
        processes.append(
            subprocess.Popen(
                [sys.executable, *again], text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE
            )
        )
        first.append(value(processes[-1], "TURN")[0])
    turns: list[list[float]] = [[] for _ in processes]
    for _ in range(chosen.steps // TURN):
        for process, times in zip(processes, turns, strict=True):
            assert process.stdin is not None
            process.stdin.write("\n")
            process.stdin.flush()
            times.extend(value(process, "TURN"))
    print("| images | to the first step s | a step ms | against the first | peak GB | of it anonymous GB |")
    print("| ---: | ---: | ---: | ---: | ---: | ---: |")
    for count, process, began, times in zip(chosen.counts, processes, first, turns, strict=True):
        assert process.stdin is not None
        process.stdin.write("\n")
        process.stdin.flush()
        peak, own = value(process, "MEMORY")
        ratio = statistics.median(b / a for a, b in zip(turns[0], times, strict=True))
        print(
            f"| {count} | {began:.0f} | {1e3 * statistics.median(times):.2f} | {ratio:.3f} "
            f"| {peak:.2f} | {own:.2f} |"
        )


if __name__ == "__main__":
    main()
