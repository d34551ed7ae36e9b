"""Whether the layer of uncertainty is large where depths are wrong: `uncertainty.py RUN`.

RUN: of a scene with true depths; its held-out views, pixels with a surface and a true depth below 65 m.
Printed: Spearman's correlation of the deviation with the depth's error; the area under the sparsification
error (AUSE) beside that of removing any pixels; and how often the error is less than the deviation.  AUSE is
the mean error of what is left when pixels of the greatest deviation are removed, above that when those of the
greatest error are, as a share of the mean error: 0 is perfect.
"""

import argparse
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.stats import spearmanr

from plnerf.render.pictures import world_depth, world_deviation
from plnerf.render.views import render_view
from plnerf.train.evaluate import mean_appearance
from plnerf.train.run import open_run
from plnerf.train.true_pictures import read_depth_mm

STEPS = 50


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("run", type=Path)
    run = open_run(parser.parse_args().run)
    errors, deviations = [], []
    for i in run.scene.test:
        view = render_view(
            run.model, run.scene.cameras[[i]], mean_appearance(run), normals=False, deviation=True
        )
        truth, depth = read_depth_mm(run.scene.depths[i]) / 1000, world_depth(view, run.scene.frames)
        known = (truth > 0) & (truth < 65) & (depth > 0)
        errors.append(np.abs(depth - truth)[known])
        deviations.append(world_deviation(view, run.scene.frames)[known])
    error, deviation = np.concatenate(errors), np.concatenate(deviations)
    best = sparsified(error, error)
    ause, chance = (
        float((sparsified(error, by) - best).mean())
        for by in (deviation, np.random.default_rng(0).random(len(error)))
    )
    middle, spread = np.median(error), np.median(deviation)
    print(f"{len(error):,} pixels; median error {middle:.2f} m, median deviation {spread:.2f} m")
    print(f"Spearman {spearmanr(error, deviation)[0]:.2f}; AUSE {ause:.2f}, by chance {chance:.2f}")
    print(f"error less than the deviation: {np.mean(error < deviation):.1%}")


def sparsified(error: Float[np.ndarray, " n"], by: Float[np.ndarray, " n"]) -> Float[np.ndarray, " k"]:
    """Mean error of what is left when ever more of what is greatest `by` is removed, as share of the mean."""
    ordered = error[np.argsort(by)]
    left = [ordered[: round(len(error) * (1 - k / STEPS))].mean() for k in range(STEPS)]
    return np.array(left) / error.mean()


if __name__ == "__main__":
    main()
