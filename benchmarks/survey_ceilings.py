"""What the kernels of a survey reach of what one core can do, at the shapes of a real survey.

    taskset -c 0 env NUMBA_NUM_THREADS=1 OMP_NUM_THREADS=1 python benchmarks/survey_ceilings.py SCENE

Surveys a scene from images and poses, and counts of each call of a kernel its processor seconds and the least
work that its arguments need, from the equations: operations (a comparison is one, as is a sum), and bytes
that arrays are read or written with, each once.  Ceilings are measured before, on the same core: float32
products of matrices, and the triad of STREAM.  Integers of 16 bits, which OpenCV's matcher sums, go twice as
many at a time.  Of kernels that stop early, whose least work their arguments do not tell, it counts seconds
alone.  "rest" is what of a stage is in none of these kernels.
"""

import argparse
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import cv2
import numpy as np
import torch

from plnerf.bench.ceilings import measure_ceilings
from plnerf.detect import chain_pairs, claims, directed_sums, directions, meets, odds, parabola, refit, ridges
from plnerf.detect.config import FARTHEST_PX
from plnerf.detect.detect import compile_kernels
from plnerf.scene.scene import load_scene
from plnerf.survey import run as stages
from plnerf.survey.refine import profile_fits, projection

STAGES = {"detect_wires": "finding", "stereo_surface": "stereo", "refine_spans": "refit"}
Work = tuple[float, float]
"""Operations and bytes."""


def strongest_lines(parts: Any, slopes: Any, *rest: Any) -> Work:
    scales, places = parts.shape[0], float(len(slopes) * parts.shape[2] * parts.shape[3])
    # Of a scale the bend 5, the slope 3, the larger 4; the running sum 5, its average 12, the best 2.
    return places * (12 * scales + 19), places * 4 * (5 * scales + 3)


def largest_average(picture: Any, first: Any, more: Any, D: int, steps: Any, *rest: Any) -> Work:
    allowed = float((more + 1).sum()) * len(steps) / D
    return allowed * (8 + 12 + 3), allowed * 4 * 4  # splines and the sum, the average, the best


def nearest_of_views(ridges: Any, starts: Any, sizes: Any, out: Any, start: int, stop: int) -> Work:
    pixels = float(sizes[start:stop].prod(1).sum())
    return pixels * (5 + 3 * FARTHEST_PX), 2 * pixels


def sums_of_views(J: Any, *rest: Any) -> Work:
    rows, columns = J.shape
    return rows * columns * (columns + 2.0), 8.0 * rows * (columns + 2)


def project(points: Any, *rest: Any) -> Work:
    places = points.shape[1]
    return places * (4 * 43 + 60.0), places * 8.0 * (12 + 16)


def solve(profile: Any, columns: Any, *rest: Any) -> Work:
    k, samples, c = columns.shape
    return k * (samples * (c * (c + 1.0) + 8 * c) + c**3 / 3), 8.0 * k * samples * (c + 3)


def curve_odds(views: Any, odds: Any, curves: Any, x: Any, *rest: Any) -> Work:
    *_, start, stop = rest
    places = float((stop - start) * len(x) * len(views.R))
    return places * 40, places * 2  # a place on the curve, projected; a byte each of two maps


def unknown(*given: Any) -> Work:
    return np.nan, np.nan


def matched(left: Any, right: Any, disparities: int) -> Work:
    cells = float(left.shape[0] * left.shape[1] * disparities)
    # Birchfield and Tomasi's cost in two pictures 12, its block 4, three paths of 7 each, their sum 2.
    return cells * (12 + 4 + 21 + 2), cells * 2 * 4


KERNELS: tuple[tuple[ModuleType, str, Callable[..., Work], str], ...] = (
    (ridges, "strongest_lines", strongest_lines, "ridges along lines, all directions"),
    (directed_sums, "largest_average", largest_average, "averages along lines, allowed directions"),
    (odds, "nearest_of_views", nearest_of_views, "nearest ridges"),
    (directions, "votes_of_views", unknown, "votes of segments for directions"),
    (chain_pairs, "_pairs", unknown, "chains of two images that may meet"),
    (meets, "meets", unknown, "curves where chains meet"),
    (parabola, "_curve_odds", curve_odds, "odds along curves"),
    (claims, "_mark", unknown, "ridges taken by lines"),
    (odds, "forget_in", unknown, "nearest ridges without these"),
    (refit, "observe", unknown, "ridges near a line"),
    (refit, "design_matrix", unknown, "derivatives by a line"),
    (refit, "sums_of_views", sums_of_views, "normal equations of a line"),
    (projection, "_project", project, "projecting wires"),
    (profile_fits, "_solve", solve, "profiles across wires"),
)


class Counted:
    """Seconds, operations and bytes of each kernel within each stage."""

    def __init__(self) -> None:
        self.of: dict[tuple[str, str], np.ndarray] = defaultdict(lambda: np.zeros(3))
        self.stages: dict[str, float] = {}
        self.stage = ""

    def kernel(self, call: Callable[..., Any], work: Callable[..., Work], title: str) -> Callable[..., Any]:
        """The same kernel, counted."""

        def run(*given: Any) -> Any:
            begin = time.thread_time()
            found = call(*given)
            self.of[self.stage, title] += [time.thread_time() - begin, *work(*given)]
            return found

        return run

    def of_stage(self, call: Callable[..., Any], name: str) -> Callable[..., Any]:
        """The same stage, timed."""

        def run(*given: Any, **options: Any) -> Any:
            self.stage, begin = name, time.process_time()
            found = call(*given, **options)
            self.stages[name] = time.process_time() - begin
            return found

        return run


def count_matching(counted: Counted) -> None:
    """Has OpenCV's matcher counted, which is made anew for each pair."""
    create = cv2.StereoSGBM.create

    class Matcher:
        def __init__(self, **options: Any) -> None:
            self.compute = counted.kernel(
                create(**options).compute,
                lambda left, right: matched(left, right, options["numDisparities"]),
                "semi-global matching (OpenCV)",
            )

    cv2.StereoSGBM = type("StereoSGBM", (), {"create": staticmethod(Matcher)})  # type: ignore[misc,assignment]


def main() -> None:
    """See the top of the file."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("scene", type=Path)
    given = parser.parse_args()
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    compile_kernels()
    ceilings = measure_ceilings([], torch.device("cpu"))
    most = ceilings.float32.per_second, ceilings.triad.per_second
    counted = Counted()
    for module, name, work, title in KERNELS:
        setattr(module, name, counted.kernel(getattr(module, name), work, title))
    count_matching(counted)
    for function, name in STAGES.items():
        setattr(stages, function, counted.of_stage(getattr(stages, function), name))
    with tempfile.TemporaryDirectory() as store:
        stages.survey_scene(load_scene(given.scene, store=Path(store)))
    print(f"ceilings of one core: {most[0] / 1e9:.0f} Gflop/s, {most[1] / 1e9:.1f} GB/s\n")
    print("| stage: kernel | s of a processor | of the stage | Gop/s | arithmetic | memory |")
    print("| --- | ---: | ---: | ---: | ---: | ---: |")
    for stage, seconds in counted.stages.items():
        rest = seconds
        for (of, title), (spent, operations, moved) in counted.of.items():
            if of == stage and spent > 0.005 * seconds:
                rest -= spent
                shares, rate = "– | –", "–"
                if np.isfinite(operations):
                    shares = f"{operations / spent / most[0]:.0%} | {moved / spent / most[1]:.0%}"
                    rate = f"{operations / spent / 1e9:.1f}"
                print(f"| {stage}: {title} | {spent:.2f} | {spent / seconds:.0%} | {rate} | {shares} |")
        print(f"| {stage}: rest | {rest:.2f} | {rest / seconds:.0%} | | | |")


if __name__ == "__main__":
    main()
