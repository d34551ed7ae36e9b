"""The survey of a run: what its field shows as a classified cloud, its conductors, and the report."""

from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from scipy.spatial import cKDTree

from plnerf.scene.cameras import project
from plnerf.scene.scene import Scene
from plnerf.survey.curve_wires import conductors_of_curves, metre_of
from plnerf.survey.deliver import SurveyOptions, deliver
from plnerf.survey.ground import find_ground, vegetation
from plnerf.survey.model import CONDUCTOR, GROUND, NO_WIRE, SHIELD, UNCLASSIFIED, Cloud, Conductor, Survey
from plnerf.survey.obstacles import sampled
from plnerf.survey.overlay import overlay
from plnerf.survey.report_colours import KINDS
from plnerf.survey.report_data import Picture
from plnerf.survey.surface import Surface, surface_points
from plnerf.survey.survey import POINTS, survey_wires
from plnerf.train.guidance import CURVES
from plnerf.train.run import TrainedRun
from plnerf.wires.curves import read_curves
from plnerf.wires.ply import read_ply

NEAR_GROUND_M = 0.3
"""A surface point this near to the ground, or twice its standard deviation, belongs to it."""
ON_WIRE_M = 0.25
"""A point this near to a conductor is on it."""
PICTURES = 4


def survey_run(
    run: TrainedRun, out: Path, options: SurveyOptions, progress: Callable[[int, int], None] | None = None
) -> Path:
    """Writes wires.ply, the cloud, conductors, clearances and the report into `out`; returns its path."""
    told = progress or (lambda done, of: None)
    survey_wires(run, out, lambda done, of: told(done, 2 * of))
    vertex = read_ply(out / POINTS)["vertex"]
    points = np.stack([vertex[axis] for axis in "xyz"], 1).astype(np.float64)
    frames, path = run.scene.frames, run.folder / CURVES
    conductors = conductors_of_curves(read_curves(path), frames, points) if path.exists() else []
    notes = [] if path.exists() else [
        f"The preset {run.config.preset} looks for no conductors in the images: train with pl-nerf-wire."
    ]  # fmt: skip
    surface = surface_points(run, progress=lambda done, of: told(of + done, 2 * of))
    cloud, more = classified(surface, conductors, metre_of(frames))
    survey = Survey(
        tuple(conductors), (), cloud, frames.unit, frames.crs, frames.origin, str(run.folder), (*notes, *more)
    )
    made = {
        "input": f"{run.scene.root.name}: {len(run.scene.names)} images",
        "preset": f"{run.config.preset}, step {run.step:,}",
        "program": f"plnerf {version('plnerf')}",
        "date (UTC)": datetime.now(UTC).strftime("%Y-%m-%d %H:%M"),
    }
    pictures = drawn_over(run.scene, conductors)
    return deliver(survey, out, options, pictures=pictures, made=made, synthetic=True)


def classified(
    surface: Surface, conductors: Sequence[Conductor], metre: float = 1.0
) -> tuple[Cloud, list[str]]:
    """The surface's points as ground, plants by their height, and conductors; and what could not be told.

    Towers and buildings are not told from plants.  metre: its length in the surface's units.
    """
    label = np.full(len(surface.xyz), UNCLASSIFIED, np.uint8)
    wire = np.full(len(surface.xyz), NO_WIRE, np.int64)
    notes = []
    ground = find_ground(surface.xyz / metre) if len(surface.xyz) else None
    if ground is None:
        notes.append("The field shows no ground: its points are not classified, and no heights are known.")
    else:
        above = ground.above(surface.xyz / metre)
        on_it = np.abs(above) <= np.maximum(NEAR_GROUND_M, 2 * surface.sigma / metre)
        label[on_it] = GROUND
        higher = (above > 0) & ~on_it
        label[higher] = vegetation(above[higher])
        notes.append("Towers, buildings and all else that stands are classified as vegetation by height.")
    for conductor in conductors:
        apart, _ = cKDTree(sampled(conductor.fit.curve)).query(
            surface.xyz, distance_upper_bound=ON_WIRE_M * metre, workers=-1
        )
        mine = np.isfinite(apart)
        wire[mine] = conductor.id
        label[mine] = SHIELD if conductor.kind == "shield" else CONDUCTOR
    return Cloud(surface.xyz, label, wire, surface.rgb, surface.sigma), notes


def drawn_over(scene: Scene, conductors: Sequence[Conductor]) -> tuple[Picture, ...]:
    """The conductors over some of the images, evenly chosen."""
    if not conductors:
        return ()
    chosen = np.unique(np.linspace(0, len(scene.names) - 1, PICTURES + 2).round().astype(int))[1:-1]
    pictures = []
    for i in chosen.tolist():
        lines = [_seen(scene, i, sampled(one.fit.curve)) for one in conductors]
        colours = [_rgb(KINDS[one.kind]) for one in conductors]
        pictures.append(Picture(scene.names[i], overlay(scene.images.image(i), lines, colours)))
    return tuple(pictures)


def _seen(scene: Scene, i: int, world: Float[np.ndarray, "v 3"]) -> Float[np.ndarray, "v 2"]:
    """Pixels of points of the world in an image, NaN behind the camera."""
    at = torch.from_numpy(scene.frames.to_scene(world)).float()
    pixels, depths = project(scene.cameras[[i]], at)
    shown: Float[np.ndarray, "v 2"] = pixels[0].double().numpy()
    shown[depths[0].numpy() <= 1e-3] = np.nan
    return shown


def _rgb(colour: str) -> tuple[int, int, int]:
    """Of #rrggbb."""
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)
