"""What is done on one block, in whatever process: its result is files, and a record in the ledger.

    find     transforms.json                        -> wires.json
    train    transforms.json, given.json            -> run-*/
    survey   the same, part.json, the run if any    -> survey/
    lines    squares.json, LAS and LAZ files        -> lines.json, labels.npz
    finish   the same and part.json                 -> survey/

Pixels that a task unpacks from photos are removed when it ends; those of a run stay with it.
"""

import shutil
import time
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from plnerf.capture.adjusted_poses import with_adjusted_poses
from plnerf.corridor.block_scene import GIVEN, GivenWires
from plnerf.corridor.cloud_blocks import POINTS, block_points
from plnerf.corridor.config import CorridorConfig
from plnerf.corridor.ledger import Kind, Ledger, Task
from plnerf.corridor.part_file import PART, read_part
from plnerf.detect.detect import detect_wires
from plnerf.errors import SurveyError
from plnerf.export.exports import LAS
from plnerf.export.formats import NAMES, lacks_library
from plnerf.exporting import export_survey
from plnerf.line.cloud import Cloud
from plnerf.line.files import SURVEY_FILE, read_survey, write_survey_json, write_wires
from plnerf.line.frame import LineFrame
from plnerf.line.survey import Survey
from plnerf.pipeline import PAGE, resume_run, train_scene, write_survey
from plnerf.scene.files import complete_file
from plnerf.scene.memory import peak_resident_bytes
from plnerf.scene.scene import Scene, load_scene
from plnerf.scene.typed_json import from_json
from plnerf.survey.lidar.find import Found
from plnerf.survey.lidar.point_cloud import PointCloud, read_cloud
from plnerf.survey.run import find_in_cloud, survey_found, survey_run, survey_scene
from plnerf.train.run import open_run

WIRES, SURVEY, PIXELS, LINES, LABELS = "wires.json", "survey", "pixels", "lines.json", "labels.npz"
RUN_DIGITS = 12
"""Of the fingerprint in the name of a block's run: one of other inputs is another folder."""


def run_task(out: Path, task: Task) -> None:
    """Does a task and writes that it is done.  Errors as of the stages; its record is then left as it was."""
    ledger, begin, processor = Ledger(out), time.monotonic(), time.process_time()
    config = from_json(CorridorConfig, task.inputs["config"], "The corridor's settings")
    files = DO[task.kind](out / task.folder, task, config)
    ledger.write(
        task, "done", seconds=time.monotonic() - begin, processor_seconds=time.process_time() - processor,
        peak_mb=_peak_mb(), files=files,
    )  # fmt: skip


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
    return _written(found, folder)


def _lines(folder: Path, task: Task, config: CorridorConfig) -> tuple[Path, ...]:
    cloud = _block_cloud(folder, task)
    found = find_in_cloud(cloud, config.survey)
    frame = LineFrame.of_cloud(cloud.xyz, cloud.crs, cloud.origin)
    shown = Survey(frame, found.lines, Cloud.empty(), str(cloud.path), findings=found.findings)
    write_survey_json(folder / LINES, shown)
    with complete_file(folder / LABELS) as beside:
        np.savez_compressed(beside, label=found.cloud.label, wire=found.cloud.wire)
    return (folder / LINES, folder / LABELS)


def _finish(folder: Path, task: Task, config: CorridorConfig) -> tuple[Path, ...]:
    cloud, shown = _block_cloud(folder, task), read_survey(folder / LINES)
    with np.load(folder / LABELS) as labels:
        label, wire = labels["label"], labels["wire"]
    if len(label) != len(cloud.xyz):
        raise SurveyError(
            f"{folder / LABELS} has {len(label):,} points, but the block has {len(cloud.xyz):,}. Remove it: "
            "the lines are found again."
        )
    points = Cloud(shown.frame.from_world(cloud.xyz), label, wire)
    found = survey_found(
        cloud, Found(shown.lines, points, shown.findings), config.survey, read_part(folder / PART)
    )
    files = _written(found, folder)
    (folder / POINTS).unlink(missing_ok=True)
    return files


def _block_cloud(folder: Path, task: Task) -> PointCloud:
    """The points of a block's squares; the name in reports is that of its folder."""
    cloud = read_cloud(block_points(folder, [Path(path) for path in task.inputs["sources"]]))
    return replace(cloud, path=folder)


def _written(found: Survey, folder: Path) -> tuple[Path, ...]:
    """Writes the survey of a block; returns its files."""
    now = datetime.now(UTC).strftime("%Y-%m-%d %H:%M")
    place = folder / SURVEY
    write_survey(replace(found, made={**found.made, "date (UTC)": now}), place)
    files = (place / SURVEY_FILE, place / PAGE, place / LAS)
    if not len(found.cloud.xyz) or lacks_library("copc"):
        return files
    export_survey(place, ["copc"])
    return (*files, place / NAMES["copc"])


DO: dict[Kind, Callable[[Path, Task, CorridorConfig], tuple[Path, ...]]] = {
    "find": _find, "train": _train, "survey": _survey, "lines": _lines, "finish": _finish,
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
