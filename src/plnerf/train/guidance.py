"""Wires detected in the training images, kept in the run folder, and what training makes of them."""

import time
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import torch
from jaxtyping import Int

from plnerf.detect.detect import compile_kernels, detect_wires
from plnerf.errors import ConfigError
from plnerf.field.guides import Guides, guides_of, reach_in_scene, scene_points
from plnerf.line.files import read_wires, write_wires
from plnerf.line.frame import LineFrame
from plnerf.line.wire import Wire
from plnerf.scene.cameras import project
from plnerf.scene.scene import Scene
from plnerf.train.config import RunConfig
from plnerf.train.pixels import Pool, detail_pools
from plnerf.train.scene_record import SceneRecord
from plnerf.train.settings import to_json

WIRES = "wires.json"
OLD_WIRES = "curves.json"
"""What earlier versions wrote in its place."""
WIDEST_PX = 24
POINTS = 200
"""Points of a wire that are joined in the images."""


def run_wires(config: RunConfig, scene: Scene, folder: Path) -> tuple[tuple[Wire, ...], float]:
    """The certain wires, and the seconds it took to detect them: 0 where they are there already.

    Raises ConfigError where an earlier version wrote the run, SurveyError where its wires cannot be read.
    """
    if not config.train.find_wires:
        return (), 0.0
    if (folder / OLD_WIRES).exists():
        raise ConfigError(
            f"{folder} was written by an earlier version of plnerf: it holds {OLD_WIRES}. Train again into "
            f"another folder: plnerf train {config.scene} -o FOLDER."
        )
    path = folder / WIRES
    if (kept := kept_wires(config, folder)) is not None:
        return certain(kept), 0.0
    compile_kernels()  # like that of the first step, not counted against a budget in seconds
    start = time.perf_counter()
    wires = detect_wires(scene, config.detect)
    folder.mkdir(parents=True, exist_ok=True)
    write_wires(path, wires, LineFrame.of_scene(scene.frames), to_json(config.detect))
    return certain(wires), time.perf_counter() - start


def kept_wires(config: RunConfig, folder: Path) -> tuple[Wire, ...] | None:
    """All wires in the run folder; None where they were not detected, or not yet."""
    path = folder / WIRES
    return read_wires(path)[0] if config.train.find_wires and path.exists() else None


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
    if wires and cfg.curve_share and len(pixels := wire_pixels(scene, wires)):
        return (*pools, Pool(pixels, cfg.curve_share))
    return pools


def wire_pixels(scene: Scene, wires: Sequence[Wire]) -> Int[np.ndarray, " d"]:
    """Flat indices of the training pixels within reach of a wire, in increasing order."""
    frame, found = LineFrame.of_scene(scene.frames), []
    points = [torch.from_numpy(scene_points(wire, frame, POINTS)).float() for wire in wires]
    seen = [project(scene.cameras, one) for one in points]
    reaches = [reach_in_scene(wire, frame) for wire in wires]
    for i in sorted(scene.train):
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
    return np.concatenate(found).astype(np.int64)
