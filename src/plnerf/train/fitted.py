"""Settings that follow from a scene."""

from dataclasses import replace
from typing import TypeVar

from plnerf.render.config import ModelConfig, OccupancyGridConfig, SystemConfig
from plnerf.scene.scene import Scene

S = TypeVar("S", bound=SystemConfig)


def finest_of(model: SystemConfig) -> int | None:
    """Cells along an axis of the finest level; None: the model has no grid."""
    return model.field.grid.finest if isinstance(model, ModelConfig | OccupancyGridConfig) else None


def fit_to_scene(model: S, scene: Scene, cells_per_pixel: float) -> S:
    """The model with its finest level as fine as the pixels: cells of a pixel's width at 1 scene unit.

    The contracted cube is 4 wide and a pixel 1/f, so N_max = 4 f cells_per_pixel.  Cells finer than the
    pixels cost time and learn the noise of single views.
    """
    if not isinstance(model, ModelConfig | OccupancyGridConfig):
        return model  # has no grid
    focal_px = float(scene.cameras.focal_px.mean())
    grid = model.field.grid
    finest = max(grid.coarsest, round(4 * focal_px * cells_per_pixel))
    return replace(model, field=replace(model.field, grid=replace(grid, finest=finest)))
