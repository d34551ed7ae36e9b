"""Points on the wires of a run, and what they are worth, as files."""

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from plnerf.detect.curves import read_curves
from plnerf.render.files import write_text
from plnerf.scene.files import check_folder
from plnerf.scene.ply import write_ply
from plnerf.survey.wire_points import wire_points
from plnerf.train.guidance import CURVES
from plnerf.train.run import TrainedRun

FORMAT_VERSION = 1
POINTS, SUMMARY = "wires.ply", "wires.json"


def survey_wires(run: TrainedRun, out: Path, progress: Callable[[int, int], None] | None = None) -> Path:
    """Writes wires.ply (world frame) and wires.json into the folder `out`; returns the summary's path."""
    check_folder(out)
    out.mkdir(parents=True, exist_ok=True)
    start = time.perf_counter()
    found = wire_points(run, progress)
    seconds = time.perf_counter() - start
    attributes = {"view": found.view.astype(np.int32), "solid": found.solid.astype(np.float32)}
    write_ply(out / POINTS, found.points, attributes)
    unit = run.scene.frames.unit
    summary: dict[str, Any] = {
        "format_version": FORMAT_VERSION,
        "run": str(run.folder),
        "preset": run.config.preset,
        "step": run.step,
        "frame": "world",
        "unit": unit,
        "crs": run.scene.frames.crs,
        "points": len(found.points),
        "wire_pixels_tried": found.tried,
        "seconds": round(seconds, 2),
        "conductors_found_in_images": _curves(run),
    }
    write_text(out / SUMMARY, json.dumps(summary, indent=1) + "\n")
    return out / SUMMARY


def _curves(run: TrainedRun) -> list[dict[str, Any]]:
    """The curves that guided the run, with their ends and uncertainty in world units; none without."""
    path, frames = run.folder / CURVES, run.scene.frames
    if not path.exists():
        return []
    rows = []
    for curve in read_curves(path):
        ends = frames.to_world(curve.points(np.array(curve.ends)))
        rows.append({
            "ends": ends.round(3).tolist(),
            "sigma": round(curve.sigma / frames.scale, 4),
            "certain": curve.certain,
        })
    return rows
