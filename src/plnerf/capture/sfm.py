"""Structure from motion by COLMAP: features, matches, and a model of as many images as hang together.

Each stage is kept in the work folder and goes on where it was cut off: images with features and pairs with
matches are not done again, and the models of a finished try to map (`mapping`) are read.
"""

import hashlib
import shutil
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

from plnerf.capture.colmap_process import ColmapProcess
from plnerf.capture.exif import PhotoFacts
from plnerf.capture.mapping import (
    LEAST_IMAGES,
    MOST_ERROR_PX,
    Candidate,
    MapJob,
    Tell,
    Try,
    kept_models,
    map_once,
    map_until_plausible,
    read_models,
    tries,
    verification,
)
from plnerf.capture.pair_lists import listed_pairs, rename_images, stand_ins
from plnerf.capture.pairs import Pair, PairConfig
from plnerf.errors import CaptureError, ConfigError
from plnerf.findings import Finding
from plnerf.scene.colmap import pycolmap
from plnerf.scene.files import write_text

DATABASE, MODELS, INPUTS = "database.db", "models", "inputs.sha256"
LEAST_FEATURES, LEAST_MATCHES = 50, 15
LEAST_ERROR_PX, ERROR = 1.0, 0.0025
"""How far off a feature may be: a share ERROR of the image's longer side, within limits.  COLMAP's 4 px are
those of an image of 1600 px and more; in small images they let more false matches pass."""
BATCH, PAIRS = 8, 50
"""Images, and pairs, between two marks of progress: what is done by then is not done again."""
Model = Literal["SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV"]


@dataclass(frozen=True)
class SfmConfig:
    """Settings of structure from motion."""

    camera_model: Model = "OPENCV"
    intrinsics: Literal["shared", "per-image"] = "shared"
    """Whether images of one camera and size share their lens; drones' do."""
    fit_lens: bool = True
    """Whether the lens is fitted; else the focal length that the photos state is kept, without distortion."""
    max_image_px: int = 1600
    """Longer side of the images in which features are looked for."""
    features: int = 4096
    """Most features of an image."""
    block: int = 500
    """Up to so many images are put together one by one; more of them in overlapping blocks of so many."""
    pairs: PairConfig = field(default_factory=PairConfig)
    seed: int = 0
    threads: int = -1
    """-1: as many as there are cores."""

    def __post_init__(self) -> None:
        if self.block < 2 * LEAST_IMAGES:
            raise ConfigError(f"Blocks need {2 * LEAST_IMAGES} images or more, but block={self.block}.")
        if self.max_image_px < 64 or self.features < 64:
            raise ConfigError(
                "Structure from motion needs max_image_px and features of 64 or more, but got "
                f"max_image_px={self.max_image_px}, features={self.features}."
            )


@dataclass(frozen=True, eq=False)
class SfmResult:
    """The model with the most images among those of a plausible lens."""

    reconstruction: Any
    """pycolmap.Reconstruction."""
    registered: tuple[str, ...]
    failed: dict[str, str]
    """Images without a pose, each with the reason."""
    reprojection_px: float
    points: int
    seconds: dict[str, float]
    findings: tuple[Finding, ...]
    """That the images were mapped more than once, or that no model can be trusted."""


def reconstruct(
    images: Path,
    facts: Mapping[str, PhotoFacts],
    work: Path,
    pairs: Sequence[Pair],
    config: SfmConfig,
    *,
    masks: Mapping[str, Path] = MappingProxyType({}),
    tell: Tell = lambda stage, done, of: None,
) -> SfmResult:
    """Runs all stages on the images of a folder that `facts` names, in their order.

    pairs: of places in that order.  masks: by image, all in one folder as IMAGE.png, black where features
    are not looked for.  Raises CaptureError where fewer than three images hang together,
    or where a lens is to be kept that a photo does not state.
    """
    if len(facts) < LEAST_IMAGES:
        raise CaptureError(
            f"Structure from motion needs {LEAST_IMAGES} images or more, but got {len(facts)} in {images}. "
            "Take more, with two thirds of each seen in the next."
        )
    unstated = [name for name, fact in facts.items() if fact.focal_px is None]
    if unstated and not config.fit_lens:
        raise CaptureError(
            f"The lens is to be kept as photos state it, but {len(unstated)} of {len(facts)} state no focal "
            f"length ({unstated[0]}). Let it be fitted, or give photos with FocalLengthIn35mmFilm in EXIF."
        )
    work.mkdir(parents=True, exist_ok=True)
    _forget_if_changed(images, facts, pairs, config, masks, work)
    ways = tries(tolerance_px(facts.values()), config.seed)
    seconds: dict[str, float] = {}
    with ColmapProcess() as colmap:
        with _timed(seconds, "features"):
            colmap.call(_extract, images, dict(facts), work / DATABASE, config, dict(masks), tell=tell)
        with _timed(seconds, "matches"):
            colmap.call(_match, list(facts), list(pairs), work, config, ways[0], tell=tell)
        with _timed(seconds, "model"):
            models, findings = map_until_plausible(
                lambda k, way: _map(colmap, images, len(facts), work, config, k, way, tell), ways, facts
            )
    return _result(models, list(facts), work / DATABASE, seconds, findings)


def tolerance_px(facts: Iterable[PhotoFacts]) -> float:
    """How far off a feature may be, in the largest of the images."""
    side = max(max(fact.width_px, fact.height_px) for fact in facts)
    return min(max(LEAST_ERROR_PX, ERROR * side), MOST_ERROR_PX)


def _forget_if_changed(
    images: Path, facts: Mapping[str, PhotoFacts], pairs: Sequence[Pair], config: SfmConfig,
    masks: Mapping[str, Path], work: Path,
) -> None:  # fmt: skip
    """Removes what other images or settings left: a name with other pixels behind it has other features."""
    stats = [(images / name).stat() for name in facts]
    stamps = [(name, stat.st_size, stat.st_mtime_ns) for name, stat in zip(facts, stats, strict=True)]
    drawn = [(name, hashlib.sha256(path.read_bytes()).hexdigest()) for name, path in masks.items()]
    inputs = hashlib.sha256(repr((stamps, drawn, list(pairs), config)).encode()).hexdigest()
    path = work / INPUTS
    if not path.exists() or path.read_text() != inputs:
        (work / DATABASE).unlink(missing_ok=True)
        for folder in work.glob(f"{MODELS}*/"):
            shutil.rmtree(folder)
    write_text(path, inputs)


@contextmanager
def _timed(seconds: dict[str, float], stage: str) -> Iterator[None]:
    clock = time.perf_counter()
    yield
    seconds[stage] = time.perf_counter() - clock


def _extract(
    images: Path, facts: Mapping[str, PhotoFacts], database: Path, config: SfmConfig,
    masks: Mapping[str, Path], tell: Tell,
) -> None:  # fmt: skip
    """Features of the images that have none yet; images that share a lens share a camera."""
    pycolmap.set_random_seed(config.seed)
    pycolmap.logging.minloglevel = pycolmap.logging.ERROR.value  # it reports every image; `tell` does
    # A list of pairs may have been cut off.
    rename_images(database, {new: old for old, new in stand_ins(list(facts)).items()})
    with pycolmap.Database.open(database) as db:
        there = {image.name: image for image in db.read_all_images()}
        lens = {image.name: image.camera_id for image in there.values()}
        left = [name for name in facts if name not in there or not db.exists_keypoints(there[name].image_id)]
        shared: dict[str, int] = {facts[name].camera: lens[name] for name in lens if name in facts}
        camera: dict[str, int] = {}
        unused = [one for one in db.read_all_cameras() if one.camera_id not in lens.values()]
        for name in left:
            known = shared.get(facts[name].camera) if config.intrinsics == "shared" else None
            camera[name] = _number_of(_camera(facts[name], config), db, unused) if known is None else known
            shared[facts[name].camera] = camera[name]
    extraction = pycolmap.FeatureExtractionOptions(
        max_image_size=config.max_image_px, num_threads=config.threads, use_gpu=pycolmap.has_cuda
    )
    extraction.sift.max_num_features = config.features
    done = len(facts) - len(left)
    tell("features", done, len(facts))
    for number, batch in _batches(left, camera):
        reader = pycolmap.ImageReaderOptions(camera_model=config.camera_model, existing_camera_id=number)
        if masks:
            reader.mask_path = next(iter(masks.values())).parent
        pycolmap.extract_features(
            database, images, image_names=batch, reader_options=reader, extraction_options=extraction
        )
        done += len(batch)
        tell("features", done, len(facts))


def _number_of(camera: Any, db: Any, unused: list[Any]) -> int:
    """The camera's number in the database: of its like that an earlier run left unused, or a new one."""
    for other in unused:
        camera.camera_id = other.camera_id
        if camera == other:
            unused.remove(other)
            return int(other.camera_id)
    return int(db.write_camera(camera))


def _camera(facts: PhotoFacts, config: SfmConfig) -> Any:
    """A lens to begin with: as long as the photo says, else 1.2 times the longer side (some 45 degrees)."""
    w, h = facts.width_px, facts.height_px
    camera = pycolmap.Camera.create_from_model_name(
        camera_id=pycolmap.INVALID_CAMERA_ID, model_name=config.camera_model,
        focal_length=facts.focal_px or 1.2 * max(w, h), width=w, height=h,
    )  # fmt: skip
    camera.has_prior_focal_length = facts.focal_px is not None
    return camera


def _batches(names: Sequence[str], camera: Mapping[str, int]) -> Iterator[tuple[int, list[str]]]:
    """Some images of one camera at a time: small, so that progress is seen and kept."""
    by_camera: dict[int, list[str]] = {}
    for name in names:
        by_camera.setdefault(camera[name], []).append(name)
    for number, own in by_camera.items():
        for first in range(0, len(own), BATCH):
            yield number, own[first : first + BATCH]


def _match(
    names: Sequence[str], pairs: Sequence[Pair], work: Path, config: SfmConfig, way: Try, tell: Tell
) -> None:
    """Matches and verifies the pairs that were not yet."""
    with pycolmap.Database.open(work / DATABASE) as db:
        number = {image.name: image.image_id for image in db.read_all_images()}
        left = [
            (names[i], names[j])
            for i, j in pairs
            if names[i] in number and names[j] in number
            if not db.exists_matches(number[names[i]], number[names[j]])
        ]
    matching = pycolmap.FeatureMatchingOptions(num_threads=config.threads, use_gpu=pycolmap.has_cuda)
    tell("matches", len(pairs) - len(left), len(pairs))
    listing = work / "pairs.txt"
    for first in range(0, len(left), PAIRS):
        block = left[first : first + PAIRS]
        with listed_pairs(work / DATABASE, listing, names, block):
            pycolmap.match_image_pairs(
                work / DATABASE, matching_options=matching, verification_options=verification(way),
                pairing_options=pycolmap.ImportedPairingOptions(match_list_path=listing),
            )  # fmt: skip
        tell("matches", len(pairs) - len(left) + first + len(block), len(pairs))


def _map(
    colmap: ColmapProcess, images: Path, count: int, work: Path, config: SfmConfig, k: int, way: Try,
    tell: Tell,
) -> list[Any]:  # fmt: skip
    """Models of the k-th try, from the disk where they are there; the first has the matches' tolerance."""
    stage, folder = ("model", MODELS) if k == 0 else (f"model, try {k + 1}", f"{MODELS}-{k + 1}")
    models = kept_models(work / folder)
    if models is None:
        shutil.rmtree(work / folder, ignore_errors=True)
        database = work / DATABASE
        job = MapJob(
            stage, database, images, work / folder, way, config.threads, count, verify=k > 0,
            block=config.block, fit_lens=config.fit_lens,
        )  # fmt: skip
        colmap.call(map_once, job, tell=tell)
        models = read_models(work / folder)
    tell(stage, count, count)
    return models


def _result(
    models: Sequence[Candidate], names: Sequence[str], database: Path, seconds: dict[str, float],
    findings: Sequence[Finding],
) -> SfmResult:  # fmt: skip
    """The best model, which comes first, and why the other images are not in it."""
    registered = set(models[0].images) if models else set()
    elsewhere = {name: model for model in reversed(models[1:]) for name in model.images}
    failed = {}
    with pycolmap.Database.open(database) as db:
        images = {image.name: image.image_id for image in db.read_all_images()}
        partners = _partners(db)
        for name in names:
            if name in registered:
                continue
            if name not in images:
                failed[name] = "its pixels cannot be read"
                continue
            features = db.num_keypoints_for_image(images[name])
            failed[name] = _reason(features, partners.get(images[name], 0), elsewhere.get(name))
    if len(registered) < LEAST_IMAGES:
        reasons = [f"{count} {reason}" for reason, count in Counter(failed.values()).items()]
        raise CaptureError(
            f"Of {len(names)} images fewer than {LEAST_IMAGES} could be put together ({'; '.join(reasons)}). "
            "Take photos that share two thirds of what they show with the next, of something with texture."
        )
    best = models[0].model
    return SfmResult(
        best, tuple(name for name in names if name in registered), failed,
        best.compute_mean_reprojection_error(), best.num_points3D(), seconds, tuple(findings),
    )  # fmt: skip


def _partners(db: Any) -> dict[int, int]:
    """With how many images an image shares a verified motion."""
    counts: dict[int, int] = {}
    for pair, inliers in zip(*db.read_two_view_geometry_num_inliers(), strict=True):
        if inliers >= LEAST_MATCHES:
            for number in pycolmap.pair_id_to_image_pair(pair):
                counts[number] = counts.get(number, 0) + 1
    return counts


def _reason(features: int, partners: int, other: Candidate | None) -> str:
    if features < LEAST_FEATURES:
        return "hardly a feature: blurred, dark, or without texture"
    if other is not None and other.problem is not None:
        return "in a part of its own, whose lens is impossible"
    if other is not None:
        return "in a part of its own, which nothing joins to the largest"
    if partners == 0:
        return "matches no other image: too little overlap"
    return "matches others, but its pose did not become certain"
