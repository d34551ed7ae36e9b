"""Conductors found in the training images, kept in the run folder, and what training makes of them."""

import time
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import torch
from jaxtyping import Int

from plnerf.detect.curves import Curve, read_curves, write_curves
from plnerf.detect.detect import compile_search, find_curves
from plnerf.field.guides import Guides, guides_of
from plnerf.scene.cameras import project
from plnerf.scene.scene import Scene
from plnerf.train.config import RunConfig
from plnerf.train.pixels import Pool, detail_pools

CURVES = "curves.json"
WIDEST_PX = 24


def run_curves(config: RunConfig, scene: Scene, folder: Path) -> tuple[tuple[Curve, ...], float]:
    """The certain curves, and the seconds it took to find them: 0 where they are there already."""
    if not config.train.find_wires:
        return (), 0.0
    if (path := folder / CURVES).exists():
        return certain(read_curves(path)), 0.0
    compile_search()  # like that of the first step, not charged to a budget in seconds
    start = time.perf_counter()
    curves = find_curves(scene)
    folder.mkdir(parents=True, exist_ok=True)
    write_curves(path, curves)
    return certain(curves), time.perf_counter() - start


def certain(curves: Sequence[Curve]) -> tuple[Curve, ...]:
    """Those whose place the views fix: the others would lead samples astray."""
    return tuple(curve for curve in curves if curve.certain)


def guides_for(curves: Sequence[Curve], config: RunConfig) -> Guides | None:
    """The curves as the sampler wants them."""
    return guides_of(curves).to(config.device) if curves and config.model.sampler.guided else None


def favoured_pixels(config: RunConfig, scene: Scene, curves: Sequence[Curve]) -> tuple[Pool, ...]:
    """The pools of pixels that a run draws more often: details, and those along the curves."""
    cfg = config.train
    pools = detail_pools(scene.images, scene.train, cfg.detail_share, cfg.detail_part, cfg.detail_map)
    if curves and cfg.curve_share and len(pixels := curve_pixels(scene, curves)):
        return (*pools, Pool(pixels, cfg.curve_share))
    return pools


def curve_pixels(scene: Scene, curves: Sequence[Curve]) -> Int[np.ndarray, " d"]:
    """Flat indices of the training pixels within reach of a curve, in increasing order."""
    found = []
    points = [torch.from_numpy(curve.points(np.linspace(*curve.ends, 200))).float() for curve in curves]
    seen = [project(scene.cameras, p) for p in points]
    for i in sorted(scene.train):
        w, h = (int(side) for side in scene.cameras.size_px[i])
        near = np.zeros((h, w), np.uint8)
        for curve, (pixels, depths) in zip(curves, seen, strict=True):
            at, depth = pixels[i].numpy(), depths[i].numpy()
            inside = (depth > 1e-3) & (np.abs(at - [w / 2, h / 2]) < [2 * w, 2 * h]).all(1)
            width = 2 * curve.reach * float(scene.cameras.focal_px[i].mean()) / np.maximum(depth, 1e-3)
            for k in np.flatnonzero(inside[1:] & inside[:-1]):
                thick = int(np.clip(width[k], 3, WIDEST_PX))
                a, b = (tuple(int(v) for v in at[j]) for j in (k, k + 1))
                cv2.line(near, a, b, 255, thick)
        found.append(scene.images.starts[i] + np.flatnonzero(near))
    return np.concatenate(found).astype(np.int64)
