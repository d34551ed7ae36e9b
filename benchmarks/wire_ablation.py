"""What each part of pl-nerf-wire does for wires: one run per part switched, at equal steps; a Markdown table.

    python benchmarks/wire_ablation.py -o runs/wires [--scene SCENE] [--steps 700] [--only NAME ...]

Wires are detected once, for all runs.  Runs that are already there are not repeated: the table can be
finished after a break.
"""

import json
import shutil
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import tyro
from rich.console import Console

from plnerf.bench.span_suite import RESULT, VIEWS, score_run
from plnerf.cli.options import settings_from
from plnerf.detect.config import DetectConfig
from plnerf.detect.detect import detect_wires
from plnerf.line.files import write_wires
from plnerf.line.frame import LineFrame
from plnerf.pipeline import bundled_span, train_scene
from plnerf.render.picture_files import write_text
from plnerf.scene.scene import load_scene
from plnerf.train.guidance import WIRES
from plnerf.train.protocol import plain
from plnerf.train.settings import to_json

NO_TUBES = "no tubes"
"""No option: a part of the model is left out."""
VARIANTS: dict[str, tuple[str, ...]] = {
    "pl-nerf-wire": (),
    "no curves at all": ("--train.no-find-wires",),
    "curves for pixels only": ("--model.sampler.guided 0",),
    "curves for pixels and samples, no tubes": (NO_TUBES,),
    "no pixels along curves": ("--train.curve-share 0",),
    "cells of tubes 16 times as short": ("--model.tubes.along 1",),
    "half the guided samples": ("--model.sampler.guided 0.2",),
    "weights of pixels halved (unbias 0.5)": ("--train.unbias 0.5",),
    "no detail pixels": ("--train.detail-share 0",),
    "detail pixels by ridges": ("--train.detail-map ridge",),
    "no stretch across the span": ("--model.stretch 1 1 1",),
    "damped levels": ("--model.field.damping",),
    "blurred interlevel loss": ("--train.loss.interlevel-blur 0.03 0.003",),
    "dilated proposals": ("--model.sampler.dilation 0.0025",),
}


@dataclass(frozen=True)
class Arguments:
    """Ablation of the parts that are there for wires, at equal steps."""

    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """Folder for the runs and table.md."""
    scene: Path | None = None
    """Scene folder with a truth.json; the bundled span when left out."""
    steps: int = 700
    """Steps of every run."""
    only: tuple[str, ...] = ()
    """Variants to run; all when left out."""
    seed: int = 0


def main(arguments: Arguments) -> None:
    """Trains and scores every variant and writes the table after each."""
    rows: list[tuple[str, dict[str, Any]]] = []
    scene, found = arguments.scene or bundled_span(), arguments.out / WIRES
    if not found.exists():
        loaded = load_scene(scene, store=arguments.out / "pixels")
        wires, frame = detect_wires(loaded), LineFrame.of_scene(loaded.frames)
        write_wires(found, wires, frame, to_json(DetectConfig()))
    for name, settings in VARIANTS.items():
        if arguments.only and name not in arguments.only:
            continue
        run = arguments.out / "".join(letter if letter.isalnum() else "-" for letter in name)
        if not (run / RESULT).exists():
            if (run / "config.json").exists():  # cut off: begin this one anew
                shutil.rmtree(run)
            run.mkdir(parents=True, exist_ok=True)
            shutil.copy(found, run / WIRES)
            options = [one for one in settings if one != NO_TUBES]
            options += ["--train.validations 0", "--train.checkpoints 1"]
            made = settings_from("pl-nerf-wire", " ".join(options))
            if NO_TUBES in settings:
                made = replace(made, model=replace(made.model, tubes=None))
            train_scene(
                scene, run, preset="pl-nerf-wire", model=made.model, train=made.train, steps=arguments.steps,
                seed=arguments.seed,
            )  # fmt: skip
            result = plain(score_run(run, views=VIEWS, console=Console()))
            write_text(run / RESULT, json.dumps(result, indent=1) + "\n")
        rows.append((name, json.loads((run / RESULT).read_text())))
        write_text(arguments.out / "table.md", table(rows))
    print((arguments.out / "table.md").read_text())


def table(rows: list[tuple[str, dict[str, Any]]]) -> str:
    """The table in Markdown; a step's time is without the detection of wires."""
    lines = [
        "| variant | recall 5, 10, 25 cm | precision 10 cm | longest gap m | PSNR near wires dB | PSNR dB "
        "| ms a step |",
        "| --- | --- | ---: | ---: | ---: | ---: | ---: |",
    ]
    for name, result in rows:
        overall, images = result["score"]["overall"], result["images"]
        recall = ", ".join(f"{overall[f'recall_{key}']:.3f}" for key in ("5cm", "10cm", "25cm"))
        gap = max(wire["longest_gap_m"] for wire in result["score"]["wires"] if wire["scored_m"])
        precision = overall["precision_10cm"]
        lines.append(
            f"| {name} | {recall} | {'–' if precision is None else f'{precision:.3f}'} | {gap:.1f} "
            f"| {images['near_wire_psnr_db']:.2f} | {images['psnr_db']:.2f} "
            f"| {1000 * result['training_s'] / result['steps']:.0f} |"
        )
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    main(tyro.cli(Arguments))
