"""Photos or a video in, a scene folder out: chosen images, their poses, and where on the earth they are.

OUT/images/           the images, upright
OUT/photos.json       what the images are copies of
OUT/masks/            their masks, where there are any
OUT/sfm/              structure from motion's own files, from which it goes on
OUT/sparse/0/         the COLMAP model, in metres where the scene is georeferenced
OUT/transforms.json   the scene
OUT/capture.json      what was used, left out, and how well it fits
"""

import json
import os
import shutil
from collections import Counter
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from plnerf.capture.control import GCP_LIST, SIGMA_M, ControlPoints, nearest_point, read_gcp_list, split
from plnerf.capture.exif import PhotoFacts, read_facts
from plnerf.capture.frames import LEAST, MOST, Taken, choose_frames
from plnerf.capture.georef import Anchor, ControlError, Georeference, georeference
from plnerf.capture.gravity import Gravity, gravity_from_gimbal, gravity_from_level_cameras
from plnerf.capture.heights import check_height_datum
from plnerf.capture.local_frame import local_frame
from plnerf.capture.mapping import LEAST_IMAGES, Tell
from plnerf.capture.masks import bring_masks
from plnerf.capture.pairs import choose_pairs
from plnerf.capture.photos import bring_upright, find_photos
from plnerf.capture.references import GEO_TXT, References, from_photos, read_geo_txt
from plnerf.capture.sfm import SfmConfig, SfmResult, reconstruct
from plnerf.capture.similarity import Similarity, upright_rotation
from plnerf.capture.video import stated_count, video_pictures, write_pictures
from plnerf.errors import CaptureError, ConfigError
from plnerf.scene.colmap import pycolmap
from plnerf.scene.files import write_text
from plnerf.scene.formats_colmap import read_colmap
from plnerf.scene.json_fields import is_file
from plnerf.scene.strict_json import read_json
from plnerf.scene.typed_json import from_json
from plnerf.scene.write_transforms import write_transforms

FORMAT_VERSION, FRAMES, REPORT = 1, "frames.json", "capture.json"
VIDEOS = frozenset({".mp4", ".mov", ".avi", ".mkv", ".m4v", ".webm", ".mts", ".wmv"})


@dataclass(frozen=True)
class CaptureConfig:
    """How a scene is made of images."""

    sfm: SfmConfig = field(default_factory=SfmConfig)
    most: float = MOST
    """Of a video: overlap with the last picture kept above which the next is a near-duplicate."""
    least: float = LEAST
    """Of a video: overlap that is kept."""
    masks: Path | None = None
    """A folder of masks of the images, or one for all of them."""
    height_datum: str | None = None
    """Vertical reference of heights whose file states none: `ellipsoid`, or a CRS such as EPSG:7837."""
    check_every: int = 0
    """Every n-th control point without a stated role becomes a check point; 0: none."""

    def __post_init__(self) -> None:
        check_height_datum(self.height_datum)
        if self.check_every < 0 or self.check_every == 1:
            raise ConfigError(
                f"Every 2nd, 3rd, ... control point can be a check point, or none (0), but got check_every = "
                f"{self.check_every}."
            )
        if not 0 < self.least < self.most < 1:
            raise ConfigError(
                f"The overlap of a video's pictures must lie above 0 and below {self.most:g}, but is "
                f"{self.least:g}."
            )


@dataclass(frozen=True)
class _Inputs:
    """Everything that determines which frames of a video are selected."""

    video: str
    size: int
    mtime_ns: int
    most: float
    least: float


@dataclass(frozen=True)
class _Chosen:
    """The content of frames.json."""

    inputs: _Inputs
    frames: tuple[Taken, ...]


def capture(
    source: Path, out: Path, config: CaptureConfig, tell: Tell = lambda stage, done, of: None
) -> Path:
    """Makes a scene folder of photos or a video; returns the path of its transforms.json.

    Raises CaptureError where too little can be read or put together; what is there by then is kept, and a
    further call goes on from it.
    """
    images = out / "images"
    taken: list[Taken] = []
    if source.suffix.lower() in VIDEOS or source.is_file():
        taken, facts, problems = _from_video(source, images, config, tell)
    else:
        photos = find_photos(source, lambda done, of: tell("photos", done, of))
        photos = bring_upright(photos, images, lambda done, of: tell("copies", done, of))
        facts, problems = photos.facts, photos.problems
    masks = bring_masks(config.masks, facts, out / "masks") if config.masks is not None else {}
    references = _references(source, facts, config.height_datum)
    pairs = choose_pairs(len(facts), config.sfm.pairs, _positions(facts, references))
    found = reconstruct(images, facts, out / "sfm", pairs, config.sfm, masks=masks, tell=tell)
    gravity = _gravity(found, facts)
    control = _control(source, list(facts), config)
    placed, why_not = _placed(found, references, gravity, control)
    # Without a place on the earth it is upright at least: later stages take z for up.
    upright = Similarity(1.0, upright_rotation(gravity.up), np.zeros(3))
    to = upright if placed is None else placed.fit.similarity
    model = _write_model(found, to, out / "sparse" / "0")
    listing = replace(read_colmap(out), format="plnerf")
    shots = (replace(shot, mask=masks.get(shot.path.name)) for shot in listing.shots)
    listing = replace(listing, shots=tuple(shots))
    listing = replace(listing, up=np.array([0.0, 0.0, 1.0]))
    if placed is not None:
        crs, origin = placed.frame.crs, np.array(placed.frame.origin)
        listing = replace(listing, unit="m", crs=crs, origin=origin)
    write_transforms(listing, out / "transforms.json", {"order": list(found.registered)})
    report = {
        "format_version": FORMAT_VERSION,
        "source": str(source),
        "model": str(model.relative_to(out)),
        "images": len(facts),
        "registered": len(found.registered),
        "failed": found.failed,
        "findings": [asdict(finding) for finding in found.findings],
        "left_out": [*problems, *references.problems, *(control.problems if control else ())],
        "frames": [asdict(one) for one in taken],
        "reprojection_px": found.reprojection_px,
        "points": found.points,
        "view_distance": _view_distance(found),
        "seconds": found.seconds,
        "up_from": gravity.source,
        "georeference": None if placed is None else placed.summary(),
        "not_georeferenced_because": why_not,
    }
    write_text(out / REPORT, json.dumps(report, indent=1, allow_nan=False) + "\n")
    return out / "transforms.json"


def _from_video(
    source: Path, images: Path, config: CaptureConfig, tell: Tell
) -> tuple[list[Taken], dict[str, PhotoFacts], tuple[str, ...]]:
    """The chosen pictures of a video as files; those that are there of the same video are taken again."""
    if not source.is_file():
        raise CaptureError(f"There is no video {source}. Give a video file, or a folder of photos.")
    chosen, stat = images.parent / FRAMES, source.stat()
    inputs = _Inputs(str(source.resolve()), stat.st_size, stat.st_mtime_ns, config.most, config.least)
    taken = _chosen_before(chosen, inputs, images)
    if taken is None:
        taken = choose_frames(
            video_pictures(source), most=config.most, least=config.least,
            tell=lambda done: tell("video", done, 0),
        )  # fmt: skip
        _check_enough(source, taken)
        write_pictures(source, [one.name for one in taken if one.kept], images)
        content = asdict(_Chosen(inputs, tuple(taken)))
        write_text(chosen, json.dumps(content, indent=1, allow_nan=False) + "\n")
    files = [images / f"{one.name}.jpg" for one in taken if one.kept]
    problems = [f"{one.name}: shares too little with the picture before" for one in taken if one.gap]
    if (stated := stated_count(source)) > len(taken):
        problems.append(
            f"{source.name}: says {stated} pictures, but {len(taken)} can be decoded: is it cut off?"
        )
    return taken, {path.name: read_facts(path) for path in files}, tuple(problems)


def _check_enough(source: Path, taken: list[Taken]) -> None:
    if (kept := sum(one.kept for one in taken)) < LEAST_IMAGES:
        reasons = Counter(one.reason for one in taken if not one.kept)
        dropped = ", ".join(f"{count} {reason}" for reason, count in reasons.most_common())
        raise CaptureError(
            f"Of the {len(taken)} pictures of {source} only {kept} show something new "
            f"({dropped or 'no more'}), but poses need {LEAST_IMAGES}. Film while moving along the line."
        )


def _chosen_before(path: Path, inputs: _Inputs, images: Path) -> list[Taken] | None:
    """What was chosen of the same video with the same settings, if all of it is still there."""
    if not path.exists():
        return None
    try:
        before = from_json(_Chosen, read_json(path, CaptureError), str(path), CaptureError)
    except CaptureError:
        return None  # damaged: they are chosen again
    whole = all(is_file(images / f"{one.name}.jpg") for one in before.frames if one.kept)
    return list(before.frames) if before.inputs == inputs and whole else None


def _references(source: Path, facts: dict[str, PhotoFacts], height_datum: str | None) -> References:
    table = (source if source.is_dir() else source.parent) / GEO_TXT
    if table.is_file():
        return read_geo_txt(table, list(facts), height_datum)
    return from_photos(facts, height_datum)


def _positions(facts: dict[str, PhotoFacts], references: References) -> Float[np.ndarray, "n 3"] | None:
    """Stated positions in metres, in the order of the images; NaN where there is none."""
    if not references.by_name:
        return None
    stated = np.array([reference.xyz for reference in references.by_name.values()])
    local = dict(zip(references.by_name, local_frame(references.crs, stated).to_local(stated), strict=True))
    return np.array([local.get(name, np.full(3, np.nan)) for name in facts])


def _poses(found: SfmResult) -> tuple[Float[np.ndarray, "n 3 3"], Float[np.ndarray, "n 3"]]:
    """Camera to reconstruction, and centres, of the registered images."""
    images = [found.reconstruction.find_image_with_name(name) for name in found.registered]
    R = np.stack([image.cam_from_world().rotation.matrix().T for image in images])
    return R, np.stack([image.projection_center() for image in images])


def _gravity(found: SfmResult, facts: dict[str, PhotoFacts]) -> Gravity:
    R, centres = _poses(found)
    gimbals = [facts[name].gimbal_deg for name in found.registered]
    said = np.array([gimbal is not None for gimbal in gimbals])
    angles = np.array([gimbal[1:] for gimbal in gimbals if gimbal is not None]).reshape(-1, 2)
    return gravity_from_gimbal(R[said], angles) or gravity_from_level_cameras(R, centres)


def _control(source: Path, names: list[str], config: CaptureConfig) -> ControlPoints | None:
    table = (source if source.is_dir() else source.parent) / GCP_LIST
    if not table.is_file():
        return None
    return split(read_gcp_list(table, names, config.height_datum), config.check_every)


def _anchors(found: SfmResult, control: ControlPoints) -> list[Anchor]:
    """Control points in the reconstruction: those that two or more of its images show."""
    R, centres = _poses(found)
    place = {name: i for i, name in enumerate(found.registered)}
    anchors = []
    for point in control.points:
        seen = [name for name in point.seen_px if name in place]
        if len(seen) < 2:
            continue
        at = [place[name] for name in seen]
        images = [found.reconstruction.find_image_with_name(name) for name in seen]
        flat = [
            image.camera.cam_from_img(np.array(point.seen_px[name]))
            for name, image in zip(seen, images, strict=True)
        ]
        rays = np.stack([R[i] @ np.append(xy, 1.0) for i, xy in zip(at, flat, strict=True)])
        x = nearest_point(centres[at], rays)
        anchors.append(Anchor(point.name, x, point.xyz, (SIGMA_M,) * 3, control.crs, point.role))
    return anchors


def _placed(
    found: SfmResult, references: References, gravity: Gravity, control: ControlPoints | None
) -> tuple[Georeference | None, str | None]:
    """Where the reconstruction lies on the earth, or why that is not known.

    Raises ControlError where control points contradict all else: lengths without them would be wrong, too.
    """
    anchors = _anchors(found, control) if control is not None else []
    if not references.by_name and not anchors:
        return None, "no image says where it was taken"
    centres = dict(zip(found.registered, _poses(found)[1], strict=True))
    try:
        return georeference(centres, references, gravity, anchors), None
    except ControlError:
        raise
    except CaptureError as error:
        return None, str(error)


def _view_distance(found: SfmResult) -> float:
    """Median over the images of the median distance to what they see, in the model's unit as it is now."""
    model, medians = found.reconstruction, []
    for name in found.registered:
        image = model.find_image_with_name(name)
        seen = [model.point3D(point.point3D_id).xyz for point in image.get_observation_points2D()]
        medians.append(np.median(np.linalg.norm(np.array(seen) - image.projection_center(), axis=1)))
    return float(np.median(medians))


def _write_model(found: SfmResult, to: Similarity, folder: Path) -> Path:
    """The COLMAP model, in the world frame; each of its files whole."""
    model = found.reconstruction
    model.transform(pycolmap.Sim3d(to.scale, pycolmap.Rotation3d(to.R), to.shift))
    part = folder.with_name("0.part")
    shutil.rmtree(part, ignore_errors=True)
    part.mkdir(parents=True)
    model.write_binary(part)
    folder.mkdir(exist_ok=True)
    for file in part.iterdir():
        os.replace(file, folder / file.name)
    part.rmdir()
    return folder
