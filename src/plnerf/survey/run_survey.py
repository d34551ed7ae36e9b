"""The survey of a run: what its field shows as a classified cloud, its conductors, and the report."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Bool, Float

from plnerf.scene.cameras import project
from plnerf.scene.scene import Scene
from plnerf.scene.transforms import Frames
from plnerf.survey.curve_wires import conductors_of_curves, is_upright, metre_of, require_upright
from plnerf.survey.deliver import SurveyOptions, deliver
from plnerf.survey.ground import find_ground, vegetation
from plnerf.survey.model import (
    CONDUCTOR,
    GROUND,
    NO_WIRE,
    NOISE,
    SHIELD,
    TOWER,
    UNCLASSIFIED,
    Cloud,
    Conductor,
    Survey,
    Tower,
)
from plnerf.survey.obstacles import LOOSE_M, sampled
from plnerf.survey.on_wires import on_wires
from plnerf.survey.refine.curves import refit_curves
from plnerf.survey.report.colours import KINDS
from plnerf.survey.report.data import Picture
from plnerf.survey.report.overlay import overlay
from plnerf.survey.run_towers import find_columns
from plnerf.survey.stereo.surface import with_stereo
from plnerf.survey.surface import Surface, surface_points
from plnerf.survey.survey import POINTS, survey_wires
from plnerf.train.guidance import CURVES
from plnerf.train.run import TrainedRun
from plnerf.wires.curves import Curve, read_curves
from plnerf.wires.ply import read_ply

NEAR_GROUND_M = 0.3
"""A surface point this near to the ground, or twice its standard deviation, belongs to it."""
LOOSE_POSES_PX = 0.5
PICTURES = 4


@dataclass(frozen=True, eq=False)
class Supports:
    """At either end of the wires."""

    towers: tuple[Tower, ...]
    points: Bool[np.ndarray, " n"]
    """Those of the surface that are theirs."""
    seen: tuple[bool, bool]


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
        run.scene, curves, metre_of(frames), supports.seen, lambda done, of: told(3 * of + done, 4 * of)
    )
    conductors = conductors_of_curves(refits, frames, points)
    if motion_px > LOOSE_POSES_PX:
        notes.append(
            f"The images lie about {motion_px:.1f} px off their poses, as the wires in them show: better "
            "poses make better conductors."
        )
    if conductors and not all(supports.seen):
        notes.append(
            f"{len(supports.towers)} of 2 supports are seen: where none is, wires end with what the images "
            "show, and their sag is that of this piece."
        )
    if is_upright(frames):
        cloud, more = classified(surface, conductors, supports.points, metre_of(frames))
    else:
        n = len(surface.xyz)
        cloud = Cloud(
            surface.xyz, np.full(n, UNCLASSIFIED, np.uint8), np.full(n, NO_WIRE), surface.rgb, surface.sigma
        )
        more = ["The world's z is not up, so that nothing is classified: turn the poses of the scene."]
    survey = Survey(
        tuple(conductors), supports.towers, cloud, frames.unit, frames.crs, frames.origin, str(run.folder),
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


def between_supports(
    surface: Surface, field: Surface, curves: Sequence[Curve], frames: Frames
) -> tuple[list[Curve], Supports]:
    """The curves cut at the supports, and these.

    They are looked for in the field, which shows a lattice from all sides: stereo sees its near side alone.
    """
    metre = frames.scale * metre_of(frames)
    wires = [curve.points(np.linspace(*curve.ends, 60)) / metre for curve in curves]
    found = find_columns(frames.to_scene(field.xyz) / metre, wires)
    points = frames.to_scene(surface.xyz) / metre
    of_tower, towers, ends = np.zeros(len(surface.xyz), bool), [], []
    for column, open_end in zip(found, (-np.inf, np.inf), strict=True):
        ends.append(open_end if column is None else column.x_m * metre)
        if column is not None:
            of_tower |= column.holds(points, wires)
            foot = frames.to_world(metre * np.array([[column.x_m, column.y_m, column.foot_m]]))[0]
            towers.append(Tower(foot, (column.top_m - column.foot_m) * metre_of(frames)))
    cut = [
        replace(curve, ends=(max(curve.ends[0], ends[0]), min(curve.ends[1], ends[1]))) for curve in curves
    ]
    return cut, Supports(tuple(towers), of_tower, (found[0] is not None, found[1] is not None))


def classified(
    surface: Surface, conductors: Sequence[Conductor], of_tower: Bool[np.ndarray, " n"], metre: float = 1.0
) -> tuple[Cloud, list[str]]:
    """The surface's points as ground, supports, plants by their height, and conductors; and what is doubtful.

    Buildings are not told from plants.  metre: its length in the surface's units.
    """
    label = np.full(len(surface.xyz), UNCLASSIFIED, np.uint8)
    wire = np.full(len(surface.xyz), NO_WIRE, np.int64)
    sigma, notes = surface.sigma, []
    # Along flat ground a point may move as it will: only the upright part of its deviation counts.
    upright = surface.sigma * np.abs(surface.sight[:, 2])
    firm = upright <= LOOSE_M * metre
    ground = find_ground(surface.xyz[firm & ~of_tower] / metre) if (firm & ~of_tower).any() else None
    if ground is None:
        notes.append("The field shows no ground: its points are not classified, and no heights are known.")
    else:
        above = ground.above(surface.xyz / metre)
        on_it = firm & (np.abs(above) <= np.maximum(NEAR_GROUND_M, 2 * upright / metre))
        label[on_it] = GROUND
        sigma = np.where(on_it, upright, sigma)
        higher = (above > 0) & ~on_it
        label[higher] = vegetation(above[higher])
        notes.append("Buildings and all else that stands are classified as vegetation, by height.")
    label[of_tower] = TOWER
    nearest, smeared = on_wires(surface, [conductor.fit.curve for conductor in conductors], metre)
    label[smeared] = NOISE
    for k, conductor in enumerate(conductors):
        wire[nearest == k] = conductor.id
        label[nearest == k] = SHIELD if conductor.kind == "shield" else CONDUCTOR
    return Cloud(surface.xyz, label, wire, surface.rgb, sigma), notes


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
