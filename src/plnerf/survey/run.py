"""The survey of a run: what its field shows as a classified cloud, its conductors, and the report."""

from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float

from plnerf.detect.curves import read_curves
from plnerf.report.colours import KINDS
from plnerf.report.data import Picture
from plnerf.report.deliver import SurveyOptions, deliver
from plnerf.report.overlay import overlay
from plnerf.scene.cameras import project
from plnerf.scene.ply import read_ply
from plnerf.scene.scene import Scene
from plnerf.survey.classify import classified, ground_of, standing_on
from plnerf.survey.curve_wires import conductors_of_curves, is_upright, metre_of, require_upright
from plnerf.survey.field_surface import surface_points
from plnerf.survey.model import (
    NO_WIRE,
    UNCLASSIFIED,
    Cloud,
    Conductor,
    Survey,
)
from plnerf.survey.obstacles import sampled
from plnerf.survey.refine.curves import refit_curves
from plnerf.survey.stereo.cloud import loosened, with_stereo
from plnerf.survey.supports import between_supports
from plnerf.survey.wire_files import POINTS, survey_wires
from plnerf.train.guidance import CURVES
from plnerf.train.run import TrainedRun

LOOSE_POSES_PX = 0.5
PICTURES = 4


def survey_run(
    run: TrainedRun, out: Path, options: SurveyOptions, progress: Callable[[int, int], None] | None = None
) -> Path:
    """Writes wires.ply, the cloud, conductors, clearances and the report into `out`; returns its path."""
    told = progress or (lambda done, of: None)
    survey_wires(run, out, lambda done, of: told(done, 4 * of))
    vertex = read_ply(out / POINTS)["vertex"]
    points = np.stack([vertex[axis] for axis in "xyz"], 1).astype(np.float64)
    frames, path = run.scene.frames, run.folder / CURVES
    curves = [curve for curve in read_curves(path) if curve.certain] if path.exists() else []
    notes = [] if path.exists() else [
        f"The preset {run.config.preset} looks for no conductors in the images: train with pl-nerf-wire."
    ]  # fmt: skip
    field = surface_points(run, progress=lambda done, of: told(of + done, 4 * of))
    surface, doubts = with_stereo(
        run.scene, field, curves, progress=lambda done, of: told(2 * of + done, 4 * of)
    )
    notes += doubts
    curves, supports = between_supports(surface, field, curves, frames)
    if curves:
        require_upright(frames)
    refits, motion_px = refit_curves(
        run.scene, curves, metre_of(frames), supports.held, lambda done, of: told(3 * of + done, 4 * of)
    )
    conductors = conductors_of_curves(refits, frames, points)
    if motion_px > LOOSE_POSES_PX:
        notes.append(
            f"The images lie about {motion_px:.1f} px off their poses, as the wires in them show: better "
            "poses make better conductors."
        )
        surface = loosened(surface, motion_px)
    if conductors and len(supports.towers) < 2:
        notes.append(
            f"{len(supports.towers)} of 2 supports are seen: where none is, wires end with what the images "
            "show, and their sag is that of this piece."
        )
    towers = supports.towers
    if is_upright(frames):
        metre = metre_of(frames)
        ground = ground_of(surface, [one.fit.curve for one in conductors], supports.points, metre)
        towers = standing_on(ground, towers, metre)
        cloud, more = classified(surface, ground, conductors, supports.points, metre)
    else:
        n = len(surface.xyz)
        cloud = Cloud(
            surface.xyz, np.full(n, UNCLASSIFIED, np.uint8), np.full(n, NO_WIRE), surface.rgb, surface.sigma
        )
        more = ["The world's z is not up, so that nothing is classified: turn the poses of the scene."]
    survey = Survey(
        tuple(conductors), towers, cloud, frames.unit, frames.crs, frames.origin, str(run.folder),
        (*notes, *more),
    )  # fmt: skip
    made = {
        "input": f"{run.scene.root.name}: {len(run.scene.names)} images",
        "preset": f"{run.config.preset}, step {run.step:,}",
        "program": f"plnerf {version('plnerf')}",
        "date (UTC)": datetime.now(UTC).strftime("%Y-%m-%d %H:%M"),
    }
    pictures = drawn_over(run.scene, conductors)
    return deliver(survey, out, options, pictures=pictures, made=made, synthetic=True)


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
