"""Depth maps of held-out views against true depths: processor seconds, and how many pixels are right.

    OMP_NUM_THREADS=1 python benchmarks/stereo_depths.py SCENE

SCENE: of `plnerf synth`, with depth pictures.  Each view is matched with training images.  Partners and
disparities follow from the 50 % and 5 % quantiles of the true depths, so that two commits are compared on the
same pairs.
"""

import sys
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np

from plnerf.scene.scene import load_scene
from plnerf.survey.posed_photos import photos_of
from plnerf.survey.stereo.config import StereoConfig
from plnerf.survey.stereo.depth import depth_map
from plnerf.survey.stereo.partners import joined_partners, partners
from plnerf.survey.stereo.stereo_views import picture, view_of

RIGHT, NEAR = 0.02, 1.5
"""Share of the true distance that a right one may be off; near is nearer than so many times the near
quantile."""


def main(root: Path, store: Path) -> None:
    """Prints a line for each held-out view."""
    config, scene = StereoConfig(), load_scene(root, store=store)
    photos = photos_of(scene)
    cv2.setNumThreads(1)
    for i in sorted(set(range(len(scene.names))) - set(photos.train)):
        index = [i, *photos.train]
        views = [view_of(photos, k, config.longest_px) for k in index]
        depth = cv2.imread(str(root / "depth" / f"{Path(scene.names[i]).stem}.png"), cv2.IMREAD_UNCHANGED)
        if depth is None or depth.shape != (views[0].height, views[0].width):
            continue  # no depth picture, or of another size than stereo's
        true = depth / 1000 / (views[0].rays() @ views[0].axis)
        there = depth > 0
        far, near = np.quantile(true[there], (0.5, 0.05))
        some = [partners(views, np.full(len(views), distance), config.pairs)[:1] for distance in (far, near)]
        chosen = joined_partners(*some)[0]
        if len(chosen) < 2:
            continue
        began = time.process_time()
        mine, *others = (picture(photos, index[k], views[k], config.longest_px)[0] for k in (0, *chosen))
        t = depth_map(mine, others, float(near), config.match).t
        took = time.process_time() - began
        right = there & (np.abs(t - true) < RIGHT * true)
        nearby = there & (true < NEAR * near)
        print(
            f"{scene.names[i]}: {len(chosen)} pairs, {took:.2f} s; known {np.isfinite(t)[there].mean():.3f}, "
            f"right {right[there].mean():.3f}, near right {right[nearby].mean():.3f}"
        )


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        main(Path(sys.argv[1]), Path(folder))
