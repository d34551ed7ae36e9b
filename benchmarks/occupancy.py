"""What an occupancy grid spares and what it changes: `python benchmarks/occupancy.py RUN` of `instant-ngp`.

Renders the held-out views with the grid, and with every interval looked at.
"""

import sys
import time
from pathlib import Path

import numpy as np
import torch

from plnerf.errors import ConfigError
from plnerf.render.occupancy_grid import OccupancyGridNeRF
from plnerf.render.views import RenderedView, render_view
from plnerf.train.evaluate import mean_appearance
from plnerf.train.metrics import psnr_of_mse
from plnerf.train.run import TrainedRun, open_run


def main(folder: Path) -> None:
    """Prints what both pictures have in common."""
    run = open_run(folder)
    model = run.model
    if not isinstance(model, OccupancyGridNeRF):
        raise ConfigError(f"{folder} was trained by {run.config.preset!r}, which has no occupancy grid.")
    with_grid, seconds, share = pictures(run, model)
    model.skips = False
    without, seconds_without, _ = pictures(run, model)
    photos = [run.scene.images.image(i) / 255.0 for i in run.scene.test]
    difference = np.abs(np.stack([view.rgb for view in with_grid]) - np.stack([v.rgb for v in without]))
    met = float(model.occupancy.met.float().mean())
    print(f"{len(photos)} held-out views, {run.step} steps; cells looked at so far: {met:.1%}")
    print(f"intervals looked at: {share:.1%}; time of rendering: {seconds / seconds_without:.2f}")
    print(f"difference: mean {difference.mean():.5f}, 99.9 % below {np.quantile(difference, 0.999):.4f}, "
          f"largest {difference.max():.4f}")  # fmt: skip
    for name, views in (("with", with_grid), ("without", without)):
        errors = [np.mean((view.rgb - photo) ** 2) for view, photo in zip(views, photos, strict=True)]
        score = np.mean([psnr_of_mse(float(error)) for error in errors])
        print(f"held-out PSNR {name} the grid: {score:.2f} dB")


def pictures(run: TrainedRun, model: OccupancyGridNeRF) -> tuple[list[RenderedView], float, float]:
    """The held-out views, the seconds they took, and the share of intervals that were looked at."""
    looked: list[tuple[int, int]] = []
    own = model.evaluated

    def counted(unit: torch.Tensor, t: torch.Tensor) -> torch.Tensor:
        full = own(unit, t)
        looked.append((int(full.sum()), full.numel()))
        return full

    model.evaluated = counted  # type: ignore[method-assign]
    clock = time.perf_counter()
    appearance = mean_appearance(run)
    views = [render_view(model, run.scene.cameras[[i]], appearance, normals=False) for i in run.scene.test]
    seconds = time.perf_counter() - clock
    del model.evaluated
    full, of = np.sum(looked, axis=0)
    return views, seconds, float(full / of)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
