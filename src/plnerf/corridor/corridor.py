"""A whole corridor, block after block: cut, find, plan, train, survey, join.

    OUT/find/K/    a block of images in which wires are looked for: transforms.json, wires.json
    OUT/wires.json the wires of all blocks, joined
    OUT/spans/K/   a span: its scene, given wires, part, field if asked for, survey/ with its report
    OUT/ledger/    a record for each task
    OUT/           survey.json (the joined line), index.html, corridor.json, corridor.gpkg, clouds.geojson

Nothing is printed: tasks are announced by a callback.
"""

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from plnerf.corridor.block_scene import GIVEN, LEAST_IMAGES, write_block_scene
from plnerf.corridor.config import CorridorConfig
from plnerf.corridor.cut import cut
from plnerf.corridor.engine import Engine, InThisProcess
from plnerf.corridor.ledger import KINDS, Kind, Ledger, Task
from plnerf.corridor.merge import merged, read_blocks
from plnerf.corridor.part_file import PART, write_part
from plnerf.corridor.plan import given_wires, images_of, joined_wires, part_of, planned_spans
from plnerf.corridor.results import Corridor, write_results
from plnerf.corridor.tasks import SURVEY, WIRES, run_folder
from plnerf.errors import ConfigError, SurveyError
from plnerf.findings import harms
from plnerf.line.files import read_wires, write_wires
from plnerf.line.frame import LineFrame
from plnerf.line.move import move_wire
from plnerf.scene.fingerprint import file_sha256
from plnerf.scene.formats import read_listing
from plnerf.scene.listing import Listing
from plnerf.scene.only_writer import only_writer
from plnerf.scene.orientation import frames_for
from plnerf.scene.scene import scene_cameras, split
from plnerf.survey.part import Part
from plnerf.train.settings import to_json

Heard = Callable[[str, Sequence[Task], Ledger], None]
"""Called with a stage, its tasks, and the ledger that knows how far they are."""


def survey_corridor(
    source: Path,
    out: Path,
    config: CorridorConfig | None = None,
    engine: Engine | None = None,
    heard: Heard | None = None,
) -> Corridor:
    """Surveys a scene of any size, block after block, into a folder; what is up to date is not done again.

    Raises ConfigError where the scene has no scale, SurveyError where no block could be surveyed, and the
    errors of reading a scene.  A block that fails keeps no other from being done; it is named in the result.
    """
    config, engine = config or CorridorConfig(), engine or InThisProcess()
    with only_writer(out):
        return _of_images(source, out, config, engine, heard or (lambda stage, tasks, ledger: None))


def _of_images(source: Path, out: Path, config: CorridorConfig, engine: Engine, heard: Heard) -> Corridor:
    listing = read_listing(source)
    if listing.unit != "m":
        raise ConfigError(
            f"{source} has no scale: a corridor is cut by metres. Give its photos positions (plnerf capture "
            "reads GPS, geo.txt and gcp_list.txt), or survey it as one scene: plnerf survey."
        )
    ledger, settings = Ledger(out), to_json(config)
    poses = np.stack([shot.T_world_camera for shot in listing.shots])
    frames = frames_for(poses, up=listing.up, unit="m", crs=listing.crs, origin=listing.origin)
    frame, up = LineFrame.of_scene(frames), frames.R_scene_world[2]
    cameras = frame.cameras(scene_cameras(listing, frames, 1))
    held_out = frozenset(listing.shots[k].name for k in split(listing)[1])
    blocks = cut(cameras.centre.numpy()[:, :2], config.cut)
    finds = []
    for k, block in enumerate(blocks, 1):
        if len(block.every) >= LEAST_IMAGES:
            folder = f"find/{k:04d}"
            sha = write_block_scene(listing, block.every, up, held_out, out / folder)
            finds.append(Task("find", folder, {"scene": sha, "config": _deciding("find", settings)}))
    _do("find", finds, out, ledger, engine, heard)
    found = []
    for task in finds:
        if ledger.done(task):
            wires, own = read_wires(out / task.folder / WIRES)
            found.append([move_wire(wire, own, frame) for wire in wires])
    every = joined_wires(found, config.survey.detect)
    write_wires(out / WIRES, every, frame, {"blocks": len(found)})
    spans = planned_spans(every, config.survey.spans)
    uncertain = [wire for wire in every if not wire.evidence.certain]
    surveys: list[tuple[Task, tuple[int, ...]]] = []
    trains: list[Task] = []
    few = []
    for k, span in enumerate(spans):
        given = given_wires(spans, k, uncertain, config.cut.overlap_m)
        images = images_of(span, given, cameras, config.cut)
        if len(images) < LEAST_IMAGES:
            few.append(span.number.span)
            continue
        inputs = _write_span(
            out / f"spans/{span.number.span:04d}", listing, images, up, held_out, given, frame,
            part_of(spans, (k,), frame),
        )  # fmt: skip
        folder = f"spans/{span.number.span:04d}"
        if config.train.seconds > 0:
            train = Task("train", folder, inputs | {"config": _deciding("train", settings)})
            trains.append(train)
            inputs |= {"run": run_folder(Path(), train).name}
        task = Task("survey", folder, inputs | {"config": _deciding("survey", settings)})
        surveys.append((task, (span.number.span,)))
    _do("train", trains, out, ledger, engine, heard)
    able = [task for task, _ in surveys if "run" not in task.inputs or _trained(task, trains, ledger)]
    _do("survey", able, out, ledger, engine, heard)
    done = [(task, numbers) for task, numbers in surveys if ledger.done(task)]
    tasks = (*finds, *trains, *(task for task, _ in surveys))
    failed = tuple((task.name, ledger.record(task).error) for task in tasks if not ledger.done(task))
    if spans and not done:
        raise SurveyError(
            f"None of the {len(spans)} spans of {source} could be surveyed: {failed[0][0]}: {failed[0][1]}"
            if failed
            else f"No span of {source} is seen by {LEAST_IMAGES} photos. Film from nearer."
        )
    surveyed = read_blocks({out / task.folder / SURVEY: numbers for task, numbers in done})
    made = {"input": f"{listing.root.name}: {len(listing.shots)} images in {len(finds)} blocks"}
    survey = merged(surveyed, spans, frame, str(source), made)
    if few:
        text = f"{len(few)} of {len(spans)} spans are seen by fewer than {LEAST_IMAGES} photos."
        survey = replace(survey, findings=(*survey.findings, harms("corridor", text)))
    records = [(task, ledger.record(task)) for task in tasks]
    return write_results(out, survey, surveyed, records, settings, failed)


def _write_span(
    folder: Path, listing: Listing, images: Any, up: Any, held_out: frozenset[str], given: Any,
    frame: LineFrame, part: Part,
) -> dict[str, Any]:  # fmt: skip
    """Writes what a span's tasks read; returns the fingerprints of it."""
    sha = write_block_scene(listing, images, up, held_out, folder)
    write_wires(folder / GIVEN, given, frame, {})
    write_part(folder / PART, part)
    return {"scene": sha, "given": file_sha256(folder / GIVEN), "part": file_sha256(folder / PART)}


def _deciding(kind: Kind, settings: dict[str, Any]) -> dict[str, Any]:
    """The settings that decide what a kind of task makes, as a whole configuration."""
    plain: dict[str, Any] = json.loads(json.dumps(settings))
    survey = plain["survey"]
    if kind == "find":
        return {"survey": {"detect": survey["detect"], "poses": survey["poses"]}}
    if kind == "train":
        return {"train": plain["train"], "survey": {"detect": survey["detect"], "poses": survey["poses"]}}
    return {"survey": survey}


def _do(stage: Kind, tasks: Sequence[Task], out: Path, ledger: Ledger, engine: Engine, heard: Heard) -> None:
    """Does the tasks of a stage that are not done yet."""
    left = [task for task in tasks if not ledger.done(task)]
    heard(KINDS[stage], tasks, ledger)
    engine.run(out, left, lambda task: heard(KINDS[stage], tasks, ledger))
    heard(KINDS[stage], tasks, ledger)


def _trained(task: Task, trains: Sequence[Task], ledger: Ledger) -> bool:
    return any(one.folder == task.folder and ledger.done(one) for one in trains)
