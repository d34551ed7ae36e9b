"""What each part of PL-NeRF buys: one run per part switched, at equal steps, on one scene; a Markdown table.

    python benchmarks/ablation.py -o runs/ablation [--scene SCENE] [--steps 800] [--downscale 2]

Runs that are already there are not repeated, so that the table can be finished after a break.
"""

import json
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from plnerf.cli.options import settings_from
from plnerf.pipeline import bundled_span, evaluate, train_scene

VARIANTS: dict[str, tuple[str, ...]] = {
    "pl-nerf": (),
    "no contraction": ("--model.no-contraction",),
    "cubic interpolation": ("--model.field.grid.interpolation cubic",),
    "direction sh": ("--model.field.direction-encoding sh",),
    "direction both": ("--model.field.direction-encoding both",),
    "no appearance": ("--model.field.appearance 0",),
    "normals shape density": ("--train.loss.normals-shape-density",),
    "no normals": ("--model.field.no-normals",),
    "uniform pixels": ("--train.detail-share 0",),
}


@dataclass(frozen=True)
class Arguments:
    """Ablation at equal steps."""

    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """Folder for the runs and table.md."""
    scene: Path | None = None
    """Scene folder; the bundled span when left out."""
    steps: int = 800
    """Steps of every run."""
    downscale: int = 2
    """Integer factor by which images are made smaller."""
    only: tuple[str, ...] = ()
    """Variants to run; all when left out."""


def main(arguments: Arguments) -> None:
    """Trains and evaluates every variant and writes the table after each."""
    rows: list[tuple[str, dict[str, Any]]] = []
    for name, settings in VARIANTS.items():
        if arguments.only and name not in arguments.only:
            continue
        run = arguments.out / name.replace(" ", "-")
        if not (run / "eval" / "metrics.json").exists():
            if (run / "config.json").exists():  # cut off: begin this one anew
                shutil.rmtree(run)
            fitted = () if arguments.scene else ("--model.stretch 1 3 2",)
            made = settings_from("pl-nerf", " ".join((*fitted, *settings)))
            train_scene(
                arguments.scene or bundled_span(), run, model=made.model, train=made.train,
                steps=arguments.steps, downscale=arguments.downscale,
            )  # fmt: skip
            evaluate(run)
        rows.append((name, json.loads((run / "eval" / "metrics.json").read_text())))
        (arguments.out / "table.md").write_text(table(rows))
    print((arguments.out / "table.md").read_text())


def table(rows: list[tuple[str, dict[str, Any]]]) -> str:
    """The table in Markdown, over the held-out images."""
    protocol = rows[0][1]["protocol"]
    lines = [
        f"Step {protocol['step']}, seed {protocol['seed']}, {protocol['hardware']['cpu']}, "
        f"{protocol['hardware']['cores']} cores",
        "",
        "| variant | PSNR dB | SSIM | PSNR on wires dB | depth error on wires m | elsewhere m | training s |",
        "| --- | ---: | ---: | ---: | ---: | ---: | ---: |",
    ]
    for name, metrics in rows:
        mean = metrics["mean"]
        cells = [mean["psnr_db"], mean["ssim"], mean["wire_psnr_db"]]
        cells += [(mean[key] or {}).get("median_m") for key in ("wire_depth", "elsewhere_depth")]
        digits = (2, 3, 2, 3, 3)
        shown = ["–" if cell is None else f"{cell:.{d}f}" for cell, d in zip(cells, digits, strict=True)]
        lines.append(f"| {name} | {' | '.join(shown)} | {metrics['protocol']['training_seconds']:.0f} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    main(tyro.cli(Arguments))
