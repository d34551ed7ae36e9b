"""The suite `span`: presets on scenes of exactly known wires, at equal time, scored by their wires.

Every run gets the same budget in seconds, what it needs to find conductors included; then points on wires are
taken from its field, the same way for every preset, and scored.  A pair of scene and preset that has its
result is not run again: a suite that was interrupted goes on.
"""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from rich.console import Console

from plnerf.bench.config import SPAN_PRESETS, BenchConfig
from plnerf.bench.tables import Table, figure
from plnerf.bench.train_suite import settings_of
from plnerf.console import RunConsole, bar
from plnerf.detect.detect import detect_wires
from plnerf.errors import ConfigError
from plnerf.line.frame import LineFrame
from plnerf.pipeline import bundled_span, train_scene
from plnerf.render.picture_files import write_text
from plnerf.render.views import render_view
from plnerf.scene.strict_json import read_json
from plnerf.score.point_report import to_json
from plnerf.score.points import score_points
from plnerf.score.truth import read_truth
from plnerf.survey.config_wires import WirePointsConfig
from plnerf.survey.wire_points import wire_points
from plnerf.train.evaluate import mean_appearance, means, measure
from plnerf.train.metrics import Lpips
from plnerf.train.protocol import plain
from plnerf.train.run import open_run

VIEWS = 4
"""Held-out views of a scene that are rendered, evenly chosen."""
RESULT = "result.json"


def scenes_of(bench: BenchConfig) -> list[Path]:
    """The scene that was given, or all scene folders in the folder that was given, else the bundled span.

    Raises ConfigError where there is none with a truth.json.
    """
    place = bench.scene or bundled_span()
    scenes = (
        [place]
        if (place / "transforms.json").exists()
        else sorted(
            folder
            for folder in (place.iterdir() if place.is_dir() else ())
            if (folder / "transforms.json").exists()
        )
    )
    without = [str(scene) for scene in scenes if not (scene / "truth.json").exists()]
    if not scenes or without:
        found = f"these have none: {', '.join(without)}" if without else "there is no scene folder"
        raise ConfigError(
            f"The suite span needs scenes with a truth.json, as `plnerf synth` makes them, but in {place} "
            f"{found}. Give such a scene, or a folder of them: --scene."
        )
    return scenes


def measure_spans(bench: BenchConfig, console: Console) -> list[dict[str, Any]]:
    """Results of all pairs, as written beside their runs."""
    results = []
    for scene in scenes_of(bench):
        for preset in SPAN_PRESETS:
            folder = bench.out / "span" / scene.name / preset
            if not (folder / RESULT).exists():
                console.print(f"{scene.name}: {preset}", markup=False)
                result = plain(measure_span(bench, scene, preset, folder, console))
                write_text(folder / RESULT, json.dumps(result, indent=1, allow_nan=False) + "\n")
            results.append(read_json(folder / RESULT, ConfigError, f"Remove the folder {folder}."))
    return results


def span_table(results: Sequence[dict[str, Any]], seconds: float) -> Table:
    """Scenes and presets, by their wires and then by their pictures."""
    rows = []
    for one in results:
        overall, images = one["score"]["overall"], one["images"]
        wires = [wire for wire in one["score"]["wires"] if wire["scored_m"]]
        rows.append((
            one["scene"], one["preset"],
            *(figure(overall[f"recall_{key}"]) for key in ("5cm", "10cm", "25cm")),
            figure(overall["precision_10cm"]),
            figure(max((wire["longest_gap_m"] for wire in wires), default=None)),
            figure(images["near_wire_psnr_db"], 4), figure(images["psnr_db"], 4), f"{one['steps']:,}",
        ))  # fmt: skip
    columns = (
        "scene", "preset", "recall 5 cm", "10 cm", "25 cm", "precision 10 cm", "longest gap m",
        "PSNR near wires dB", "PSNR dB", "steps",
    )  # fmt: skip
    notes = (
        f"{seconds:.0f} s of training each, finding conductors included; points on wires by the same rule "
        f"for all presets; pictures over {VIEWS} held-out views at most. The gap is the worst wire's.",
    )
    return Table("Wires: scenes and presets at equal time", columns, tuple(rows), notes)


def measure_span(
    bench: BenchConfig, scene: Path, preset: str, folder: Path, console: Console
) -> dict[str, Any]:
    """One run of a preset with the bench's settings and seconds: trained, surveyed, scored, looked at."""
    if not (folder / "config.json").exists():
        settings = settings_of(bench, preset)
        train_scene(
            scene, folder, preset=preset, model=settings.model,
            train=replace(settings.train, validations=2, checkpoints=1), detect=settings.detect,
            seconds=3.0 if bench.quick else bench.seconds, downscale=bench.downscale, seed=bench.seed,
            device=bench.device, backend=bench.backend, report=RunConsole(folder, console),
        )  # fmt: skip
    return score_run(folder, views=1 if bench.quick else VIEWS, console=console)


def score_run(folder: Path, *, views: int, console: Console) -> dict[str, Any]:
    """A run on a scene of known wires: its points on them scored, and some held-out views measured."""
    run = open_run(folder)
    scene, frame = Path(run.config.scene), LineFrame.of_scene(run.scene.frames)
    wires = detect_wires(run.scene) if run.wires is None else run.wires
    with bar(console, "survey") as progress:
        found = wire_points(run, frame, wires, WirePointsConfig(), progress)
    score = score_points(frame.to_world(found.xyz), read_truth(scene / "truth.json"))
    test, appearance, lpips, pictures = run.scene.test, mean_appearance(run), Lpips(), []
    count = min(views, len(test))
    for k in range(count):
        i = test[k * len(test) // count]
        view = render_view(run.model, run.scene.cameras[[i]], appearance, normals=False)
        pictures.append(measure(view, run.scene, i, lpips))
    return {
        "scene": scene.name,
        "preset": run.config.preset,
        "steps": run.step,
        "training_s": run.seconds,
        "views": count,
        "score": to_json(score),
        "images": means(pictures),
    }
