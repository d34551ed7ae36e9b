"""Measures what each stage of a survey takes, and how that grows with the number of images.

    python benchmarks/survey_growth.py SCENE... -o OUT

Each scene is surveyed from images and poses alone, in a process of its own; the scenes should be of one line,
flown the more densely the more images there are (`plnerf synth OUT --scene span --views 12`, 24, 48, 96).
Prints of each stage its seconds, those of all cores together, and the most memory that it held, and to which
power of the number of images they grow.  Writes OUT/growth.json; OUT/1 and so on are the surveys.  Memory is
reset before each stage, which needs Linux.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from plnerf.pipeline import write_survey
from plnerf.scene.scene import load_scene
from plnerf.survey import run as stages

STAGES = {
    "with_adjusted_poses": "poses", "detect_wires": "wires", "stereo_surface": "stereo",
    "refine_spans": "fit", "classified": "classes", "with_witnesses": "witnesses", "_finished": "clearances",
}  # fmt: skip
"""Functions of `plnerf.survey.run`, and what they do."""


def peak_gb() -> float:
    """Most resident memory since it was reset."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) / 1e6 for line in lines if line.startswith("VmHWM"))


def measured(name: str, work: Callable[..., Any], rows: dict[str, list[float]]) -> Callable[..., Any]:
    """The same function, which notes its seconds, processor seconds and memory."""

    def run(*given: Any, **options: Any) -> Any:
        Path("/proc/self/clear_refs").write_text("5")
        wall, processor = time.monotonic(), time.process_time()
        found = work(*given, **options)
        rows[name] = [time.monotonic() - wall, time.process_time() - processor, peak_gb()]
        return found

    return run


def child(place: Path, out: Path) -> None:
    """Surveys a scene and prints what each stage took."""
    rows: dict[str, list[float]] = {}
    for function, name in STAGES.items():
        setattr(stages, function, measured(name, getattr(stages, function), rows))
    wall, processor = time.monotonic(), time.process_time()
    with tempfile.TemporaryDirectory() as store:
        scene = measured("load", load_scene, rows)(place, store=Path(store))
        survey = stages.survey_scene(scene)
        measured("report", write_survey, rows)(survey, out)
    most = max(row[2] for row in rows.values())
    rows["all"] = [time.monotonic() - wall, time.process_time() - processor, most]
    print(json.dumps({"images": len(scene.names), "wires": len(survey.wires), "stages": rows}))


def main() -> None:
    """See the top of the file."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("scenes", type=Path, nargs="+", metavar="SCENE")
    parser.add_argument("-o", "--out", type=Path, required=True)
    parser.add_argument("--child", type=int, default=0, help="used by this script alone")
    given = parser.parse_args()
    if given.child:
        child(given.scenes[given.child - 1], given.out / str(given.child))
        return
    found = []
    for k in range(1, len(given.scenes) + 1):
        again = [sys.executable, *sys.argv, "--child", str(k)]
        found.append(json.loads(subprocess.run(again, check=True, stdout=subprocess.PIPE).stdout))
    images = [one["images"] for one in found]
    names = found[0]["stages"]
    print(f"wires: {', '.join(str(one['wires']) for one in found)}")
    for title, k in (("seconds", 0), ("seconds of a processor", 1), ("GB at most", 2)):
        print(f"\n| {title} | {' | '.join(f'{count} images' for count in images)} | power |")
        print("| --- |" + " ---: |" * (len(images) + 1))
        for name in names:
            row = [one["stages"][name][k] for one in found]
            power = np.polyfit(np.log(images), np.log(np.maximum(row, 1e-3)), 1)[0]
            print(f"| {name} | {' | '.join(f'{value:.2f}' for value in row)} | {power:.2f} |")
    (given.out / "growth.json").write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
