"""What each part of pl-nerf-wire does for wires: one run per part switched, at equal time; a Markdown table.

    python benchmarks/wire_ablation.py -o runs/wires [--scene SCENE] [--seconds 60] [--only NAME ...]

Runs that are already there are not repeated, so that the table can be finished after a break.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro
from rich.console import Console

from plnerf.bench.config import BenchConfig
from plnerf.bench.span_suite import RESULT, measure_span
from plnerf.pipeline import bundled_span
from plnerf.render.files import write_text
from plnerf.train.protocol import plain

VARIANTS: dict[str, tuple[str, ...]] = {
    "pl-nerf-wire": (),
    "no tubes": ("model.tubes=null",),
    "curves for pixels only": ("model.sampler.guided=0",),
    "no pixels along curves": ("train.curve_share=0",),
    "no curves": ("train.find_wires=false",),
    "tubes' cells 16 times as short": ("model.tubes.along=1",),
    "half the guided samples": ("model.sampler.guided=0.2",),
    "unbias 0.5": ("train.unbias=0.5",),
    "no detail pixels": ("train.detail_share=0",),
    "detail pixels by ridges": ("train.detail_map=ridge",),
    "no stretch": ("model.stretch=[1,1,1]",),
    "damping": ("model.field.damping=true",),
    "blurred interlevel loss": ("train.loss.interlevel_blur=[0.03,0.003]",),
    "dilation": ("model.sampler.dilation=0.0025",),
    "entropy": ("train.loss.entropy=0.001",),
    "edge pairs": ("train.loss.edges=1.0",),
    "refined poses": ("train.pose_refinement=true",),
}


@dataclass(frozen=True)
class Arguments:
    """Ablation of the parts that are there for wires, at equal time."""

    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """Folder for the runs and table.md."""
    scene: Path | None = None
    """Scene folder with a truth.json; the bundled span when left out."""
    seconds: float = 60.0
    """Training budget of every run, finding conductors included."""
    only: tuple[str, ...] = ()
    """Variants to run; all when left out."""
    seed: int = 0


def main(arguments: Arguments) -> None:
    """Trains and scores every variant and writes the table after each."""
    rows: list[tuple[str, dict[str, Any]]] = []
    for name, settings in VARIANTS.items():
        if arguments.only and name not in arguments.only:
            continue
        run = arguments.out / name.replace(" ", "-").replace("'", "")
        if not (run / RESULT).exists():
            bench = BenchConfig(
                arguments.out, settings=settings, seconds=arguments.seconds, seed=arguments.seed
            )
            result = measure_span(bench, arguments.scene or bundled_span(), "pl-nerf-wire", run, Console())
            write_text(run / RESULT, json.dumps(plain(result), indent=1) + "\n")
        rows.append((name, json.loads((run / RESULT).read_text())))
        write_text(arguments.out / "table.md", table(rows))
    print((arguments.out / "table.md").read_text())


def table(rows: list[tuple[str, dict[str, Any]]]) -> str:
    """The table in Markdown."""
    lines = [
        "| variant | recall 5, 10, 25 cm | precision 10 cm | longest gap m | PSNR near wires dB | PSNR dB "
        "| steps |",
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
            f"| {result['steps']:,} |"
        )
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    main(tyro.cli(Arguments))
