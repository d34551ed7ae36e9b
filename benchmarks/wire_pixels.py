"""Centre-line pixels of wires against the true curves of a synthetic scene.

    python benchmarks/wire_pixels.py -o OUT [--scene SCENE]

The truth: the conductors' axes, projected into each image, where they pass within `VISIBLE_PX` of a pixel of
the wire mask.  A found point is right if it lies within the tolerance of the truth, and a stretch of the
truth is found if a point lies within the tolerance of it.  Writes wire_pixels.json and prints one line.
"""

import json
import tempfile
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import torch
import tyro
from scipy.interpolate import CubicSpline
from scipy.spatial import cKDTree

from plnerf.bench.machine import circumstances
from plnerf.detect.line_pixels import WirePixels, wire_pixels
from plnerf.pipeline import bundled_span
from plnerf.scene.cameras import project
from plnerf.scene.scene import Scene, load_scene
from plnerf.score.truth import read_truth
from plnerf.train.truth import read_wire_mask

VISIBLE_PX = 1.5
SAMPLES = 8000
"""Points along one conductor; between them the truth is straight."""
FINER = 20


@dataclass(frozen=True)
class Measured:
    """Over all images."""

    points: int
    precision: float
    recall: float
    median_px: float
    """Median distance of the right points from the true curve."""
    p90_px: float
    bright_side_px: float
    """Mean signed distance, down being positive, of points on bright lines (their light side) ..."""
    dark_side_px: float
    """... and of those on dark ones."""
    ms: float
    """Mean time of an image."""


def true_curves(scene: Scene, images: Sequence[int]) -> list[np.ndarray]:
    """Points x, y of the visible true curves in each of the images, some hundredths of a pixel apart."""
    assert scene.truth is not None
    seen = []
    for wire in read_truth(scene.truth).wires:
        line = CubicSpline(np.arange(len(wire.polyline)), wire.polyline)
        points = line(np.linspace(0, len(wire.polyline) - 1, SAMPLES))
        seen.append(
            project(scene.cameras[list(images)], torch.from_numpy(scene.frames.to_scene(points)).float())
        )
    found = []
    for k, i in enumerate(images):
        mask = read_wire_mask(scene.wire_masks[i])
        away = cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, 5)
        h, w = mask.shape
        parts = [np.zeros((0, 2))]
        for pixels, depths in seen:
            at, front = pixels[k].numpy().astype(np.float64), depths[k].numpy() > 0
            inside = front & (at >= 0).all(1) & (at < [w, h]).all(1)
            column, row = np.where(inside[:, None], at, 0).astype(int).T
            visible = inside & (away[row, column] <= VISIBLE_PX)
            both = visible[1:] & visible[:-1]
            part = np.arange(FINER)[:, None, None] / FINER
            parts.append((at[:-1][both] * (1 - part) + at[1:][both] * part).reshape(-1, 2))
        found.append(np.concatenate(parts))
    return found


def measure(scene: Scene, images: Sequence[int], tolerance_px: float = 1.5) -> Measured:
    """What `wire_pixels` finds in the images against the truth."""
    distance, down, bright, right, stretches, seconds = [], [], [], [], [], 0.0
    for i, curve in zip(images, true_curves(scene, images), strict=True):
        image = np.ascontiguousarray(scene.images.image(i))
        start = time.perf_counter()
        points: WirePixels = wire_pixels(image)
        seconds += time.perf_counter() - start
        if not len(curve) or not len(points.at_px):
            right.append(np.zeros(len(points.at_px), bool))
            continue
        away, nearest = cKDTree(curve).query(points.at_px)
        near = away < tolerance_px
        right.append(near)
        distance.append(away[near])
        down.append((points.at_px - curve[nearest])[near, 1])
        bright.append(points.bright[near])
        cells = np.unique(np.floor(curve).astype(int), axis=0, return_index=True)[1]  # about one to a pixel
        stretches.append(cKDTree(points.at_px).query(curve[cells])[0] < tolerance_px)
    away, below, light = np.concatenate(distance), np.concatenate(down), np.concatenate(bright)
    shares = (float(np.concatenate(right).mean()), float(np.concatenate(stretches).mean()))
    spread = (float(np.median(away)), float(np.quantile(away, 0.9)))
    sides = (float(below[light].mean()), float(below[~light].mean()))
    return Measured(sum(map(len, right)), *shares, *spread, *sides, 1000 * seconds / len(images))


@dataclass(frozen=True)
class Arguments:
    """Measure centre-line pixels."""

    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """Folder for wire_pixels.json."""
    scene: Path | None = None
    """Synthetic scene; the bundled span when left out."""


def main(arguments: Arguments) -> None:
    """Measures all images of a scene."""
    with tempfile.TemporaryDirectory() as store:
        scene = load_scene(arguments.scene or bundled_span(), store=Path(store))
        wire_pixels(np.ascontiguousarray(scene.images.image(0)))  # compiles, or loads what was compiled
        measured = measure(scene, sorted(scene.wire_masks))
    arguments.out.mkdir(parents=True, exist_ok=True)
    report = {"circumstances": circumstances("cpu"), **asdict(measured)}
    (arguments.out / "wire_pixels.json").write_text(json.dumps(report, indent=1))
    print(measured)


if __name__ == "__main__":
    main(tyro.cli(Arguments))
