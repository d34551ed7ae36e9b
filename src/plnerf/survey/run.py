"""Surveys: of a trained run, of a scene without training, of a point cloud.  Values in, a `Survey` out.

    images    wires -> surfaces (field, stereo) -> structures -> refit -> evidence -> ground, classes
    cloud     ground -> lines -> structures -> wires -> classes
    both      -> clearances

Nothing is printed and no file is written here: `plnerf.write_survey` does that.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from importlib.metadata import version

import numpy as np

from plnerf.detect.detect import detect_wires
from plnerf.findings import Finding, harms, note
from plnerf.line.frame import LineFrame
from plnerf.line.survey import Survey, WirePoints
from plnerf.line.wire import Wire
from plnerf.scene.scene import Scene
from plnerf.survey.attach import hung_between, line_of
from plnerf.survey.classify import classified, ground_of, standing_on
from plnerf.survey.clearance import measure_clearances
from plnerf.survey.config import SurveyConfig
from plnerf.survey.field_surface import field_surface
from plnerf.survey.kinds import kinds
from plnerf.survey.lidar.find import find_lines
from plnerf.survey.lidar.point_cloud import PointCloud
from plnerf.survey.marked_photos import pictures_of
from plnerf.survey.posed_photos import Photos, photos_of
from plnerf.survey.refine.refine import refine_wires
from plnerf.survey.stereo.stereo_surface import inflate_sigma, stereo_surface
from plnerf.survey.supports import find_supports, trimmed
from plnerf.survey.surface import Surface
from plnerf.survey.wire_evidence import by_images, by_points, points_on
from plnerf.survey.wire_points import wire_points
from plnerf.train.run import TrainedRun
from plnerf.train.settings import to_json

Progress = Callable[[int, int], None]


def survey_run(
    run: TrainedRun, config: SurveyConfig | None = None, progress: Progress | None = None
) -> Survey:
    """A survey of a trained run: its field shows points on wires, and supports hidden from stereo."""
    config = config or SurveyConfig()
    parts = _parts(progress, 4)
    photos = photos_of(run.scene)
    found = detect_wires(run.scene, config.detect) if run.wires is None else run.wires
    points = wire_points(run, photos.frame, found, config.points, parts[0])
    field = field_surface(run, photos.frame, config.surface, parts[1])
    made = {"input": _images_in(run.scene), "preset": f"{run.config.preset}, step {run.step:,}"}
    return _of_images(photos, found, (field, points), config, parts[2:], str(run.folder), made)


def survey_scene(
    scene: Scene, config: SurveyConfig | None = None, progress: Progress | None = None
) -> Survey:
    """A survey from images and poses alone: no training is needed."""
    config = config or SurveyConfig()
    parts = _parts(progress, 3)
    found = detect_wires(scene, config.detect, parts[0])
    made = {"input": _images_in(scene), "preset": "none: from images and poses alone"}
    return _of_images(photos_of(scene), found, None, config, parts[1:], str(scene.root), made)


def survey_cloud(
    cloud: PointCloud, config: SurveyConfig | None = None, progress: Progress | None = None
) -> Survey:
    """A survey of a point cloud in metres with z up; classes that it has are not used."""
    config = config or SurveyConfig()
    frame = LineFrame.of_cloud(cloud.xyz, cloud.crs)
    found = find_lines(frame.from_world(cloud.xyz), config.lidar, progress)
    made = {"input": f"{cloud.path.name}, {len(cloud.xyz):,} points; its classes were not used"}
    survey = Survey(
        frame, found.lines, found.cloud, str(cloud.path), made,
        findings=(*cloud.findings, *found.findings),
    )  # fmt: skip
    return _finished(survey, config)


def _of_images(
    photos: Photos,
    found: Sequence[Wire],
    rendered: tuple[Surface, WirePoints] | None,
    config: SurveyConfig,
    parts: Sequence[Progress],
    source: str,
    made: Mapping[str, str],
) -> Survey:
    """What runs and scenes have in common.  rendered: what the field of a run shows."""
    field, points = rendered or (None, None)
    wires = [wire for wire in found if wire.evidence.certain]
    surface, findings = stereo_surface(photos, wires, field, config.stereo, parts[0])
    supports = find_supports(surface, field, wires, config.supports)
    extents = [trimmed(wire, supports) for wire in wires]
    refined = refine_wires(photos, extents, config.refine, parts[1])
    hung = [hung_between(*pair, supports) for pair in zip(refined.wires, extents, strict=True)]
    if points is None:
        hung = [by_images(wire) for wire in hung]
    else:
        hung = [by_points(wire, points.xyz, config.evidence) for wire in hung]
    before = [hung_between(*pair, supports) for pair in zip(wires, extents, strict=True)]
    hung, before = _named(hung, before, points, config)
    if refined.pose_residual_px > config.refine.loose_poses_px:
        surface = inflate_sigma(surface, refined.pose_residual_px, config.stereo)
        findings = (*findings, _loose(refined.pose_residual_px))
    ground = ground_of(surface, hung, supports.points, config.classify)
    structures = [None if one is None else standing_on(ground, [one])[0] for one in supports.structures]
    cloud, more = classified(surface, ground, hung, supports.points, config.classify)
    survey = Survey(
        photos.frame, (line_of(hung, structures),) if hung else (), cloud, source, made,
        findings=(*_about(found, wires, len(supports.seen)), *findings, *more),
        detected=tuple(before), wire_points=points, pictures=pictures_of(photos, hung, config.pictures),
        from_images=True,
    )  # fmt: skip
    return _finished(survey, config)


def _finished(survey: Survey, config: SurveyConfig) -> Survey:
    """With clearances where lengths are metres, and with how it was made."""
    survey = replace(
        survey,
        temperature_c=config.temperature_c,
        settings=to_json(config),
        made={**survey.made, "program": f"plnerf {version('plnerf')}"},
    )
    if survey.frame.unit != "m" or not survey.wires:
        return survey
    clearances, findings = measure_clearances(survey, config.clearance)
    return replace(survey, clearances=clearances, findings=(*survey.findings, *findings))


def _named(
    wires: Sequence[Wire], before: Sequence[Wire], points: WirePoints | None, config: SurveyConfig
) -> tuple[list[Wire], list[Wire]]:
    """Numbered from 1, the highest first, each with its kind; and the same of the wires before the refit."""
    middles = [wire.points(np.array([wire.base.length_m / 2]))[0, 2] for wire in wires]
    order = np.argsort(middles)[::-1].tolist()
    counts = [_count(wires[k], points, config) for k in order]
    names = kinds([wires[k] for k in order], counts, config.kinds)
    numbered = [replace(wires[k], id=n + 1, kind=names[n]) for n, k in enumerate(order)]
    return numbered, [replace(before[k], id=n + 1, kind=names[n]) for n, k in enumerate(order)]


def _count(wire: Wire, points: WirePoints | None, config: SurveyConfig) -> int:
    """How well a wire is seen: points on it, or images that show it."""
    if points is None:
        return wire.evidence.count
    return int(points_on(wire, points.xyz, config.evidence.near_m).sum())


def _about(found: Sequence[Wire], wires: Sequence[Wire], structures: int) -> list[Finding]:
    """What a reader must know of the wires that were detected."""
    findings = []
    if not wires:
        findings.append(harms("wires", "The images show no wire whose place the views fix."))
    if len(found) > len(wires):
        left = len(found) - len(wires)
        findings.append(note("wires", f"The views do not fix the place of {left} more that may be wires."))
    if wires and structures < 2:
        findings.append(
            harms(
                "structures",
                f"{structures} of 2 structures are seen: where none is, wires end with what the images show, "
                "and no sag is stated.",
            )
        )
    return findings


def _loose(residual_px: float) -> Finding:
    return harms(
        "poses",
        f"The images lie about {residual_px:.1f} px off their poses, as the wires in them show.",
        "Better poses make better wires.",
    )


def _images_in(scene: Scene) -> str:
    return f"{scene.root.name}: {len(scene.names)} images"


def _parts(progress: Progress | None, count: int) -> list[Progress]:
    """A callback for each of some stages, which together report one progress."""

    def part(stage: int) -> Progress:
        def report(done: int, of: int) -> None:
            if progress is not None:
                progress(stage * of + done, count * of)

        return report

    return [part(stage) for stage in range(count)]
