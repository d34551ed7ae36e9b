"""The suite `coverage`: whether stated intervals hold, over drawn scenes whose every figure is known.

LiDAR flights over spans in wind are simulated, random scenes rendered, and scenes that are there already
taken; each is surveyed with the default settings and every figure compared with the truth, which nothing but
the score reads.  A scene that has its figures is not surveyed again: a suite that was interrupted goes on.
"""

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

from rich.console import Console

from plnerf.bench.config import BenchConfig
from plnerf.bench.coverage_page import write_coverage
from plnerf.bench.tables import Table
from plnerf.console import bar
from plnerf.errors import ConfigError
from plnerf.line.files import SURVEY_FILE, read_survey, write_survey_json
from plnerf.line.survey import Survey
from plnerf.scene.files import write_text
from plnerf.scene.scene import load_scene
from plnerf.scene.strict_json import read_json
from plnerf.score.intervals import Figure, figures_of
from plnerf.survey.lidar.point_cloud import read_cloud
from plnerf.survey.run import survey_cloud, survey_scene
from plnerf.synth.lidar import CLOUD, simulate_lidar
from plnerf.synth.lidar_config import random_lidar_scene
from plnerf.synth.scene_options import RANDOM, SceneOptions, find_scene
from plnerf.synth.synthesize import synthesize

FIGURES = "figures.json"
SAMPLES = 8
"""Light paths of a pixel of the scenes that are rendered."""


@dataclass(frozen=True)
class Drawn:
    """One scene, and how it is surveyed."""

    name: str
    source: str
    """lidar or images."""
    survey: Callable[[Path], tuple[Survey, Path]]
    """Given a folder for intermediate files, returns the survey and the path of its truth.json."""


def measure_coverage(bench: BenchConfig, console: Console) -> tuple[tuple[Table, ...], dict[str, Any]]:
    """Tables, one of each kind of input, and all figures; the page, its plots and a CSV lie in `out`.

    Raises ConfigError where no scene is named, SurveyError where one has no truth.
    """
    drawn = list(_drawn(bench))
    if not drawn:
        raise ConfigError(
            "The suite coverage needs scenes, but got none. Name seeds of LiDAR flights (--seeds 1 3 5), of "
            "scenes to render (--image-seeds 1 3), or folders of rendered scenes (--scenes FOLDER...)."
        )
    found: dict[str, dict[str, tuple[Figure, ...]]] = {}
    with bar(console, "coverage") as progress:
        for k, one in enumerate(drawn):
            progress(k, len(drawn))
            folder = bench.out / "coverage" / one.source / one.name
            found.setdefault(one.source, {})[one.name] = _figures(one, folder)
        progress(len(drawn), len(drawn))
    rows = {
        source: {name: [asdict(figure) for figure in some] for name, some in of.items()}
        for source, of in found.items()
    }
    return write_coverage(bench.out, found), {"figures": rows}


def _drawn(bench: BenchConfig) -> Iterator[Drawn]:
    for seed in bench.seeds:
        yield Drawn(f"lidar-{seed}", "lidar", partial(_of_lidar, seed))
    for seed in bench.image_seeds:
        yield Drawn(f"random-{seed}", "images", partial(_of_random, seed))
    for scene in bench.scenes:
        yield Drawn(scene.resolve().name, "images", partial(_of_scene, scene))


def _figures(one: Drawn, folder: Path) -> tuple[Figure, ...]:
    """Those in the folder, else of a survey that is made."""
    if not (folder / FIGURES).exists():
        survey, truth = one.survey(folder)
        rows = [asdict(figure) for figure in figures_of(survey, truth)]
        write_text(folder / FIGURES, json.dumps(rows, indent=1, allow_nan=False) + "\n")
    kept: Sequence[dict[str, Any]] = read_json(folder / FIGURES, ConfigError, f"Remove the folder {folder}.")
    return tuple(Figure(**row) for row in kept)


def _of_lidar(seed: int, folder: Path) -> tuple[Survey, Path]:
    if not (folder / "truth.json").exists():  # written last
        simulate_lidar(folder, random_lidar_scene(seed))
    return survey_cloud(read_cloud(folder / CLOUD)), folder / "truth.json"


def _of_random(seed: int, folder: Path) -> tuple[Survey, Path]:
    scene = folder / "scene"
    if not scene.exists():
        synthesize(scene, SceneOptions(seed=seed, samples=SAMPLES).apply(find_scene(RANDOM, seed)))
    return _of_scene(scene, folder)


def _of_scene(scene: Path, folder: Path) -> tuple[Survey, Path]:
    """The survey stays beside the figures, since it takes minutes."""
    if (folder / SURVEY_FILE).exists():
        return read_survey(folder / SURVEY_FILE), scene / "truth.json"
    survey = survey_scene(load_scene(scene, store=folder / "store"))
    write_survey_json(folder / SURVEY_FILE, survey)
    return survey, scene / "truth.json"
