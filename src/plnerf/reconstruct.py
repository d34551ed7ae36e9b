"""All stages in one call, each skipped where it is done: photos in, pictures and points on wires out.

    OUT/scene/    plnerf capture     (left out where the input is a scene with poses)
    OUT/run/      plnerf train, eval, render, survey

A stage is done again where its inputs changed: the scene, the settings, the newest checkpoint.  A run of
other settings is not lost but put aside, as run-1, run-2, ...
"""

import hashlib
import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

from rich.console import Console

from plnerf.capture.capture import CaptureConfig
from plnerf.capture.report import capture_and_tell
from plnerf.pipeline import evaluate, render, resume_run, survey, train_scene
from plnerf.render.files import write_text
from plnerf.scene.formats import has_poses
from plnerf.train.checkpoint import list_checkpoints

STATE = "reconstruct.json"


@dataclass(frozen=True)
class Training:
    """What is trained; changing any of it trains anew."""

    preset: str = "pl-nerf-wire"
    seconds: float = 300.0
    downscale: int = 1
    seed: int = 0


def reconstruct_all(
    source: Path, out: Path, training: Training, capture: CaptureConfig, console: Console
) -> Path:
    """Runs what is not done; returns the run folder.  Errors are those of the stages."""
    scene = source if has_poses(source) else capture_and_tell(source, out / "scene", capture, console)
    run = out / "run"
    transforms = scene / "transforms.json" if scene.is_dir() else scene
    wanted = {**asdict(training), "scene": str(scene.resolve()), "poses": _hash(transforms)}
    state = json.loads((out / STATE).read_text()) if (out / STATE).exists() else {}
    if state.get("training") not in {None, json.dumps(wanted)} and run.exists():
        aside = next(path for k in range(1, 10_000) if not (path := out / f"run-{k}").exists())
        run.replace(aside)
        console.print(f"the run of other settings or poses: {aside}", markup=False, soft_wrap=True)
        state = {}
    state["training"] = json.dumps(wanted)
    write_text(out / STATE, json.dumps(state, indent=1) + "\n")
    if (run / "config.json").exists():
        resume_run(scene, run, console=console)
    else:
        train_scene(
            scene, run, preset=training.preset, seconds=training.seconds, downscale=training.downscale,
            seed=training.seed, console=console,
        )  # fmt: skip
    newest = list_checkpoints(run / "checkpoints")[-1].stem
    stages: dict[str, Callable[[], object]] = {
        "eval": lambda: evaluate(run, console=console),
        "render": lambda: render(run, views="path", outputs=("rgb", "depth"), console=console),
        "survey": lambda: survey(run, console=console),
    }
    for name, stage in stages.items():
        if state.get(name) == newest:
            console.print(f"{name}: there already, of {newest}", markup=False)
            continue
        stage()
        state[name] = newest
        write_text(out / STATE, json.dumps(state, indent=1) + "\n")
    console.print(f"reconstruction: {out}", markup=False, soft_wrap=True)
    return run


def _hash(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else ""
