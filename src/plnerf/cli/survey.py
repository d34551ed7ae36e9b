"""The commands about wires: whether a capture can show them, the survey, and its score against truth."""

import sys
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import tyro
from rich.console import Console

from plnerf.cli.options import OptionalOut, PresetName
from plnerf.errors import ConfigError
from plnerf.presets._find import find_preset
from plnerf.survey.config import SurveyConfig
from plnerf.terminal import Terminal


def survey(  # noqa: PLR0913 (an argument is an option of the command)
    source: tyro.conf.Positional[Path],
    *,
    out: OptionalOut = None,
    voltage_kv: float | None = None,
    thresholds: Path | None = None,
    clearance_m: float | None = None,
    line_azimuth: float | None = None,
    conductor: Path | None = None,
    states: Path | None = None,
    rules: Path | None = None,
    objects: tuple[Path, ...] = (),
    names: Path | None = None,
    settings: Annotated[SurveyConfig, tyro.conf.arg(name="")] = SurveyConfig(),
) -> None:
    """Wires as catenaries, sag, clearances, a classified cloud, a report; status 3 if there are no wires.

    Args:
        source: Run folder, scene (no training is needed), or a LAS or LAZ file, whose classes
            count with --use-classes only.
        out: Folder to write; survey in the folder of the run or scene, or beside the cloud, when left out.
        voltage_kv: Nominal voltage in kV, for the clearances that a table or --rules require.
        thresholds: Table of required clearances (TOML), or nerc-fac-003-4.toml; NERC FAC-003-5 when left
            out.
        clearance_m: A distance in metres to be kept from everything, in place of a table's.
        line_azimuth: Direction of the line in degrees clockwise from north (the world's +y), where wires are
            found in images; found in the images too when left out.
        conductor: Conductor of the phases, for sag at other temperatures, in wind and under ice: a TOML file,
            or 243-al1-39-st1a, acsr-drake, lgj-400-35; also needs --temperature-c, the conductors' at the
            survey, and pip install "plnerf[mechanics]".
        states: The states: a TOML file, or nesc-250b; 50, 75 and 100 degrees Celsius when left out.
        rules: Matrix of clearances by object, direction and state: a TOML file, or nesc-232, en-50341-uk,
            gb-50545, fac-003-5 (examples); also needs --voltage-kv.
        objects: Maps of roads, rail, water and buildings for it: GeoJSON or GeoPackage; needs
            pip install "plnerf[gis]".
        names: Names of structures, phases and circuits by place: a CSV, or a KML or GeoPackage with
            pip install "plnerf[gis]".
        settings: Settings of the survey.
    """
    by_rule = settings.rules
    by_rule = replace(
        by_rule, matrix=rules or by_rule.matrix, objects=objects or by_rule.objects,
        voltage_kv=voltage_kv or by_rule.voltage_kv,
    )  # fmt: skip
    if by_rule.matrix is not None and thresholds is None:
        voltage_kv = None  # the matrix is for it, in place of a table
    mechanics = settings.mechanics
    mechanics = replace(
        mechanics, conductor=conductor or mechanics.conductor, states=states or mechanics.states
    )
    named = replace(settings.names, places=names or settings.names.places)
    said = {"voltage_kv": voltage_kv, "thresholds": thresholds, "clearance_m": clearance_m}
    given = {name: value for name, value in said.items() if value is not None}
    clearance = replace(settings.clearance, **given)  # type: ignore[arg-type]  # each by its name
    config = replace(
        settings, clearance=clearance, mechanics=mechanics, rules=by_rule, names=named,
        detect=settings.detect.along(line_azimuth),
    )  # fmt: skip
    if not survey_shown(Terminal(), source, out, config):
        sys.exit(3)


def survey_shown(
    console: Console,
    source: Path,
    out: Path | None = None,
    config: SurveyConfig | None = None,
    **options: Any,
) -> bool:
    """`pipeline.survey` with a bar and a summary; returns whether wires were found."""
    from plnerf.console import bar, say
    from plnerf.pipeline import PAGE
    from plnerf.pipeline import survey as survey_source

    with bar(console, "survey") as progress:
        found, folder = survey_source(source, config, out, progress, **options)
    if not found.wires:
        say(console, "No wire was found.")
        for finding in found.findings:
            say(console, finding.text)
    say(console, f"{len(found.wires)} wires, {len(found.cloud.xyz):,} points: {folder}")
    say(console, f"report: {folder / PAGE}")
    return bool(found.wires)


def score(
    survey: tyro.conf.Positional[Path],
    *,
    truth: Path | None = None,
    out: OptionalOut = None,
    classes: tuple[int, ...] | None = None,
    by_cameras: Path | None = None,
) -> None:
    """Score a survey against the truth: wires found and whole, where they are, sag, clearances, certainty.

    Args:
        survey: Survey or run folder, or survey.json; or points or curves alone, in the world
            frame: PLY, LAS, GeoJSON, text, NumPy.
        truth: The truth.json of a scene, or its folder; that of the run's scene when left out.
        out: JSON to write; beside the survey's file when left out.
        classes: Classes of LAS to take; wires (13 and 14) if there are any, else all, when left out.
        by_cameras: Scene that the survey was made of, if it has poses of its own: the truth
            is turned and shifted onto its cameras, by the images' names.
    """
    score_shown(Terminal(), survey, truth=truth, out=out, classes=classes, by_cameras=by_cameras)


def score_shown(console: Console, survey: Path, **options: Any) -> None:
    """`score_files` with its tables."""
    from plnerf.console import say
    from plnerf.score.score import score_files

    score = score_files(survey, **options)
    console.print(score.text, highlight=False, markup=False, soft_wrap=True)
    say(console, score.places)


def doctor(
    scene: tyro.conf.Positional[Path | None] = None,
    *,
    machine: bool = False,
    out: OptionalOut = None,
    distance: float | None = None,
    line_azimuth: float | None = None,
    wire_diameter: float = 0.03,
    sigma_px: float = 0.5,
    preset: PresetName = "pl-nerf-wire",
) -> None:
    """Check photos, or a scene's poses, before training: can they show where wires are? Status 3 if not.

    Args:
        scene: Scene with poses (transforms.json, COLMAP), or a folder of photos.
        machine: Print what this machine brings instead: backend, cores, memory, compiled kernels and
            where they are kept.
        out: JSON to write.
        distance: Distance from the cameras to the wires in metres. When left out: for a scene, the median
            distance of what a capture's images show, else 10 m; for photos, their height above the take-off
            point (DJI).
        line_azimuth: Direction of the line in degrees clockwise from north (the world's +y); the direction in
            which the cameras flew when left out. Scenes only.
        wire_diameter: Diameter of a conductor in metres.
        sigma_px: Standard deviation of a wire's place in an image, in pixels. Scenes only.
        preset: Preset whose training time is estimated. Photos only.
    """
    from plnerf.console import bar, say
    from plnerf.doctor import photo_doctor, scene_doctor
    from plnerf.doctor.config import PhotoDoctorConfig, SceneDoctorConfig
    from plnerf.scene.formats import has_poses

    console = Terminal()
    if machine:
        _machine_shown(console, out)
        return
    if scene is None:
        raise ConfigError("The doctor needs a scene or a folder of photos, or --machine. Give one of them.")
    if has_poses(scene):
        views = SceneDoctorConfig(wire_diameter_m=wire_diameter, sigma_px=sigma_px)
        seen = scene_doctor.examine_scene(scene, distance=distance, azimuth_deg=line_azimuth, config=views)
        console.print(scene_doctor.table(seen), highlight=False, markup=False, soft_wrap=True)
        usable = seen.usable
        if out is not None:
            scene_doctor.write_diagnosis(out, seen)
    else:
        with bar(console, "photos") as progress:
            found = photo_doctor.examine_photos(
                scene, distance_m=distance, preset=preset, rays_per_s=find_preset(preset).rays_per_s,
                config=PhotoDoctorConfig(wire_diameter_m=wire_diameter), progress=progress,
            )  # fmt: skip
        console.print(photo_doctor.photo_text(found), highlight=False, markup=False, soft_wrap=True)
        usable = found.usable
        if out is not None:
            photo_doctor.write_photo_diagnosis(out, found)
    if out is not None:
        say(console, f"diagnosis: {out}")
    sys.exit(0 if usable else 3)


def _machine_shown(console: Console, out: Path | None) -> None:
    """Print `examine_machine`, and write it as JSON."""
    from plnerf.console import say
    from plnerf.doctor.machine import examine_machine, machine_text, write_machine

    found = examine_machine()
    say(console, machine_text(found))
    if out is not None:
        write_machine(out, found)
        say(console, f"machine: {out}")
