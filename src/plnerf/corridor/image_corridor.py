"""A corridor of images, block after block: wires of each, spans of all wires, then a block for each span.

OUT/find/K/     a block of images in which wires are looked for: transforms.json, wires.json
OUT/wires.json  the wires of all blocks, joined
OUT/spans/K/    a span: its scene, given wires, part, field if asked for, survey/ with its report
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from plnerf.corridor.block_scene import GIVEN, LEAST_IMAGES, write_block_scene
from plnerf.corridor.config import CorridorConfig
from plnerf.corridor.cut import cut
from plnerf.corridor.ledger import Task
from plnerf.corridor.part_file import PART, write_part
from plnerf.corridor.plan import given_wires, images_of, joined_wires, part_of, planned_spans
from plnerf.corridor.stages import Stages, Surveyed
from plnerf.corridor.tasks import WIRES, run_folder
from plnerf.errors import ConfigError
from plnerf.findings import harms
from plnerf.line.files import read_wires, write_wires
from plnerf.line.frame import LineFrame
from plnerf.line.move import move_wire
from plnerf.line.wire import Wire
from plnerf.scene.cameras import Cameras
from plnerf.scene.fingerprint import file_sha256
from plnerf.scene.formats import read_listing
from plnerf.scene.listing import Listing
from plnerf.scene.orientation import frames_for
from plnerf.scene.scene import scene_cameras, split
from plnerf.survey.part import Part
from plnerf.train.settings import to_json

SPANS = "spans"


def survey_images(source: Path, config: CorridorConfig, stages: Stages) -> Surveyed:
    """Finds wires in all blocks, and surveys every span.  Raises ConfigError where the scene has no scale."""
    photos = _Photos.read(source)
    settings = to_json(config)
    finds = []
    for k, block in enumerate(cut(photos.cameras.centre.numpy()[:, :2], config.cut), 1):
        if len(block.every) >= LEAST_IMAGES:
            sha = photos.write(block.every, stages.out / f"find/{k:04d}")
            deciding = {"survey": _some(settings, "detect", "poses")}
            finds.append(Task("find", f"find/{k:04d}", {"scene": sha, "config": deciding}))
    found = [
        [move_wire(wire, own, photos.frame) for wire in wires]
        for task in stages.do("find", finds)
        for wires, own in (read_wires(stages.out / task.folder / WIRES),)
    ]
    every = joined_wires(found, config.survey.detect)
    write_wires(stages.out / WIRES, every, photos.frame, {"blocks": len(found)})
    spans = planned_spans(every, config.survey.spans)
    uncertain = [wire for wire in every if not wire.evidence.certain]
    surveys, trains, few = list[tuple[Task, tuple[int, ...]]](), list[Task](), 0
    for k, span in enumerate(spans):
        given = given_wires(spans, k, uncertain, config.cut)
        images = images_of(span, given, photos.cameras, config.cut)
        if len(images) < LEAST_IMAGES:
            few += 1
            continue
        folder = f"{SPANS}/{span.number.span:04d}"
        inputs = photos.write_span(stages.out / folder, images, given, part_of(spans, (k,), photos.frame))
        if config.train.seconds > 0:
            deciding = {"train": settings["train"], "survey": _some(settings, "detect", "poses")}
            trains.append(Task("train", folder, inputs | {"config": deciding}))
            inputs |= {"run": run_folder(Path(), trains[-1]).name}
        task = Task("survey", folder, inputs | {"config": {"survey": settings["survey"]}})
        surveys.append((task, (span.number.span,)))
    trained = {task.folder for task in stages.do("train", trains)} if trains else set()
    stages.do("survey", [task for task, _ in surveys if not trains or task.folder in trained])
    text = f"{few} of {len(spans)} spans are seen by fewer than {LEAST_IMAGES} photos, and are not surveyed."
    return Surveyed(
        photos.frame,
        (*finds, *trains, *(task for task, _ in surveys)),
        tuple(surveys),
        tuple(span.number.span for span in spans),
        f"{photos.listing.root.name}: {len(photos.listing.shots)} images in {len(finds)} blocks",
        (harms("corridor", text),) if few else (),
    )


def _some(settings: dict[str, Any], *names: str) -> dict[str, Any]:
    """Those of a survey's settings that decide what a task makes."""
    return {name: settings["survey"][name] for name in names}


class _Photos:
    """The photos of a corridor, with their cameras in its LineFrame."""

    def __init__(
        self, listing: Listing, frame: LineFrame, up: Float[np.ndarray, "3"], cameras: Cameras
    ) -> None:
        self.listing, self.frame, self.up, self.cameras = listing, frame, up, cameras
        self.held_out = frozenset(listing.shots[k].name for k in split(listing)[1])

    @classmethod
    def read(cls, source: Path) -> "_Photos":
        listing = read_listing(source)
        if listing.unit != "m":
            raise ConfigError(
                f"{source} has no scale: a corridor is cut by metres. Give its photos positions (plnerf "
                "capture reads GPS, geo.txt and gcp_list.txt), or survey it as one scene: plnerf survey."
            )
        poses = np.stack([shot.T_world_camera for shot in listing.shots])
        frames = frames_for(poses, up=listing.up, unit="m", crs=listing.crs, origin=listing.origin)
        frame = LineFrame.of_scene(frames)
        cameras = frame.cameras(scene_cameras(listing, frames, 1))
        return cls(listing, frame, frames.up_world, cameras)

    def write(self, images: Int[np.ndarray, " k"], folder: Path) -> str:
        """The scene of some of them, by reference; returns its fingerprint."""
        return write_block_scene(self.listing, images, self.up, self.held_out, folder)

    def write_span(
        self, folder: Path, images: Int[np.ndarray, " k"], given: Sequence[Wire], part: Part
    ) -> dict[str, Any]:
        """What a span's tasks read; returns the fingerprints of it."""
        sha = self.write(images, folder)
        write_wires(folder / GIVEN, given, self.frame, {})
        write_part(folder / PART, part)
        return {"scene": sha, "given": file_sha256(folder / GIVEN), "part": file_sha256(folder / PART)}
