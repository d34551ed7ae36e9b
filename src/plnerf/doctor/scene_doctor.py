"""A scene's poses in, a diagnosis out; and the diagnosis as a table and as JSON."""

import json
import math
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from plnerf.doctor.config import SCENES, SceneDoctorConfig
from plnerf.doctor.coverage import Diagnosis, Stretch, advice, diagnose
from plnerf.errors import SceneError
from plnerf.scene.files import write_text
from plnerf.scene.formats import read_listing
from plnerf.scene.strict_json import object_of, read_json, shown

FORMAT_VERSION = 2
"""1 had some of the settings among the results."""
CAPTURE_REPORT = "capture.json"


def examine_scene(
    source: Path,
    *,
    distance: float | None = None,
    azimuth_deg: float | None = None,
    config: SceneDoctorConfig = SCENES,
) -> Diagnosis:
    """The viewing geometry of a scene's poses.

    distance: from the cameras to the wires in the scene's unit; None: that of what the images of a capture
    see, else the configuration's.  azimuth_deg: of the line, clockwise from north (the world's +y); None: the
    direction in which the cameras flew.  Raises SceneError where the scene cannot be read.
    """
    if distance is not None and not 0 < distance < math.inf:
        raise SceneError(f"The distance must be a positive number, but is {distance:g}. Give it anew.")
    if azimuth_deg is not None and not math.isfinite(azimuth_deg):
        raise SceneError(f"The line's azimuth must be in degrees, but is {azimuth_deg:g}. Give it anew.")
    listing = read_listing(source)
    if distance is None:
        distance = _view_distance(listing.root)
    return diagnose(listing, distance, config, azimuth_deg)


def write_diagnosis(path: Path, diagnosis: Diagnosis) -> None:
    """Writes it as JSON."""
    write_text(path, json.dumps(to_json(diagnosis), indent=1, allow_nan=False) + "\n")


def _view_distance(folder: Path) -> float | None:
    """The distance that a capture measured, in the scene's unit."""
    path = folder / CAPTURE_REPORT
    if not path.is_file():
        return None
    do = "Capture the scene again, or give --distance."
    found = object_of(read_json(path, SceneError, do), str(path), SceneError, do).get("view_distance")
    if isinstance(found, bool) or not isinstance(found, int | float | None) or (found or 1.0) <= 0:
        raise SceneError(f"{path}: view_distance must be a length, but is {shown(found)}. {do}")
    return found


def to_json(diagnosis: Diagnosis) -> dict[str, Any]:
    """Plain values; what is infinite (not observable) is null."""
    content, do = asdict(diagnosis), advice(diagnosis.config)
    for stretch in content["stretches"]:
        for key, value in stretch.items():
            stretch[key] = None if isinstance(value, float) and math.isinf(value) else value
        stretch["advice"] = do[stretch["verdict"]]
    settings = content.pop("config")
    return {"format_version": FORMAT_VERSION, **content, "settings": settings}


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
        f"Wires are assumed {diagnosis.box}; {diagnosis.cameras} cameras; sigma is that of a wire's position "
        f"across it, at {diagnosis.config.sigma_px:g} px in each image.",
    ]
    do = advice(diagnosis.config)
    lines += [f"{verdict}: {do[verdict]}." for verdict in do if verdict in verdicts and do[verdict]]
    thin = [stretch.wire_px for stretch in diagnosis.stretches if stretch.wire_px is not None]
    if thin and np.median(thin) < 1:
        lines.append(
            f"Wires of {1000 * diagnosis.config.wire_diameter_m:.0f} mm are {np.median(thin):.1f} px wide: "
            "below 1 px they show only where they contrast, and not in smaller images. Fly closer, or with a "
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
