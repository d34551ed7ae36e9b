"""Models of the images out of their matches; where a model's lens is impossible, the images are mapped again.

Mapping begins with a guessed lens and grows from two images, and what it takes for true early decides the
rest: with other tolerances or draws the same matches can give another model.  So there are up to three tries,
each kept on disk.  The first whose largest model has a plausible lens (`lens_problem`) ends them, and of all
models of all tries the one with the most images among those of a plausible lens is taken.
"""

import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from plnerf.capture.exif import PhotoFacts
from plnerf.capture.hierarchical import map_in_blocks
from plnerf.capture.lens_fit import lens_problem
from plnerf.capture.pair_lists import listed_pairs
from plnerf.errors import SceneError
from plnerf.findings import Finding
from plnerf.scene.colmap import pycolmap
from plnerf.scene.colmap_files import check_model

LEAST_IMAGES = 3
MOST_ERROR_PX = 4.0
"""COLMAP's own tolerance, meant for photos of 1600 px and more."""
MOST_BENT = 0.1
"""Share of a model's images that may have an implausible lens: with one for each image, a few may fail."""
DO = (
    "Do not trust these poses. Try another --seed; else give photos whose EXIF states the focal length, fly "
    "passes that cross or look the same way, and let each image share two thirds with the next"
)
Tell = Callable[[str, int, int], object]
"""Hears the stage, how much of it is done, and how much there is."""


@dataclass(frozen=True)
class Try:
    """One way to map."""

    error_px: float
    """How far off a feature may be, from a pair's motion and in a model."""
    seed: int


@dataclass(frozen=True, eq=False)
class Candidate:
    """A model, and whether it can be trusted."""

    model: Any
    """pycolmap.Reconstruction."""
    images: tuple[str, ...]
    problem: str | None
    """What is wrong with its lens."""


def tries(error_px: float, seed: int) -> tuple[Try, ...]:
    """The tolerance that the images ask for, another one, and other draws."""
    other = MOST_ERROR_PX if error_px < MOST_ERROR_PX else error_px / 2
    return Try(error_px, seed), Try(other, seed), Try(error_px, seed + 1)


def map_until_plausible(
    run: Callable[[int, Try], Sequence[Any]], ways: Sequence[Try], facts: Mapping[str, PhotoFacts]
) -> tuple[list[Candidate], list[Finding]]:
    """All models of the try with the best one, which comes first, and what is to be said about them.

    run: maps, given the place of a try and the try; returns models.
    """
    rounds: list[list[Candidate]] = []
    for k, way in enumerate(ways):
        found = [judged(model, facts) for model in run(k, way)]
        rounds.append(sorted(found, key=lambda one: len(one.images), reverse=True))
        if not found or rounds[-1][0].problem is None:
            break
    best = [sorted(found, key=_rank, reverse=True) for found in rounds if found]
    taken = max(best, key=lambda found: _rank(found[0]), default=[])
    bent = [found[0] for found in rounds if found and found[0].problem is not None]
    return taken, _findings(taken, bent, len(rounds))


def judged(model: Any, facts: Mapping[str, PhotoFacts]) -> Candidate:
    """A model with the problem of its lenses, if more than a few of its images look through such a one."""
    images = [model.image(number) for number in model.reg_image_ids()]
    stated = {image.camera_id: facts[image.name].focal_px for image in images}
    problems = {number: lens_problem(model.camera(number), focal) for number, focal in stated.items()}
    bad = [problem for image in images if (problem := problems[image.camera_id]) is not None]
    problem = max(bad, key=bad.count) if len(bad) > MOST_BENT * len(images) else None
    return Candidate(model, tuple(image.name for image in images), problem)


@dataclass(frozen=True)
class MapJob:
    """One try to map, and where."""

    stage: str
    """Its name in reports."""
    database: Path
    images: Path
    folder: Path
    """Of the models; absent so far."""
    way: Try
    threads: int
    count: int
    """How many images there are."""
    verify: bool
    """Whether the pairs' motions are found anew as the try asks, in a copy of the database."""
    block: int
    """Up to so many are mapped one by one, more of them in blocks of so many (`hierarchical`)."""
    fit_lens: bool
    """Whether focal lengths and distortions are fitted; else they stay as the database has them."""


def map_once(job: MapJob, tell: Tell) -> None:
    """Maps once into a folder, which is whole where it is there."""
    part = job.folder.with_name(f"{job.folder.name}.part")
    copy = part / "verified.db"
    shutil.rmtree(part, ignore_errors=True)
    part.mkdir()
    if job.verify:
        shutil.copyfile(job.database, copy)
        _verify(copy, job.way)
    registered = [0]

    def one_more() -> None:
        registered[0] += 1
        tell(job.stage, min(registered[0], job.count), job.count)

    database, options = copy if job.verify else job.database, _options(job.way, job.threads, job.fit_lens)
    if job.count > job.block:
        tell(job.stage, 0, job.count)
        map_in_blocks(database, job.images, part, options, job.block, job.threads)
    else:
        pycolmap.incremental_mapping(
            database, job.images, part, options=options, next_image_callback=one_more
        )
    copy.unlink(missing_ok=True)
    part.replace(job.folder)


def read_models(folder: Path) -> list[Any]:
    """The models that were mapped into a folder."""
    return [pycolmap.Reconstruction(model) for model in sorted(folder.iterdir()) if model.is_dir()]


def kept_models(folder: Path) -> list[Any] | None:
    """Those of an earlier run; None where it was not finished, or a file of theirs is gone or damaged."""
    if not folder.is_dir():
        return None
    try:
        for model in folder.iterdir():
            check_model(model)
        return read_models(folder)
    except (SceneError, LookupError, ValueError, RuntimeError):  # the latter are COLMAP's
        return None


def verification(way: Try) -> Any:
    """How the motion of a pair of images is found from its matches."""
    options = pycolmap.TwoViewGeometryOptions()
    options.ransac.random_seed = way.seed
    options.ransac.max_error = way.error_px
    return options


def _verify(database: Path, way: Try) -> None:
    with pycolmap.Database.open(database) as db:
        name = {image.image_id: image.name for image in db.read_all_images()}
        pairs = [pycolmap.pair_id_to_image_pair(pair) for pair in db.read_two_view_geometry_num_inliers()[0]]
        db.clear_two_view_geometries()
    listing = database.with_suffix(".txt")
    named = [(name[a], name[b]) for a, b in pairs]
    with listed_pairs(database, listing, list(name.values()), named):
        pycolmap.verify_matches(database, listing, options=verification(way))
    listing.unlink()


def _options(way: Try, threads: int, fit_lens: bool) -> Any:
    options = pycolmap.IncrementalPipelineOptions(
        min_model_size=LEAST_IMAGES, num_threads=threads, random_seed=way.seed
    )
    mapper, triangulation = options.mapper, options.triangulation
    mapper.random_seed = triangulation.random_seed = way.seed
    mapper.init_max_error = mapper.filter_max_reproj_error = way.error_px
    mapper.abs_pose_max_error = 3 * way.error_px
    if not fit_lens:
        options.ba_refine_focal_length = options.ba_refine_extra_params = False
        mapper.abs_pose_refine_focal_length = mapper.abs_pose_refine_extra_params = False
    triangulation.merge_max_reproj_error = triangulation.complete_max_reproj_error = way.error_px
    return options


def _rank(one: Candidate) -> tuple[bool, int]:
    return one.problem is None, len(one.images)


def _findings(taken: Sequence[Candidate], bent: Sequence[Candidate], count: int) -> list[Finding]:
    """What is to be said: nothing, where the first try did."""
    if not bent:
        return []
    refused = "; ".join(f"{len(one.images)} images with {one.problem}" for one in bent)
    share = f"{len(bent)} of {count} tries"
    impossible = f"the lens of the largest model came out impossible in {share}, its poses bent"
    if taken[0].problem is not None:
        what = f"{impossible}, and no other model is better: {refused}"
        return [Finding("bent model", "stops", what, taken[0].images, DO)]
    taken_instead = f"taken is a model of {len(taken[0].images)} images, whose lens is plausible"
    return [Finding("mapped again", "note", f"{impossible}: {refused}; {taken_instead}", (), "")]
