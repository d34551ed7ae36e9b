"""All stages in one call, the answers first: poses, a survey of the images, training, and the survey again.

    OUT/scene/    capture             (left out where the input is a scene with poses)
    OUT/survey/   survey of the scene, from images and poses alone: the first report
    OUT/wires.json  the wires that it found, which training and the second survey read
    OUT/run/      train, survey with the field (the refined report), eval, render

Nothing is printed: stages are announced by callbacks.
"""

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from plnerf.capture.capture import CaptureConfig
from plnerf.detect.detect import FindWires
from plnerf.detect.kept_wires import KeptWires
from plnerf.doctor import stage_times
from plnerf.errors import ConfigError
from plnerf.pipeline import capture_scene, evaluate, render, resume_run, survey, train_scene
from plnerf.render.picture_files import write_text
from plnerf.scene.fingerprint import file_sha256, listing_sha256, photos_sha256
from plnerf.scene.formats import has_poses, read_listing
from plnerf.scene.listing import Listing
from plnerf.scene.only_writer import only_writer
from plnerf.scene.strict_json import object_of, read_json, shown
from plnerf.survey.config import SurveyConfig
from plnerf.train.checkpoint import list_checkpoints

STATE = "reconstruct.json"
LEAST_PX = 200
"""Longer side of images in which stereo still sees plants and structures."""
FIRST, WIRES = "first survey", "wires.json"
"""Name of the first survey in the state, and of the file that holds the wires that it found."""
RESULTS = {"survey": "survey", "eval": "eval", "render": "renders"}
"""Stages after training, in their order, and the folders of their results in the run's."""


@dataclass(frozen=True)
class Training:
    """What `reconstruct` trains; a change of any of it trains anew."""

    preset: str = "pl-nerf-wire"
    seconds: float = 300.0
    downscale: int = 1
    seed: int = 0


def _render_path(run: Path) -> Path:
    return render(run, views="path", outputs=("rgb", "depth"))


def _survey(source: Path, out: Path, finder: FindWires, config: SurveyConfig) -> object:
    return survey(source, config, out, finder=finder)


@dataclass(frozen=True)
class Stages:
    """The stages that `reconstruct` calls; the command line puts in its own, which show their progress.

    Surveys get a scene or a run, the folder to write, what finds the wires, and settings; training gets what
    finds the wires as its option `finder`.
    """

    capture: Callable[[Path, Path, CaptureConfig], object] = capture_scene
    train: Callable[..., object] = train_scene
    resume: Callable[[Path, Path], object] = resume_run
    eval: Callable[[Path], object] = evaluate
    render: Callable[[Path], object] = _render_path
    survey: Callable[[Path, Path, FindWires, SurveyConfig], object] = _survey


@dataclass(frozen=True)
class Listener:
    """Callbacks that announce the stages; without others, nothing is announced."""

    skipped: Callable[[str], None] = lambda text: None
    """Called with a line about every stage that is up to date, and about a run that is put aside."""
    begins: Callable[[str, float | None], None] = lambda stage, seconds: None
    """Called before a stage with what it does and an estimate of its seconds; None: not estimated."""


def reconstruct(
    source: Path,
    out: Path,
    training: Training | None = None,
    capture: CaptureConfig | None = None,
    stages: Stages | None = None,
    listener: Listener | None = None,
) -> Path:
    """Photos in, two reports and pictures out; returns the run folder.  Errors are those of the stages.

    A stage is done again where its inputs changed (poses, photos, settings, the newest checkpoint), and where
    a file that it wrote is gone.  A run of other settings is kept, as run-1, run-2, ...
    """
    with only_writer(out):
        return _reconstruct(
            source, out, training or Training(), capture, stages or Stages(), listener or Listener()
        )


def _reconstruct(
    source: Path,
    out: Path,
    training: Training,
    capture: CaptureConfig | None,
    stages: Stages,
    listener: Listener,
) -> Path:
    scene, run = source, out / "run"
    if not has_poses(source):
        scene = out / "scene"
        if not has_poses(scene):
            listener.begins("capture: camera poses", stage_times.capture_s(source))
        stages.capture(source, scene, capture or CaptureConfig())
    listing = read_listing(scene)
    transforms = scene / "transforms.json" if scene.is_dir() else scene
    poses = file_sha256(transforms) if transforms.is_file() else ""
    wanted = {
        **asdict(training), "scene": str(scene.resolve()), "poses": poses, "photos": photos_sha256(listing)
    }  # fmt: skip
    state = State(out / STATE)
    finder = KeptWires(out / WIRES, listing_sha256(listing))
    _survey_first(scene, out, state, finder, stages, listener, listing)
    if state.values.get("training") not in {None, json.dumps(wanted)} and run.exists():
        listener.skipped(f"the run of other settings or poses: {_put_aside(run)}")
        state.forget("training", *RESULTS)
    state.write(training=json.dumps(wanted))
    listener.begins(f"train: {training.preset}", None if (run / "config.json").exists() else training.seconds)
    if (run / "config.json").exists():
        stages.resume(scene, run)
    else:
        stages.train(scene, run, **asdict(training), finder=finder)
    newest = list_checkpoints(run / "checkpoints")[-1].stem
    after: dict[str, Callable[[], object]] = {
        "survey": lambda: stages.survey(run, run / RESULTS["survey"], finder, SurveyConfig()),
        "eval": lambda: stages.eval(run),
        "render": lambda: stages.render(run),
    }
    for name, stage in after.items():
        if state.holds(name, newest, run):
            listener.skipped(f"{name}: there already, of {newest}")
            continue
        listener.begins(ABOUT[name], stage_times.ESTIMATES[name](listing, training.downscale))
        stage()
        state.done(name, newest, run, sorted((run / RESULTS[name]).rglob("*")))
    return run


ABOUT = {
    "survey": "survey with the field: the refined report",
    "eval": "eval: held-out views",
    "render": "render: a fly-along",
}
"""Stages after training, in words."""


def _survey_first(
    scene: Path,
    out: Path,
    state: "State",
    finder: KeptWires,
    stages: Stages,
    listener: Listener,
    listing: Listing,
) -> None:
    """Surveys the scene where that was not done of these photos and poses, or a file of it is gone."""
    folder, key = out / "survey", finder.scene_sha256
    if state.holds(FIRST, key, out) and finder.readable():
        listener.skipped(f"{FIRST}: there already, {folder}")
        return
    about = "survey of the scene: the first report, from images and poses alone"
    config = first_config(listing)
    listener.begins(about, stage_times.survey_s(listing, config))
    stages.survey(scene, folder, finder, config)
    state.done(FIRST, key, out, [finder.path, *sorted(folder.rglob("*"))])


def first_config(listing: Listing) -> SurveyConfig:
    """Settings of the first survey: stereo at half of the size that it would have, an eighth of its work.

    Wires are found and fitted in the photos at their full size, as ever; images of less than twice
    `LEAST_PX` are not reduced.
    """
    config = SurveyConfig()
    longest = max(max(shot.intrinsics.width, shot.intrinsics.height) for shot in listing.shots)
    half = min(longest, config.stereo.longest_px) // 2
    if half < LEAST_PX:
        return config
    coarse = replace(config.stereo.coarse, longest_px=min(half, config.stereo.coarse.longest_px))
    return replace(config, stereo=replace(config.stereo, longest_px=half, coarse=coarse))


def _put_aside(run: Path) -> Path:
    """Renames a run folder to the first free of run-1, run-2, ... and returns it."""
    aside = next(path for k in range(1, 10_000) if not (path := run.with_name(f"run-{k}")).exists())
    with only_writer(run):  # not from under a training
        pass
    return run.replace(aside)


class State:
    """What was done of which inputs, and the files that it left: texts by name, kept in a file."""

    def __init__(self, path: Path) -> None:
        """Raises ConfigError where the file is damaged; where there is none, nothing was done."""
        self._path, self.values = path, read_state(path)

    def holds(self, name: str, key: str, root: Path) -> bool:
        """Whether a stage was done of the inputs that `key` names, and its files below `root` are there.

        What they hold is not compared: whoever surveys again with other settings wants that survey.
        """
        names = self.values.get(f"{name} files", "").splitlines()
        return self.values.get(name) == key and all((root / one).is_file() for one in names)

    def done(self, name: str, key: str, root: Path, written: list[Path]) -> None:
        """Notes that a stage was done, and which of these paths are its files."""
        files = [path.relative_to(root).as_posix() for path in written if path.is_file()]
        self.write(**{name: key, f"{name} files": "\n".join(files)})

    def forget(self, *names: str) -> None:
        """Forgets what was noted of some stages."""
        gone = {*names, *(f"{name} files" for name in names)}
        self.values = {name: value for name, value in self.values.items() if name not in gone}

    def write(self, **values: str) -> None:
        """Adds values and writes the file."""
        self.values |= values
        write_text(self._path, json.dumps(self.values, indent=1) + "\n")


def read_state(path: Path) -> dict[str, str]:
    """The texts of the state; none where there is no file yet.  Raises ConfigError where it is damaged."""
    if not path.exists():
        return {}
    do = "Remove it: the run is kept, and another one is trained."
    state = object_of(read_json(path, ConfigError, do), str(path), ConfigError, do)
    if not all(isinstance(value, str) for value in state.values()):
        raise ConfigError(f"{path} must hold texts, but holds {shown(state)}. {do}")
    return {str(key): str(value) for key, value in state.items()}
