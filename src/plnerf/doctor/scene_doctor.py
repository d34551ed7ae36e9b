"""`plnerf doctor`: a scene's poses in, a table and doctor.json out."""

import json
import math
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from plnerf.detect.curves import CERTAIN_PX
from plnerf.doctor.coverage import ADVICE, DISTANCE_M, UNOBSERVABLE_M, Diagnosis, Stretch, diagnose
from plnerf.doctor.observability import SIGMA_PX
from plnerf.errors import SceneError
from plnerf.scene.files import write_text
from plnerf.scene.formats import read_listing

FORMAT_VERSION = 1
CAPTURE_REPORT = "capture.json"


def examine(
    source: Path,
    *,
    out: Path | None = None,
    distance: float | None = None,
    wire_diameter_m: float = 0.03,
    sigma_px: float = SIGMA_PX,
    pose_sigma_m: float = 0.0,
    console: Console | None = None,
) -> Diagnosis:
    """Reads a scene's poses, prints a table of its stretches, and writes doctor.json to `out` if given.

    distance: from the cameras to the wires in the scene's unit, where its file names no span box; left out,
    it is that of what the images of a capture see.  Raises SceneError where the scene cannot be read.
    """
    for name, value in (("distance", distance), ("wire diameter", wire_diameter_m), ("sigma", sigma_px)):
        if value is not None and not 0 < value < math.inf:
            raise SceneError(f"The {name} must be a positive number, but is {value:g}. Give it anew.")
    listing = read_listing(source)
    if distance is None and listing.span is None:
        distance = _view_distance(listing.root)
    diagnosis = diagnose(listing, distance, wire_diameter_m, sigma_px, pose_sigma_m)
    console = console or Console()
    console.print(table(diagnosis), highlight=False, markup=False, soft_wrap=True)
    if out is not None:
        write_text(out, json.dumps(to_json(diagnosis), indent=1, allow_nan=False) + "\n")
        console.print(f"diagnosis: {out}", markup=False, highlight=False, emoji=False, soft_wrap=True)
    return diagnosis


def _view_distance(folder: Path) -> float | None:
    """What `plnerf capture` wrote down, in the scene's unit."""
    path = folder / CAPTURE_REPORT
    return json.loads(path.read_text())["view_distance"] if path.is_file() else None


def to_json(diagnosis: Diagnosis) -> dict[str, Any]:
    """Plain values; what is infinite (not observable) is null."""
    content = asdict(diagnosis)
    for stretch in content["stretches"]:
        for key, value in stretch.items():
            stretch[key] = None if isinstance(value, float) and math.isinf(value) else value
        stretch["advice"] = ADVICE[stretch["verdict"]]
    thresholds = {"poor_px": CERTAIN_PX, "unobservable_m": UNOBSERVABLE_M, "distance_if_unscaled": DISTANCE_M}
    return {"format_version": FORMAT_VERSION, **content, "thresholds": thresholds}


def table(diagnosis: Diagnosis) -> str:
    """The stretches in Markdown, neighbours of one verdict together, and what to do."""
    unit = "m" if diagnosis.unit == "m" else "(unscaled)"
    lines = [
        f"| along the line {unit} | verdict | sigma {unit} (best to worst) | sigma px | planes differ by | "
        "track to line | views | wire px |",
        "| ---: | --- | ---: | ---: | ---: | ---: | ---: | ---: |",
    ]
    for run in _runs(diagnosis.stretches):
        finite = [stretch for stretch in run if stretch.sigma_m is not None]
        sigma = "-"
        if finite:
            middle = float(np.median([stretch.sigma_m or 0.0 for stretch in finite]))
            low = min(stretch.sigma_best_m or 0.0 for stretch in finite)
            high = max(stretch.sigma_worst_m or 0.0 for stretch in finite)
            sigma = f"{middle:.3f} ({low:.3f} to {high:.3f})".replace("inf", "not observable")
        cells = [
            f"{run[0].from_m:.0f} to {run[-1].to_m:.0f}",
            run[0].verdict,
            sigma,
            _median([stretch.sigma_px for stretch in run], "{:.1f}").replace("inf", "-"),
            f"{np.median([stretch.spread_deg for stretch in run]):.1f}°",
            _median([stretch.baseline_deg for stretch in run], "{:.0f}°"),
            f"{np.median([stretch.views for stretch in run]):.0f}",
            _median([stretch.wire_px for stretch in run], "{:.1f}"),
        ]
        lines.append("| " + " | ".join(cells) + " |")
    verdicts = {stretch.verdict for stretch in diagnosis.stretches}
    lines += [
        "",
        f"Wires are looked for {diagnosis.box}; {diagnosis.cameras} cameras; sigma is that of a wire's "
        f"position across it, at {diagnosis.sigma_px:g} px in each image.",
    ]
    lines += [
        f"{verdict}: {ADVICE[verdict]}." for verdict in ADVICE if verdict in verdicts and ADVICE[verdict]
    ]
    thin = [stretch.wire_px for stretch in diagnosis.stretches if stretch.wire_px is not None]
    if thin and np.median(thin) < 1:
        lines.append(
            f"Wires of {1000 * diagnosis.wire_diameter_m:.0f} mm are {np.median(thin):.1f} px wide: below "
            "1 px they show only where they contrast, and not in smaller images. Fly closer, or with a "
            "longer lens."
        )
    if not diagnosis.usable:
        lines.append("Not usable for wires: over more than half of the line the views do not place them.")
    return "\n".join(lines)


def _runs(stretches: tuple[Stretch, ...]) -> list[list[Stretch]]:
    runs: list[list[Stretch]] = []
    for stretch in stretches:
        if runs and runs[-1][0].verdict == stretch.verdict:
            runs[-1].append(stretch)
        else:
            runs.append([stretch])
    return runs


def _median(values: list[float | None], form: str) -> str:
    present = [value for value in values if value is not None]
    return form.format(float(np.median(present))) if present else "-"
