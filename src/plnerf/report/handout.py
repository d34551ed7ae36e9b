"""A page about a run to hand on: one HTML file that asks no server for anything.

It holds a flight along the line (or stills where none was rendered), held-out photos beside the field's
renders under a wiper, and the run's survey in space.  The page is `data/report/handout.html`.
"""

import base64
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from plnerf.errors import PlnerfError, SurveyError
from plnerf.line.cloud import NO_WIRE, Cloud
from plnerf.line.files import read_survey, survey_in
from plnerf.line.survey import Survey
from plnerf.render.pictures import rgb_picture
from plnerf.render.views import render_view
from plnerf.report.nearest import by_need
from plnerf.report.overlay import jpeg_url
from plnerf.report.page import asset, environment
from plnerf.report.scene_view import view
from plnerf.report.words import found, where
from plnerf.scene.build_store import Progress
from plnerf.scene.files import write_text
from plnerf.scene.ply import read_ply
from plnerf.scene.whole_result import finish_exchange
from plnerf.train.evaluate import mean_appearance
from plnerf.train.render_run import evenly, shots_of
from plnerf.train.run import TrainedRun

VIDEO = "renders/path-rgb.mp4"
"""In a run folder, of `plnerf render RUN`."""
WIPES, STILLS = 3, 3
MOST_VIDEO = 64_000_000
"""Bytes of a video that a page holds."""


@dataclass(frozen=True)
class Still:
    """A picture of the page."""

    url: str
    caption: str


@dataclass(frozen=True)
class Wipe:
    """A photo and the render of the same view."""

    photo: str
    render: str
    caption: str
    width: int
    height: int


def write_handout(path: Path, run: TrainedRun, progress: Progress | None = None) -> None:
    """Writes the page, complete or not at all.

    What cannot be shown is left out, and the page states why.  Raises SurveyError where the run's survey
    cannot be read, PlnerfError where the file cannot be written.
    """
    report, missing = progress or (lambda done, total: None), list[str]()
    total = WIPES + STILLS
    wipes = _wipes(run, missing, lambda done: report(done, total))
    video = _video(run.folder / VIDEO, missing)
    stills = [] if video else _stills(run, missing, lambda done: report(WIPES + done, total))
    survey = _survey(run.folder / "survey", missing)
    page = environment().get_template("handout.html").render(
        title=f"{run.folder.resolve().name}: a power line as a radiance field",
        style=asset("page.css"),
        script=asset("view.js"),
        about=found(survey) if survey is not None else "",
        where=where(survey) if survey is not None else "",
        view=view(survey, by_need(survey)) if survey is not None else None,
        video=video,
        stills=stills,
        wipes=wipes,
        missing=missing,
        step=run.step,
        seconds=round(run.seconds),
    )  # fmt: skip
    report(total, total)
    write_text(path, page)


def _video(path: Path, missing: list[str]) -> str | None:
    """The flight as a data URL; None where there is none to show."""
    finish_exchange(path.parent)
    if not path.is_file():
        missing.append("No flight was rendered: plnerf render RUN makes one.")
        return None
    if (size := path.stat().st_size) > MOST_VIDEO:
        missing.append(f"The flight of {size / 1e6:.0f} MB is too large for a page. Render fewer frames.")
        return None
    return f"data:video/mp4;base64,{base64.b64encode(path.read_bytes()).decode()}"


def _wipes(run: TrainedRun, missing: list[str], done: Callable[[int], None]) -> list[Wipe]:
    """A few held-out views; none where the photos are not there."""
    try:
        scene = run.scene
    except (PlnerfError, OSError) as error:
        missing.append(f"No photos are shown: {error}")
        return []
    appearance, wipes = mean_appearance(run), []
    for k, i in enumerate(evenly(scene.test, WIPES)):
        seen = rgb_picture(render_view(run.model, scene.cameras[[i]], appearance, normals=False).rgb)
        name = scene.names[i].removeprefix("images/")
        h, w = seen.shape[:2]
        wipes.append(Wipe(jpeg_url(scene.images.image(i)), jpeg_url(seen), f"{name}, not trained on", w, h))
        done(k + 1)
    return wipes


def _stills(run: TrainedRun, missing: list[str], done: Callable[[int], None]) -> list[Still]:
    """A few views of a flight; none where the cameras make no path."""
    try:
        shots = shots_of(run, "path", STILLS, 1.0)
    except PlnerfError as error:
        missing.append(f"No stills are shown: {error}")
        return []
    stills = []
    for k, shot in enumerate(shots):
        picture = rgb_picture(render_view(run.model, shot.camera, shot.appearance, normals=False).rgb)
        stills.append(Still(jpeg_url(picture), f"Rendered {_PLACES[k]} the flight"))
        done(k + 1)
    return stills


_PLACES = ("at the start of", "in the middle of", "at the end of")


def _survey(folder: Path, missing: list[str]) -> Survey | None:
    """The run's survey with its points; None where it has none."""
    found_at = survey_in(folder)
    if found_at is None:
        missing.append("The run was not surveyed, so that no wires are drawn: plnerf survey RUN.")
        return None
    survey, path = read_survey(found_at), folder / "cloud.ply"
    if not path.is_file():
        missing.append(f"There are no points: {path.name} is not in the survey.")
        return survey
    rows = read_ply(path)["vertex"]
    if not {"x", "y", "z", "classification"} <= set(rows.dtype.names or ()):
        raise SurveyError(f"{path} has no x, y, z and classification. Survey again: plnerf survey.")
    xyz = np.stack([rows[axis] for axis in "xyz"], 1).astype(np.float64)
    places = xyz if survey.frame.unit == "unscaled" else survey.frame.from_world(xyz)
    wire = np.full(len(xyz), NO_WIRE, np.int64)
    return replace(survey, cloud=Cloud(places, rows["classification"].astype(np.uint8), wire))
