"""What is done on one block, in whatever process: its result is files, and a record in the ledger.

    find     transforms.json                        -> wires.json
    train    transforms.json, given.json            -> run-*/
    survey   the same, part.json, the run if any    -> survey/

Pixels that a task unpacks from photos are removed when it ends; those of a run stay with it.
"""

import shutil
import time
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

from plnerf.capture.adjusted_poses import with_adjusted_poses
from plnerf.corridor.block_scene import GIVEN, GivenWires
from plnerf.corridor.config import CorridorConfig
from plnerf.corridor.ledger import Kind, Ledger, Task
from plnerf.corridor.part_file import PART, read_part
from plnerf.detect.detect import detect_wires
from plnerf.export.exports import LAS
from plnerf.export.formats import NAMES, lacks_library
from plnerf.exporting import export_survey
from plnerf.line.files import SURVEY_FILE, write_wires
from plnerf.line.frame import LineFrame
from plnerf.pipeline import PAGE, resume_run, train_scene, write_survey
from plnerf.scene.memory import peak_resident_bytes
from plnerf.scene.scene import Scene, load_scene
from plnerf.scene.typed_json import from_json
from plnerf.survey.run import survey_run, survey_scene
from plnerf.train.run import open_run

WIRES, SURVEY, PIXELS = "wires.json", "survey", "pixels"
RUN_DIGITS = 12
"""Of the fingerprint in the name of a block's run: one of other inputs is another folder."""


def run_task(out: Path, task: Task) -> None:
    """Does a task and writes its record.  Errors as of the stages; its record then says that it runs."""
    ledger, begin = Ledger(out), time.monotonic()
    ledger.write(task, "running")
    config = from_json(CorridorConfig, task.inputs["config"], "The corridor's settings")
    files = DO[task.kind](out / task.folder, task, config)
    ledger.write(task, "done", seconds=time.monotonic() - begin, peak_mb=_peak_mb(), files=files)


def _find(folder: Path, task: Task, config: CorridorConfig) -> tuple[Path, ...]:
    scene = _loaded(folder)
    try:
        scene, _ = with_adjusted_poses(scene, config.survey.poses)
        wires = detect_wires(scene, config.survey.detect)
        write_wires(folder / WIRES, wires, LineFrame.of_scene(scene.frames), {"sha256": task.sha256})
    finally:
        _without_pixels(folder)
    return (folder / WIRES,)


def _train(folder: Path, task: Task, config: CorridorConfig) -> tuple[Path, ...]:
    run, own = run_folder(folder, task), config.train
    for old in folder.glob("run-*"):
        if old != run:
            shutil.rmtree(old)
    if (run / "config.json").is_file():
        resume_run(folder, run)
    else:
        train_scene(
            folder, run, preset=own.preset, seconds=own.seconds, downscale=own.downscale, seed=own.seed,
            detect=config.survey.detect, poses=config.survey.poses, finder=GivenWires(folder / GIVEN),
        )  # fmt: skip
    return (run / "config.json",)


def _survey(folder: Path, task: Task, config: CorridorConfig) -> tuple[Path, ...]:
    part, given = read_part(folder / PART), GivenWires(folder / GIVEN)
    try:
        run = task.inputs.get("run")
        if run is not None:
            found = survey_run(open_run(folder / run), config.survey, None, given, part)
        else:
            found = survey_scene(_loaded(folder), config.survey, None, given, part)
    finally:
        _without_pixels(folder)
    now = datetime.now(UTC).strftime("%Y-%m-%d %H:%M")
    place = folder / SURVEY
    write_survey(replace(found, made={**found.made, "date (UTC)": now}), place)
    files = (place / SURVEY_FILE, place / PAGE, place / LAS)
    if not len(found.cloud.xyz) or lacks_library("copc"):
        return files
    export_survey(place, ["copc"])
    return (*files, place / NAMES["copc"])


DO: dict[Kind, Callable[[Path, Task, CorridorConfig], tuple[Path, ...]]] = {
    "find": _find, "train": _train, "survey": _survey,
}  # fmt: skip


def run_folder(folder: Path, task: Task) -> Path:
    """Of the field that a task trains."""
    return folder / f"run-{task.sha256[:RUN_DIGITS]}"


def _loaded(folder: Path) -> Scene:
    return load_scene(folder, store=folder / PIXELS)


def _without_pixels(folder: Path) -> None:
    """Removes the pixels of a block, which take more room than its photos."""
    shutil.rmtree(folder / PIXELS, ignore_errors=True)


def _peak_mb() -> float:
    """Greatest memory of this process so far; 0 where the system does not state it."""
    return (peak_resident_bytes() or 0) / 1e6
