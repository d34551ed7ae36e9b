"""Surveys: of a trained run, of a scene without training, of a point cloud.  Values in, a `Survey` out.

    images    poses -> wires -> spans, lines -> surfaces (field, stereo) -> structures -> refit -> structures
              again, from the refined curves -> evidence -> ground, classes
    cloud     ground -> lines -> structures -> wires -> classes
    both      -> clearances, other states, clearances by rule, encroachments

Nothing is printed and no file is written here: `plnerf.write_survey` does that.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from importlib.metadata import version

import numpy as np
from jaxtyping import Float

from plnerf.capture.adjusted_poses import with_adjusted_poses
from plnerf.capture.heights import check_height_datum, with_heights
from plnerf.detect.detect import FindWires, detect_wires
from plnerf.errors import ConfigError
from plnerf.findings import Finding, harms, note
from plnerf.line.frame import LineFrame
from plnerf.line.line import Line
from plnerf.line.survey import Survey, WirePoints
from plnerf.line.wire import Wire
from plnerf.mechanics.states import compute_states
from plnerf.scene.scene import Scene
from plnerf.survey.altitude import altitude_at
from plnerf.survey.attach import hung_between, lines_of, numbered, trimmed
from plnerf.survey.bundles_of_wires import with_bundles
from plnerf.survey.chains import find_chains, wires_of, with_wires
from plnerf.survey.classify import classified, ground_of, standing_on
from plnerf.survey.clearance import measure_clearances
from plnerf.survey.config import SurveyConfig
from plnerf.survey.coverage import about_coverage, coverage_of
from plnerf.survey.crops import crops_of
from plnerf.survey.crossarms import about_crossarms, without_crossarms
from plnerf.survey.crown_tops import with_crown_tops
from plnerf.survey.encroachments import find_encroachments
from plnerf.survey.field_surface import field_surface
from plnerf.survey.grounded import without_grounded
from plnerf.survey.insulator_strings import with_strings
from plnerf.survey.kinds import with_kinds
from plnerf.survey.known_kinds import with_stated
from plnerf.survey.lidar.find import Found, find_lines
from plnerf.survey.lidar.point_cloud import PointCloud
from plnerf.survey.like_strings import with_like_strings
from plnerf.survey.marked_photos import pictures_of
from plnerf.survey.names import with_names
from plnerf.survey.no_wires import why_none
from plnerf.survey.on_wires import may_be_on
from plnerf.survey.part import Part, numbered_part, own_points
from plnerf.survey.posed_photos import Photos, photos_of
from plnerf.survey.rules import judge_rules, maps_near
from plnerf.survey.same_wire import single_wires
from plnerf.survey.span_refits import refine_spans
from plnerf.survey.stereo.stereo_surface import inflate_sigma, stereo_surface
from plnerf.survey.stereo.witnesses import Sight, with_witnesses
from plnerf.survey.structure_kinds import with_structure_kinds
from plnerf.survey.supports import find_supports, scenery_of
from plnerf.survey.surface import Surface
from plnerf.survey.tension_strings import with_possible_strings, with_tension_strings
from plnerf.survey.thresholds import check_altitude
from plnerf.survey.unseen_air import with_air_seen
from plnerf.survey.unseen_ground import without_unseen_ground
from plnerf.survey.wire_evidence import with_evidence
from plnerf.survey.wire_points import wire_points
from plnerf.train.run import TrainedRun
from plnerf.train.settings import to_json

Progress = Callable[[int, int], None]
FLIGHT_M = 120.0
"""Greatest height above the ground at which drones commonly may fly."""
OF_SCENE, OF_RUN = (5, 30, 47, 9, 9), (20, 20, 42, 9, 9)
"""Hundredths of the work, roughly: poses, wires, stereo, fit and the rest; of a run, whose wires are known,
points on wires and the field's surface come first."""
REST = 4
"""Steps after the fit: classes, witnesses, clearances, crops."""
LOW_SHARE = 20
"""One of so many points of a cloud counts as below any line: noise may lie deeper."""


def survey_run(
    run: TrainedRun,
    config: SurveyConfig | None = None,
    progress: Progress | None = None,
    finder: FindWires | None = None,
    part: Part | None = None,
) -> Survey:
    """A survey of a trained run: its field shows points on wires, and supports hidden from stereo.

    finder: finds the wires in place of `detect_wires` where the run was trained without.  part: the part of
    a corridor that the survey is about; None: all that is seen.
    """
    config = config or SurveyConfig()
    parts = _parts(progress, OF_RUN)
    photos = _with_heights(photos_of(run.scene), config)
    _check_altitude(photos.frame, _low_point(photos), config)
    found = (finder or detect_wires)(run.scene, config.detect, None) if run.wires is None else run.wires
    points = wire_points(run, photos.frame, found, config.points, parts[0])
    field = field_surface(run, photos.frame, found, config.surface, parts[1])
    made = {"input": _images_in(run.scene), "preset": f"{run.config.preset}, step {run.step:,}"}
    return _of_images(photos, found, (field, points), config, parts[2:], str(run.folder), made, part)


def survey_scene(
    scene: Scene,
    config: SurveyConfig | None = None,
    progress: Progress | None = None,
    finder: FindWires | None = None,
    part: Part | None = None,
) -> Survey:
    """A survey from images and poses alone: no training is needed.

    finder: finds the wires in place of `detect_wires`.  part: the part of a corridor that the survey is
    about; None: all that is seen.
    """
    config = config or SurveyConfig()
    parts = _parts(progress, OF_SCENE)
    photos = _with_heights(photos_of(scene), config)
    _check_altitude(photos.frame, _low_point(photos), config)
    made = {"input": _images_in(scene), "preset": "none: from images and poses alone"}
    scene, adjusted = with_adjusted_poses(scene, config.poses, parts[0])
    if adjusted is not None:
        photos = _with_heights(photos_of(scene, adjusted.covariance), config)
        made["poses"] = adjusted.text(scene.frames.unit)
    found = (finder or detect_wires)(scene, config.detect, parts[1])
    return _of_images(photos, found, None, config, parts[2:], str(scene.root), made, part)


def survey_cloud(
    cloud: PointCloud, config: SurveyConfig | None = None, progress: Progress | None = None
) -> Survey:
    """A survey of a point cloud; classes that it has are used on request only."""
    config = config or SurveyConfig()
    return survey_found(cloud, find_in_cloud(cloud, config, progress), config)


def find_in_cloud(cloud: PointCloud, config: SurveyConfig, progress: Progress | None = None) -> Found:
    """The lines of a point cloud, and the class and wire of each point, in the cloud's LineFrame."""
    frame = _frame_of(cloud, config)
    points = frame.from_world(cloud.xyz)
    _check_altitude(frame, points[np.argsort(points[:, 2])[len(points) // LOW_SHARE]], config)
    own = cloud.attributes.label if config.use_classes and cloud.attributes is not None else None
    return find_lines(points, config.lidar, progress, own)


def survey_found(cloud: PointCloud, found: Found, config: SurveyConfig, part: Part | None = None) -> Survey:
    """A survey of a point cloud whose lines are found.  part: as in `survey_scene`."""
    used = "its classes were used" if config.use_classes and cloud.attributes else "its classes were not used"
    made = {"input": f"{cloud.path.name}, {len(cloud.xyz):,} points; {used}"}
    given = cloud.attributes
    if given is not None:
        given = replace(given, keep_classes=config.keep_classes)
    lines = with_possible_strings(found.lines, config.strings)
    frame, points = _frame_of(cloud, config), replace(found.cloud, attributes=given)
    if part is not None:
        lines, points, _ = numbered_part(part, frame, lines, points)
    survey = Survey(
        frame, lines, points, str(cloud.path), made, findings=(*cloud.findings, *found.findings)
    )
    survey = _finished(survey, config)
    return survey if part is None else own_points(survey, part)


def _frame_of(cloud: PointCloud, config: SurveyConfig) -> LineFrame:
    return _frame_with_heights(LineFrame.of_cloud(cloud.xyz, cloud.crs, cloud.origin), config)


def _of_images(
    photos: Photos,
    found: Sequence[Wire],
    rendered: tuple[Surface, WirePoints] | None,
    config: SurveyConfig,
    parts: Sequence[Progress],
    source: str,
    made: Mapping[str, str],
    part: Part | None,
) -> Survey:
    """What runs and scenes have in common.  rendered: what the field of a run shows."""
    field, points = rendered or (None, None)
    wires = [wire for wire in found if wire.evidence.certain]
    sights: list[Sight] = []
    surface, findings = stereo_surface(photos, wires, field, config.stereo, parts[0], sights.append)
    unsure = [wire for wire in found if not wire.evidence.certain]
    in_air = may_be_on(surface, unsure, config.classify.on_wires)
    if photos.frame.unit == "m":
        wires, grounded = without_grounded(wires, surface, in_air, config.classify)
        findings = (*findings, *grounded)
    progress, unshown, arms = parts[1], 0, 0
    while True:
        chains = find_chains(wires, config.spans)
        scenery = scenery_of(surface, field, chains, config.supports, photos)
        supports = find_supports(scenery, chains, config.supports, config.spans)
        kept = without_crossarms(wires, supports, config.crossarms)
        if len(kept) < len(wires) and photos.frame.unit == "m":
            wires, arms = kept, arms + len(wires) - len(kept)
            continue
        extents = trimmed(chains, supports)
        refined, residual_px, shown = refine_spans(photos, extents, config.refine, progress)
        # What photos at their full size do not show as a wire of its own would be its span's neighbour.
        same_m = config.refine.same_diameters * config.refine.diameter_m if photos.frame.unit == "m" else 0.0
        wires = single_wires(chains, refined, shown, same_m)
        if len(wires) == len(shown):
            break
        progress, unshown = _silent, unshown + len(shown) - len(wires)
    findings = (*findings, *about_crossarms(arms), *_unshown(unshown))
    parts[2](0, REST)
    supports = find_supports(scenery, refined, config.supports, config.spans)
    supports = with_structure_kinds(supports, photos, config.structure_kinds)
    hung = hung_between(refined, extents, supports)
    hung = with_wires(hung, with_evidence(wires_of(hung), points, config.evidence))
    hung, before = numbered(hung, hung_between(chains, extents, supports))
    if residual_px > config.refine.loose_poses_px:
        surface, sights = inflate_sigma(surface, sights, residual_px, config.stereo)
        findings = (*findings, _loose(residual_px))
    classify = config.classify if photos.frame.unit == "m" else replace(config.classify, clear_beside_m=0.0)
    ground = ground_of(surface, wires_of(hung), supports.points | in_air, classify)
    lines = lines_of(hung, supports, standing_on(ground, supports.seen))
    lines = with_kinds(lines, config.kinds)
    lines = with_like_strings(with_tension_strings(lines, photos, config.strings), config.strings)
    every = [wire for line in lines for wire in line.wires]
    as_detected = tuple(
        replace(one, kind=wire.kind) for one, wire in zip(wires_of(before), every, strict=True)
    )
    cloud, more = classified(surface, ground, every, supports.points, config.classify, config.lidar.things)
    parts[2](1, REST)
    cloud = with_witnesses(cloud, sights, config.stereo.witnesses)
    if photos.frame.unit == "m":
        cloud, tops = with_crown_tops(cloud, photos, sights, every, config)
        findings = (*findings, *tops)
    parts[2](2, REST)
    if part is not None:
        lines, cloud, as_detected = numbered_part(part, photos.frame, lines, cloud, as_detected)
        every = [wire for line in lines for wire in line.wires]
    if not every:
        findings = (why_none(unsure, photos, surface, config.refine.diameter_m), *findings)
    survey = Survey(
        photos.frame, lines, cloud, source, made, findings=(*_about(found, lines), *findings, *more),
        detected=as_detected, wire_points=points,
        pictures=pictures_of(photos, every, config.pictures), from_images=True,
    )  # fmt: skip
    survey = _finished(survey, config, sights)
    parts[2](3, REST)
    possible = survey.clearances.possible if survey.clearances is not None else ()
    near = survey.encroachments.records if survey.encroachments is not None else ()
    survey = survey if part is None else own_points(survey, part)
    survey = replace(
        survey,
        crops=crops_of(photos, [(one.place.on_obstacle, one.place.on_wire) for one in possible]),
        encroachment_crops=crops_of(
            photos, [(one.on_object, one.on_wire) for one in near[: config.encroachments.pictures]]
        ),
    )
    parts[2](REST, REST)
    return survey


def _with_heights(photos: Photos, config: SurveyConfig) -> Photos:
    return replace(photos, frame=_frame_with_heights(photos.frame, config))


def _frame_with_heights(frame: LineFrame, config: SurveyConfig) -> LineFrame:
    """With what heights are above, where the settings state it and the CRS does not."""
    if config.height_datum is None:
        return frame
    check_height_datum(config.height_datum)
    if frame.crs is None:
        raise ConfigError(
            f"Heights are said to be above {config.height_datum}, but the input states no coordinate "
            "reference system that they could belong to. Give it one, or leave out --height-datum."
        )
    return replace(frame, crs=with_heights(frame.crs, config.height_datum))


def _check_altitude(frame: LineFrame, low: Float[np.ndarray, "3"], config: SurveyConfig) -> None:
    """Raises SurveyError where a line above the point `low` is above the table of required clearances."""
    own = config.clearance
    if frame.unit == "m" and own.voltage_kv is not None:
        check_altitude(altitude_at(frame, low), own.voltage_kv, own.thresholds, own.clearance_m)


def _low_point(photos: Photos) -> Float[np.ndarray, "3"]:
    """A point that is not above the ground, by the heights at which drones fly."""
    centres: Float[np.ndarray, "n 3"] = photos.cameras.centre.numpy()
    return np.array([*np.median(centres[:, :2], axis=0), centres[:, 2].min() - FLIGHT_M])


def _finished(survey: Survey, config: SurveyConfig, sights: Sequence[Sight] = ()) -> Survey:
    """With clearances and with what was seen along the spans where lengths are metres, and with how it was
    made."""
    survey = replace(
        survey,
        temperature_c=config.temperature_c,
        settings=to_json(config),
        report_units=config.report_units,
        made={**survey.made, "program": f"plnerf {version('plnerf')}"},
    )
    survey = with_stated(survey, config.kinds)
    survey = replace(survey, lines=with_bundles(survey.lines, config.kinds))
    survey = with_strings(with_names(survey, config.names, config.kinds), config.kinds)
    if survey.frame.unit != "m" or not survey.wires:
        return survey
    coverage = coverage_of(survey, sights, config.coverage)
    ground = (config.clearance.ground, config.classify.ground)
    survey, doubted = without_unseen_ground(survey, coverage, *ground)
    unseen = about_coverage(coverage, several_lines=len(survey.lines) > 1)
    clearances, findings = measure_clearances(survey, config.clearance)
    clearances, limits = with_air_seen(clearances, survey, sights, config.coverage)
    states, about = compute_states(survey.lines, config.temperature_c, config.mechanics)
    survey = replace(survey, coverage=coverage, clearances=clearances, states=states)
    rules, by_rule = judge_rules(survey, config.clearance, config.rules)
    findings = (*survey.findings, *unseen, *doubted, *findings, *limits, *about, *by_rule)
    survey = replace(survey, rules=rules, findings=findings)
    maps, *_ = maps_near(survey, config.clearance.obstacles.reach_m, config.rules)
    found = find_encroachments(survey, maps, config.clearance, config.rules, config.encroachments)
    return replace(survey, encroachments=found)


def _about(found: Sequence[Wire], lines: Sequence[Line]) -> list[Finding]:
    """What a reader must know of the wires that were detected."""
    findings = []
    spans = [span for line in lines for span in line.spans]
    left = sum(not wire.evidence.certain for wire in found)
    if spans and left:
        findings.append(note("wires", f"The views do not fix the place of {left} more that may be wires."))
    unseen = sum(one is None for span in spans for one in span.structures)
    if unseen:
        findings.append(
            harms(
                "structures",
                f"At {unseen} of {2 * len(spans)} ends of spans no structure is seen: there wires end with "
                "what the images show, and no sag is stated.",
            )
        )
    return findings


def _silent(done: int, of: int) -> None:
    """No progress is shown."""


def _unshown(count: int) -> list[Finding]:
    if not count:
        return []
    return [
        note(
            "wires",
            f"Left out of the curves that were detected: {count}. In the photos at their full size such a "
            "curve stands out no more often than noise and nowhere in several photos, which is chance, or "
            "is a piece of a wire that another curve follows.",
        )
    ]


def _loose(residual_px: float) -> Finding:
    return harms(
        "poses",
        f"The images lie about {residual_px:.1f} px off their poses, as the wires in them show.",
        "Better poses make better wires.",
    )


def _images_in(scene: Scene) -> str:
    return f"{scene.root.name}: {len(scene.names)} images"


def _parts(progress: Progress | None, shares: Sequence[int]) -> list[Progress]:
    """A callback for each of some stages, which together report one progress, in hundredths."""

    def part(begin: int, share: int) -> Progress:
        def report(done: int, of: int) -> None:
            if progress is not None:
                progress(begin + share * done // of, sum(shares))

        return report

    return [part(sum(shares[:k]), share) for k, share in enumerate(shares)]
