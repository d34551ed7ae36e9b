"""Wires detected in the training images, kept in the run folder, and what training makes of them."""

import time
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import torch
from jaxtyping import Int

from plnerf.capture.adjusted_poses import with_adjusted_poses
from plnerf.detect.detect import FindWires, compile_kernels, detect_wires
from plnerf.errors import ConfigError
from plnerf.field.guides import Guides, guides_of, reach_in_scene, scene_points
from plnerf.line.files import read_wires, write_wires
from plnerf.line.frame import LineFrame
from plnerf.line.move import move_wire
from plnerf.line.wire import Wire
from plnerf.scene.cameras import project
from plnerf.scene.orientation import fitted_frames
from plnerf.scene.scene import Scene
from plnerf.scene.transforms import Frames
from plnerf.train.config import RunConfig
from plnerf.train.pixels import Pool, detail_pools
from plnerf.train.scene_record import FILE as RECORD
from plnerf.train.scene_record import SceneRecord, read_record, write_record
from plnerf.train.settings import to_json

WIRES = "wires.json"
OLD_WIRES = "curves.json"
"""What earlier versions wrote in its place."""
WIDEST_PX = 24
POINTS = 200
"""Points of a wire that are joined in the images, and that frames are fitted to."""


def run_wires(
    config: RunConfig,
    scene: Scene,
    folder: Path,
    *,
    trained: bool = False,
    finder: FindWires | None = None,
) -> tuple[Scene, tuple[Wire, ...], float]:
    """The scene in the frames of its run, its certain wires there, and the seconds it took to detect them.

    Before wires are detected, poses are adjusted where that helps (`with_adjusted_poses`).  scene: as it was
    read.  trained: the run has a checkpoint, which is of the frames and wires in the folder.  finder: finds
    the wires in place of `detect_wires`.
    Of a new run the frames are fitted to the certain wires, or are the scene's own where there are none, and
    scene.json and wires.json are written.  Kept ones come back to the last bit.  Raises ConfigError where
    they are gone or an earlier version wrote them, SurveyError where the wires cannot be read.
    """
    if config.train.find_wires and (folder / OLD_WIRES).exists():
        raise ConfigError(
            f"{folder} was written by an earlier version of plnerf: it holds {OLD_WIRES}. Train again into "
            f"another folder: plnerf train {config.scene} -o FOLDER."
        )
    wires, seconds = kept_wires(config, folder, scene.frames), 0.0
    if trained or (wires is not None and (folder / RECORD).exists()):
        record = read_record(folder)
        scene = record.restored(scene)
        return scene, certain(trained_wires(config, folder, record.frames) or ()), 0.0
    if not config.train.find_wires:
        return scene, (), 0.0
    if wires is None:
        compile_kernels()  # like that of the first step, not counted against a budget in seconds
        start = time.perf_counter()
        scene, _ = with_adjusted_poses(scene, config.poses)
        wires = detect_wires(scene, config.detect) if finder is None else finder(scene, config.detect, None)
        seconds = time.perf_counter() - start
    fitted = fitted_to(certain(wires), scene)
    old, new = (LineFrame.of_scene(one.frames) for one in (scene, fitted))
    wires = tuple(move_wire(wire, old, new) for wire in wires) if fitted is not scene else wires
    folder.mkdir(parents=True, exist_ok=True)
    write_record(folder, SceneRecord.of(fitted))
    write_wires(folder / WIRES, wires, new, to_json(config.detect))
    return fitted, certain(wires), seconds


def fitted_to(wires: Sequence[Wire], scene: Scene) -> Scene:
    """The scene in frames fitted to wires, which are in its LineFrame; itself without wires."""
    if not wires:
        return scene
    frame = LineFrame.of_scene(scene.frames)
    points = [wire.points(np.linspace(0.0, wire.base.length_m, POINTS)) for wire in wires]
    return scene.in_frames(*fitted_frames(scene.frames, [frame.to_scene(one) for one in points]))


def kept_wires(config: RunConfig, folder: Path, frames: Frames) -> tuple[Wire, ...] | None:
    """All wires in the run folder, in the LineFrame of these frames; None where they were not detected, or
    not yet."""
    path, frame = folder / WIRES, LineFrame.of_scene(frames)
    if not config.train.find_wires or not path.exists():
        return None
    wires, written = read_wires(path)
    return wires if written.same_as(frame) else tuple(move_wire(wire, written, frame) for wire in wires)


def trained_wires(config: RunConfig, folder: Path, frames: Frames) -> tuple[Wire, ...] | None:
    """The same of a run that has been trained.  Raises ConfigError where its wires are gone."""
    wires = kept_wires(config, folder, frames)
    if config.train.find_wires and wires is None:
        raise ConfigError(
            f"{folder / WIRES} is not there: the model was trained with the wires in it. Copy the whole run "
            "folder, or train again."
        )
    return wires


def certain(wires: Sequence[Wire]) -> tuple[Wire, ...]:
    """Those whose place the views fix: the others would lead samples astray."""
    return tuple(wire for wire in wires if wire.evidence.certain)


def guides_for(wires: Sequence[Wire], scene: Scene | SceneRecord, config: RunConfig) -> Guides | None:
    """The wires as the sampler wants them."""
    if not wires or not config.model.sampler.guided:
        return None
    return guides_of(wires, LineFrame.of_scene(scene.frames)).to(config.device)


def favoured_pixels(config: RunConfig, scene: Scene, wires: Sequence[Wire]) -> tuple[Pool, ...]:
    """The pools of pixels that a run draws more often: details, and those along the wires."""
    cfg = config.train
    pools = detail_pools(
        scene.images, scene.train, cfg.detail_share, cfg.detail_part, cfg.detail_map, config.detect.ridges
    )
    if wires and cfg.curve_share and len(pixels := wire_pixels(scene, wires, scene.train)):
        return (*pools, Pool(pixels, cfg.curve_share))
    return pools


def wire_pixels(scene: Scene, wires: Sequence[Wire], images: Sequence[int]) -> Int[np.ndarray, " d"]:
    """Flat indices of the pixels of some images within reach of a wire, in increasing order."""
    frame, found = LineFrame.of_scene(scene.frames), []
    points = [torch.from_numpy(scene_points(wire, frame, POINTS)).float() for wire in wires]
    seen = [project(scene.cameras, one) for one in points]
    reaches = [reach_in_scene(wire, frame) for wire in wires]
    for i in sorted(images):
        w, h = (int(side) for side in scene.cameras.size_px[i])
        near = np.zeros((h, w), np.uint8)
        for reach, (pixels, depths) in zip(reaches, seen, strict=True):
            at, depth = pixels[i].numpy(), depths[i].numpy()
            inside = (depth > 1e-3) & (np.abs(at - [w / 2, h / 2]) < [2 * w, 2 * h]).all(1)
            width = 2 * reach * float(scene.cameras.focal_px[i].mean()) / np.maximum(depth, 1e-3)
            for k in np.flatnonzero(inside[1:] & inside[:-1]):
                thick = int(np.clip(width[k], 3, WIDEST_PX))
                a, b = (tuple(int(v) for v in at[j]) for j in (k, k + 1))
                cv2.line(near, a, b, 255, thick)
        found.append(scene.images.starts[i] + np.flatnonzero(near))
    return np.concatenate([np.zeros(0, np.int64), *found]).astype(np.int64)
