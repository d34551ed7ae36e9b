"""The command about whole corridors."""

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import tyro
from rich.console import Console

from plnerf.cli.options import Out, PresetName
from plnerf.errors import ConfigError
from plnerf.survey.config import SurveyConfig
from plnerf.terminal import Terminal


def corridor(  # noqa: PLR0913 (an argument is an option of the command)
    source: tyro.conf.Positional[Path],
    *,
    out: Out,
    block_m: float | None = None,
    overlap_m: float | None = None,
    seconds: float = 0.0,
    preset: PresetName = "pl-nerf-wire",
    downscale: int = 1,
    seed: int = 0,
    address: str | None = None,
    cores: int = 1,
    gpus: float = 0.0,
    voltage_kv: float | None = None,
    line_azimuth: float | None = None,
    names: Path | None = None,
    settings: Annotated[SurveyConfig, tyro.conf.arg(name="")] = SurveyConfig(),
) -> None:
    """Survey a scene or tiles of any size, block after block or on a cluster; it resumes.

    Report: OUT/index.html, with links to those of all spans. Status 1 where a block failed.

    Args:
        source: Scene with poses, in metres (transforms.json, COLMAP), or a LAS or LAZ file, or a folder of
            these.
        out: Folder for everything that is made.
        block_m: Length in metres of the blocks in which wires are looked for (150 of images, of which later
            each span is a block; 1000 of clouds, when left out).
        overlap_m: How far in metres a block reaches beyond its ends (50 of images; 500 of clouds, which must
            be more than the longest span, when left out).
        seconds: Budget in seconds of training of each span's field; 0: none is trained, and spans are
            surveyed from images and poses alone.
        preset: Named settings to train with.
        downscale: Integer factor by which images are made smaller for training.
        seed: Decides every random draw.
        address: Ray cluster that does the blocks: host:port, or auto for the one that runs on this machine,
            or local to start one here (pip install "plnerf[cluster]"); this process does them one by one
            when left out.
        cores: Cores of each block on a cluster.
        gpus: GPUs of each block on a cluster; a part of one, such as 0.5, lets blocks share it.
        voltage_kv: Nominal voltage in kV, for the clearances that a table requires.
        line_azimuth: Direction of the line in degrees clockwise from north; found in the images when left
            out.
        names: Names of structures, phases and circuits by place: a CSV, or a KML or GeoPackage with
            pip install "plnerf[gis]".
        settings: Settings of the surveys.
    """
    from plnerf.corridor.cloud_blocks import is_cloud
    from plnerf.corridor.config import CorridorConfig, FieldOfBlock

    clearance = settings.clearance
    if voltage_kv is not None:
        clearance = replace(clearance, voltage_kv=voltage_kv)
    named = replace(settings.names, places=names or settings.names.places)
    survey = replace(
        settings, clearance=clearance, names=named, detect=settings.detect.along(line_azimuth)
    )
    cloud = is_cloud(source)
    if cloud and seconds > 0:
        raise ConfigError(f"{source} holds no photos to train a field of. Leave --seconds out.")
    default = CorridorConfig.of_clouds() if cloud else CorridorConfig()
    given = {"block_m": block_m, "overlap_m": overlap_m}
    cut = replace(default.cut, **{name: value for name, value in given.items() if value is not None})
    config = CorridorConfig(cut, FieldOfBlock(seconds, preset, downscale, seed), survey)
    status = corridor_shown(Terminal(), source, out, config, address, cores, gpus)
    if status:
        sys.exit(status)


def corridor_shown(
    console: Console, source: Path, out: Path, config: Any, address: str | None, cores: int, gpus: float
) -> int:
    """`survey_corridor` with a table of all blocks and a summary; returns the exit status."""
    from plnerf.console import say
    from plnerf.corridor.corridor import survey_corridor
    from plnerf.corridor.engine import InThisProcess, OnRay
    from plnerf.corridor.results import INDEX

    engine = InThisProcess() if address is None else OnRay(address, cores, gpus)
    try:
        with stages(console) as heard:
            found = survey_corridor(source, out, config, engine, heard)
    finally:
        engine.close()
    for name, why in found.failed:
        say(console, f"{name} could not be done: {why or 'it did not end'}")
    for text in found.about:
        say(console, text)
    survey = found.survey
    if not survey.wires:
        say(console, "No wire was found.")
    say(
        console,
        f"{len(survey.wires)} wires in {len(survey.spans)} spans, {len(survey.structures)} structures: {out}",
    )
    say(console, f"report: {out / INDEX}")
    return 1 if found.failed else 0 if survey.wires else 3


@contextmanager
def stages(console: Console) -> Iterator[Callable[[str, Sequence[Any], Any], None]]:
    """Shows how far the tasks of a corridor are: a table of blocks on a terminal, else a line for each."""
    from rich.live import Live

    from plnerf.corridor.progress import Progress

    progress = Progress()
    if console.is_terminal:
        with Live(console=console, refresh_per_second=2) as live:

            def shown(stage: str, tasks: Sequence[Any], ledger: Any) -> None:
                progress.heard(stage, tasks, ledger)
                live.update(progress.table(console.height))

            yield shown
        return

    def lines(stage: str, tasks: Sequence[Any], ledger: Any) -> None:
        from plnerf.console import say

        for line in progress.heard(stage, tasks, ledger):
            say(console, line)

    yield lines
