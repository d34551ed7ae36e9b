"""Depth maps of a survey's stereo against true depths: processor seconds, and how many pixels are right.

    OMP_NUM_THREADS=1 taskset -c 0 python benchmarks/stereo_depths.py SCENE

SCENE: of `plnerf synth`, with depth pictures.  All images take part, also those held out, which have the true
depths; no wires are known.
"""

import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from plnerf.scene.scene import load_scene
from plnerf.survey.posed_photos import photos_of
from plnerf.survey.stereo.config import StereoConfig
from plnerf.survey.stereo.stereo_surface import stereo_surface
from plnerf.survey.stereo.witnesses import EVERY_PX, Sight

RIGHT, NEAR = 0.02, 1.5
"""Share of the true distance that a right one may be off; near is nearer than so many times the near
quantile."""


def main(root: Path, store: Path) -> None:
    """Prints a line for each view with a true depth, and their means."""
    scene = load_scene(root, store=store)
    photos = replace(photos_of(scene), train=tuple(range(len(scene.names))))
    cv2.setNumThreads(1)
    centres, sights = photos.cameras.centre.numpy(), dict[int, Sight]()

    def keep(sight: Sight) -> None:
        sights[int(np.linalg.norm(centres - sight.view.centre, axis=1).argmin())] = sight

    began = time.process_time()
    surface, _ = stereo_surface(photos, [], None, StereoConfig(), keep=keep)
    took, shares = time.process_time() - began, []
    for i, sight in sorted(sights.items()):
        view = sight.view
        file = root / "depth" / f"{Path(scene.names[i]).stem}.png"
        depth = cv2.imread(str(file), cv2.IMREAD_UNCHANGED) if file.exists() else None
        if depth is None or depth.shape != (view.height, view.width):
            continue  # no depth picture, or of another size than stereo's
        true = (depth / 1000 / (view.rays() @ view.axis))[::EVERY_PX, ::EVERY_PX]
        there = true > 0
        right = there & (np.abs(sight.t - true) < RIGHT * true)
        nearby = there & (true < NEAR * np.quantile(true[there], 0.05))
        shares.append((np.isfinite(sight.t)[there].mean(), right[there].mean(), right[nearby].mean()))
        print(f"{scene.names[i]}: ", "known {:.3f}, right {:.3f}, near right {:.3f}".format(*shares[-1]))
    print(
        f"{len(shares)} views, {took:.1f} s, {len(surface.xyz):,} points; "
        "known {:.3f}, right {:.3f}, near right {:.3f}".format(*np.mean(shares, axis=0))
    )


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        main(Path(sys.argv[1]), Path(folder))
