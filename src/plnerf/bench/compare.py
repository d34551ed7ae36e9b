"""One scene, many systems: each preset trained and measured at the same budget, seed and split.

Each preset has a folder below the comparison's own, a run like any other, and a result.json once it is
measured: a comparison that was interrupted goes on, and one preset that fails leaves the others whole.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from plnerf.bench.compare_page import comparison_table, write_pages
from plnerf.bench.fresh_process import in_fresh_process
from plnerf.bench.machine import circumstances
from plnerf.console import RunConsole, bar
from plnerf.errors import ConfigError, PlnerfError
from plnerf.ops.backends import BackendChoice
from plnerf.pipeline import Device, choose_device, resume_run, train_scene
from plnerf.render.picture_files import write_text
from plnerf.render.pictures import world_depth
from plnerf.render.views import render_view
from plnerf.scene.memory import peak_resident_bytes
from plnerf.scene.strict_json import object_of, read_json
from plnerf.terminal import Terminal
from plnerf.train.config import Settings
from plnerf.train.evaluate import evaluate_run, mean_appearance
from plnerf.train.protocol import plain
from plnerf.train.report import read_log
from plnerf.train.run import open_run, read_config
from plnerf.train.settings import to_json
from plnerf.train.true_pictures import read_wire_mask

RESULT, VIEW = "result.json", "view.npz"
FORMAT_VERSION = 1


@dataclass(frozen=True)
class CompareConfig:
    """One call of `plnerf compare`."""

    scene: Path
    out: Path
    systems: Mapping[str, Settings]
    """Settings to train, by preset, in the order of the comparison."""
    steps: int | None = None
    """Budget of every preset in steps, or in seconds."""
    seconds: float | None = None
    downscale: int = 1
    seed: int = 0
    device: Device = "auto"
    backend: BackendChoice = "auto"

    def __post_init__(self) -> None:
        if not self.systems:
            raise ConfigError("--presets takes one or more, each once, but got none.")
        if (self.steps is None) == (self.seconds is None):
            raise ConfigError("Give every preset the same budget: --steps N or --seconds S, not both.")

    def common(self) -> dict[str, Any]:
        """What all runs of a comparison share: going on with another would compare unequal ones."""
        return {
            "scene": str(self.scene.resolve()),
            "steps": self.steps,
            "seconds": self.seconds,
            "downscale": self.downscale,
            "seed": self.seed,
        }


def compare(config: CompareConfig, console: Console) -> Path:
    """Trains and measures what is not there yet, and writes the pages; returns the path of compare.json.

    Raises ConfigError where the folder holds a comparison of another kind, PlnerfError, after the pages are
    written, where every preset failed.
    """
    _check_common(config)
    results = []
    for name in config.systems:
        folder = config.out / name
        if not (folder / RESULT).exists():
            console.print(f"{name}:", markup=False)
            try:
                in_fresh_process(_run_one, (config, name))
            except PlnerfError as error:
                console.print(f"{name} failed: {error}", markup=False, soft_wrap=True)
                results.append({"preset": name, "failed": str(error)})
                continue
        results.append(read_json(folder / RESULT, ConfigError, f"Remove the folder {folder}."))
    about = {**circumstances(choose_device(config.device)), **config.common()}
    console.print(comparison_table(results, about).for_console())
    write_pages(config.out, results, about)
    content = plain({"format_version": FORMAT_VERSION, "about": about, "results": results})
    write_text(config.out / "compare.json", json.dumps(content, indent=1, allow_nan=False) + "\n")
    if all("failed" in result for result in results):
        raise PlnerfError("Every preset failed; their reasons are above and in compare.json.")
    return config.out / "compare.json"


def _check_common(config: CompareConfig) -> None:
    path, common = config.out / "common.json", config.common()
    settings = {name: to_json(one) for name, one in config.systems.items()}
    do = "Give another folder: -o."
    before = read_json(path, ConfigError, do) if path.exists() else {"settings": {}, **common}
    before = object_of(before, str(path), ConfigError, do)
    differ = [
        f"{key} {before.get(key)!r} -> {value!r}" for key, value in common.items() if before.get(key) != value
    ]
    known = object_of(before.get("settings", {}), f"{path}, settings,", ConfigError, do)
    differ += [
        f"settings of {name}" for name in settings if known.get(name, settings[name]) != settings[name]
    ]
    if differ:
        raise ConfigError(
            f"{config.out} holds a comparison with other values: {', '.join(differ)}. Give the same values, "
            "or another folder: -o."
        )
    write_text(path, json.dumps({**common, "settings": {**known, **settings}}, indent=1) + "\n")


def _run_one(task: tuple[CompareConfig, str]) -> None:
    config, name = task
    folder, console = config.out / name, Terminal()
    if (folder / "config.json").exists():
        resume_run(config.scene, folder, report=RunConsole(folder, console))
    else:
        settings = config.systems[name]
        train_scene(
            config.scene, folder, preset=name, model=settings.model, train=settings.train,
            detect=settings.detect, steps=config.steps, seconds=config.seconds,
            downscale=config.downscale, seed=config.seed, device=config.device, backend=config.backend,
            report=RunConsole(folder, console),
        )  # fmt: skip
    peak = peak_resident_bytes()
    run = open_run(folder)
    with bar(console, "evaluate") as progress:
        metrics = json.loads(evaluate_run(run, progress=progress).read_text())
    i = _shown_view(run.scene.test, run.scene.wire_masks)
    view = render_view(run.model, run.scene.cameras[[i]], mean_appearance(run), normals=False)
    with (folder / VIEW).open("wb") as file:
        np.savez_compressed(
            file, rgb=view.rgb.astype(np.float32), depth=world_depth(view, run.scene.frames),
            photo=run.scene.images.image(i), unit=run.scene.frames.unit,
        )  # fmt: skip
    rays = read_config(folder).train.rays
    values = list(run.model.parameters())
    result = {
        "preset": name,
        "mean": metrics["mean"],
        "steps": run.step,
        "training_s": run.seconds,
        "rays_per_s": run.step * rays / run.seconds if run.seconds else None,
        "render_rays_per_s": metrics["protocol"]["rays_per_second"],
        "peak_bytes": peak,
        "parameters": sum(value.numel() for value in values),
        "model_bytes": sum(value.numel() * value.element_size() for value in values),
        "curve": _curve(folder / "metrics.jsonl"),
        "view": run.scene.names[i],
        "crop": _crop(run.scene.wire_masks.get(i), view.rgb.shape[:2]),
    }
    write_text(folder / RESULT, json.dumps(plain(result), indent=1, allow_nan=False) + "\n")


def _shown_view(test: Sequence[int], masks: Mapping[int, Path]) -> int:
    """The held-out view with the most wire, or the first one."""
    wired = [i for i in test if i in masks]
    return max(wired, key=lambda i: int(read_wire_mask(masks[i]).sum())) if wired else test[0]


def _crop(mask: Path | None, shape: tuple[int, ...]) -> tuple[int, int, int, int]:
    """Top, left, height and width of the third of a picture with the most wire, or of its middle."""
    h, w = shape
    ch, cw = max(1, h // 3), max(1, w // 3)
    if mask is None:
        return (h - ch) // 2, (w - cw) // 2, ch, cw
    wire = read_wire_mask(mask)
    rows, columns = np.nonzero(wire)
    scale = h / wire.shape[0]
    counts, tops, lefts = np.histogram2d(rows * scale, columns * scale, bins=(6, 6), range=((0, h), (0, w)))
    pairs = counts[:-1, :-1] + counts[1:, :-1] + counts[:-1, 1:] + counts[1:, 1:]
    i, j = np.unravel_index(int(pairs.argmax()), pairs.shape)
    return min(int(tops[i]), h - ch), min(int(lefts[j]), w - cw), ch, cw


def _curve(path: Path) -> list[tuple[float, int, float]]:
    """Seconds, steps and held-out PSNR of the validations of a run."""
    lines = read_log(path)
    return [
        (line["seconds"], line["step"], line["held_out_psnr_db"])
        for line in lines
        if "held_out_psnr_db" in line
    ]
