"""Further formats of a run: Gaussians fitted to its field, as PLY, GLB or `.splat`."""

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from plnerf.export.splat_config import SplatConfig
from plnerf.export.splat_fit import fit_splats
from plnerf.export.splat_gltf import write_splat_glb
from plnerf.export.splat_place import Y_UP, Placement, about_drawn, placement, write_sidecar
from plnerf.export.splat_ply import write_splat, write_splat_ply
from plnerf.export.splat_score import Agreement, agreement
from plnerf.export.splat_views import target_views
from plnerf.export.splat_wires import wire_splats
from plnerf.export.splats import Splats
from plnerf.line.files import read_survey, survey_in
from plnerf.line.frame import LineFrame
from plnerf.line.move import move_wire
from plnerf.line.wire import Wire
from plnerf.scene.memory import require_memory
from plnerf.train.guidance import certain
from plnerf.train.render_run import evenly, refined_cameras
from plnerf.train.run import TrainedRun

SplatFormat = Literal["ply", "glb", "splat"]
SPLAT_FORMATS: tuple[SplatFormat, ...] = get_args(SplatFormat)
SPLAT_NAMES: dict[SplatFormat, str] = {"ply": "splats.ply", "glb": "splats.glb", "splat": "splats.splat"}
SIDECAR = "splats.json"
HELD_OUT = 16
"""Held-out views at most on which the agreement is measured."""
BYTES, VIEW_BYTES = 4 * 38 * 5, 8
"""Memory of a Gaussian of degree 2 at least (values, gradients, moments, a copy), and of a pixel."""
Stage = Callable[[str, int, int], None]
"""Called with a stage's name, what is done of it, and of how much."""


@dataclass(frozen=True, eq=False)
class Fitted:
    """Gaussians of a run in the LineFrame, with their wires, and how well they agree."""

    splats: Splats
    frame: LineFrame
    agreement: Agreement
    wires_from: str
    seconds: dict[str, float]


def splats_of(run: TrainedRun, config: SplatConfig, progress: Stage) -> Fitted:
    """Gaussians fitted to the field of a run.

    Raises ConfigError where they or the renders do not fit into memory, SurveyError where the run's survey
    cannot be read, TrainingError where the field shows no surface.
    """
    require_memory(
        float(BYTES * config.count + VIEW_BYTES * config.views * config.pixels),
        f"A fit of {config.count:,} Gaussians to {config.views:,} renders of {config.pixels:,} pixels",
        "Give smaller --splats.count, --splats.views or --splats.pixels.",
    )
    frame, start = LineFrame.of_scene(run.record.frames), time.perf_counter()
    wires, wires_from = run_wires(run, frame) if config.wires else ((), "none were asked for")
    record = run.record
    trained = evenly(record.train, config.views)
    held_out = evenly(record.test, HELD_OUT)
    cameras = refined_cameras(run.model, record.cameras)
    views = target_views(run, frame, cameras[trained], config.pixels, lambda *done: progress("render", *done))
    rendered = time.perf_counter()
    drawn = wire_splats(wires, config.degree)
    splats = fit_splats(views, drawn, config, lambda *done: progress("fit", *done))
    fitted = time.perf_counter()
    unseen = target_views(
        run, frame, record.cameras[held_out], config.pixels, lambda *done: progress("compare", *done)
    )
    found = agreement(run, splats, held_out, unseen)
    seconds = {"render": rendered - start, "fit": fitted - rendered, "compare": time.perf_counter() - fitted}
    return Fitted(splats, frame, found, wires_from, seconds)


def run_wires(run: TrainedRun, frame: LineFrame) -> tuple[tuple[Wire, ...], str]:
    """The wires of a run's survey, else those that it detected before training; and which of them."""
    path = survey_in(run.folder / "survey")
    if path is not None:
        survey = read_survey(path)
        wires = survey.wires
        if not survey.frame.same_as(frame):
            wires = tuple(move_wire(wire, survey.frame, frame) for wire in wires)
        return wires, "the survey of the run"
    return certain(run.wires or ()), "detected before training; not surveyed"


def write_splats(
    run: TrainedRun, fitted: Fitted, out: Path, formats: Sequence[SplatFormat], config: SplatConfig
) -> list[Path]:
    """Writes Gaussians in some formats, and the sidecar; returns the files."""
    place = placement(fitted.frame, fitted.splats.xyz, str(run.folder))
    local = place.local(fitted.splats)
    comments = _comments(place, local)
    names: dict[str, str] = {}
    for one in dict.fromkeys(formats):
        path = out / SPLAT_NAMES[one]
        names[one] = path.name
        if one == "ply":
            write_splat_ply(path, local, comments)
        elif one == "splat":
            write_splat(path, local)
        else:
            extras = {"comments": comments, "wires_for_display": [len(local) - local.drawn, local.drawn]}
            write_splat_glb(path, local.moved(Y_UP, np.zeros(3)), run.folder.name, extras)
    about: dict[str, Any] = {
        "agreement": asdict(fitted.agreement), "wires_from": fitted.wires_from, "settings": asdict(config),
        "seconds": fitted.seconds, "run": run.folder.name, "step": run.step,
    }  # fmt: skip
    write_sidecar(out / SIDECAR, place, local, names, about)
    return [*(out / name for name in names.values()), out / SIDECAR]


def _comments(place: Placement, local: Splats) -> list[str]:
    """Lines for the header of a file, in ASCII."""
    about = place.to_json()
    x, y, z = about["origin_in_world"]
    return [
        f"Gaussian splats fitted to a radiance field by plnerf; {SIDECAR} places them.",
        f"Unit: {about['unit']}. Origin: {x:.12g} {y:.12g} {z:.12g} of the world, {about['world']}.",
        about_drawn(local),
    ]
