"""Opens what the viewer is given, a run, a scene or a survey, as one value: whatever of it is there."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float

from plnerf.errors import ConfigError, PlnerfError
from plnerf.line.files import SURVEY_FILE, read_survey, survey_in
from plnerf.line.frame import LineFrame
from plnerf.line.survey import Survey
from plnerf.scene.build_store import reduced_sizes_px
from plnerf.scene.formats import has_poses, read_listing
from plnerf.scene.formats_colmap import read_colmap, read_sparse_points
from plnerf.scene.listing import Listing
from plnerf.scene.orientation import frames_for
from plnerf.scene.photos import PhotoFiles
from plnerf.scene.transforms import Frames
from plnerf.train.run import TrainedRun, open_run
from plnerf.view.display_frame import DisplayFrame
from plnerf.view.points import Points, read_survey_points, thinned
from plnerf.view.posed_views import PosedViews, views_of

CLOUD_FILE = "cloud.ply"
SURVEY_FOLDER = "survey"
"""Of a run or a scene, in its folder."""
SAME_PLACE = 1e-4
"""A model's cameras are the scene's if they are no farther apart than this share of the cameras' extent."""


@dataclass(frozen=True, eq=False)
class Opened:
    """What there is to show."""

    title: str
    frame: DisplayFrame
    survey: Survey | None = None
    points: Points | None = None
    views: PosedViews | None = None
    run: TrainedRun | None = None
    notes: tuple[str, ...] = ()
    """What could not be shown, and why."""


def open_source(source: Path, made_of: Path | None = None) -> Opened:
    """Opens a run folder, a scene, a survey folder or its survey.json.

    A run's or a scene's own survey is shown with it.  made_of: the run or scene of a survey; None: that whose
    folder the survey's is in.  What a survey's file names is not followed.  Raises ConfigError where it is
    none of these, other PlnerfErrors where it cannot be read.
    """
    given = source.parent if source.name == SURVEY_FILE else source
    notes: list[str] = []
    if (survey_at := survey_in(given)) is not None:
        survey: Survey | None = read_survey(survey_at)
        folder, root = given, made_of or given.resolve().parent
        if made_of is not None and not (is_run(made_of) or has_poses(made_of)):
            raise ConfigError(f"{made_of} is neither a run folder nor a scene with poses. Give one of these.")
        if made_of is None and given.resolve().name != SURVEY_FOLDER:
            root = given  # what lies beside a survey elsewhere need not be its own
    elif is_run(source) or has_poses(source):
        root = source
        folder = (source if source.is_dir() else source.parent) / SURVEY_FOLDER
        survey = _survey_of(folder, notes)
    else:
        raise ConfigError(
            f"{source} is neither a run folder, nor a scene with poses, nor the folder of a survey. Give one "
            "of these; a LAS or LAZ file is surveyed first: plnerf survey."
        )
    run, listing, frames = None, None, None
    try:
        run, listing, frames = _root(root, notes)
    except PlnerfError as error:
        if root in {source, made_of}:
            raise
        notes.append(f"Of {root} nothing is shown: {error}")
    line = survey.frame if survey is not None else LineFrame.of_scene(_known(frames))
    start = DisplayFrame(line, np.zeros(3))
    views = None if frames is None else _views(run, listing, frames, start, notes)
    points = _points(folder, survey, root, listing, line, notes)
    frame = replace(start, origin=_middle(survey, points, views))
    return Opened(str(source), frame, survey, points, views, run, tuple(notes))


def open_training(run: TrainedRun) -> Opened:
    """Opens a run that is being trained; its folder has a scene.json, but perhaps no checkpoint yet."""
    notes: list[str] = []
    listing, frames = _listing_of(run, notes), run.record.frames
    start = DisplayFrame(LineFrame.of_scene(frames), np.zeros(3))
    views = _views(run, listing, frames, start, notes)
    frame = replace(start, origin=_middle(None, None, views))
    return Opened(str(run.folder), frame, views=views, run=run, notes=tuple(notes))


def is_run(source: Path) -> bool:
    """Whether a folder is that of a run."""
    return (source / "config.json").is_file()


def _known(frames: Frames | None) -> Frames:
    assert frames is not None  # what is no survey has been read
    return frames


def _survey_of(folder: Path, notes: list[str]) -> Survey | None:
    try:
        path = survey_in(folder)
        return read_survey(path) if path is not None else None
    except PlnerfError as error:
        notes.append(f"Its survey is not shown: {error}")
        return None


def _root(root: Path, notes: list[str]) -> tuple[TrainedRun | None, Listing | None, Frames | None]:
    """The run or the scene in a folder, its images, and its scene frame; nothing where it is neither."""
    if is_run(root):
        run = open_run(root)
        return run, _listing_of(run, notes), run.record.frames
    if not has_poses(root):
        return None, None, None
    listing = read_listing(root)
    poses = np.stack([shot.T_world_camera for shot in listing.shots])
    frames = frames_for(poses, up=listing.up, unit=listing.unit, crs=listing.crs, origin=listing.origin)
    return None, listing, frames


def _listing_of(run: TrainedRun, notes: list[str]) -> Listing | None:
    """The images that a run was trained on, where they are still there."""
    try:
        listing = read_listing(Path(run.config.scene))
    except (PlnerfError, OSError) as error:
        notes.append(f"The photos are not shown: {error}")
        return None
    if tuple(shot.name for shot in listing.shots) != run.record.names:
        notes.append(f"The photos are not shown: {run.config.scene} has changed since it was trained on.")
        return None
    return listing


def _views(
    run: TrainedRun | None, listing: Listing | None, frames: Frames, frame: DisplayFrame, notes: list[str]
) -> PosedViews:
    """A run's cameras are those that it was trained with."""
    if run is None and listing is not None:
        return views_of(listing, frames, frame)
    assert run is not None
    cameras = frame.line_cameras(frames, run.record.cameras)
    if listing is None:
        return PosedViews(run.record.names, cameras, None)
    sizes = torch.from_numpy(reduced_sizes_px(listing.shots, 1))
    return PosedViews(run.record.names, cameras.at_size(sizes), PhotoFiles(listing.shots))


def _points(
    folder: Path,
    survey: Survey | None,
    root: Path,
    listing: Listing | None,
    line: LineFrame,
    notes: list[str],
) -> Points | None:
    """A survey's cloud; else the points of the scene's COLMAP model, if that is in the scene's world."""
    if survey is not None and (folder / CLOUD_FILE).is_file():
        try:
            return read_survey_points(folder / CLOUD_FILE, line)
        except PlnerfError as error:
            notes.append(f"The cloud is not shown: {error}")
    elif survey is not None:
        notes.append(f"There are no points: {folder} holds no {CLOUD_FILE}.")
    scene = listing.root if listing is not None else root
    if survey is not None or listing is None or not has_poses(scene):
        return None
    try:
        sparse = read_sparse_points(scene)
        if sparse is None or not _same_places(listing, read_colmap(scene)):
            return None
    except PlnerfError as error:
        notes.append(f"The points of its COLMAP model are not shown: {error}")
        return None
    xyz, rgb = sparse
    return thinned(line.from_world(xyz), None, rgb)


def _same_places(listing: Listing, model: Listing) -> bool:
    """Whether a model's cameras stand where the listing's do: a transforms.json may have moved them."""
    known = {shot.path.resolve(): shot.T_world_camera[:3, 3] for shot in model.shots}
    both = [
        (shot.T_world_camera[:3, 3], known[shot.path.resolve()])
        for shot in listing.shots
        if shot.path.resolve() in known
    ]
    if not both:
        return False
    ours, theirs = (np.array(one) for one in zip(*both, strict=True))
    extent = max(float(np.ptp(ours, axis=0).max()), 1e-9)
    return float(np.abs(ours - theirs).max()) <= SAME_PLACE * extent


def _middle(
    survey: Survey | None, points: Points | None, views: PosedViews | None
) -> Float[np.ndarray, "3"]:
    """The middle of the wires; without them of the points, else of the cameras; LineFrame."""
    if survey is not None and survey.wires:
        places = np.concatenate([wire.points(np.linspace(0, wire.base.length_m, 9)) for wire in survey.wires])
    elif points is not None and len(points.xyz):
        places = points.xyz
    elif views is not None:
        places = views.cameras.centre.numpy()
    else:
        return np.zeros(3)
    middle: Float[np.ndarray, 3] = np.percentile(places, [2, 98], axis=0).mean(0)
    return middle
