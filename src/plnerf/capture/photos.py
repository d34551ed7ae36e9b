"""The photos of a folder, in the order they were taken; and upright, in a folder of their own."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from plnerf.capture.copies import Copies, check_pixels
from plnerf.capture.exif import PhotoFacts, read_facts
from plnerf.errors import CaptureError

PHOTOS = frozenset({".jpg", ".jpeg", ".png", ".tif", ".tiff", ".webp"})
UNREAD = {
    ".heic": "HEIC", ".heif": "HEIF", ".dng": "raw", ".nef": "raw", ".cr2": "raw", ".cr3": "raw",
    ".arw": "raw", ".raf": "raw", ".orf": "raw", ".rw2": "raw",
}  # fmt: skip
TURNED = frozenset({2, 3, 4, 5, 6, 7, 8})
"""EXIF orientations of pictures that are not stored upright."""


@dataclass(frozen=True)
class Photos:
    """What is in a folder, by name and in the order it was taken."""

    folder: Path
    facts: dict[str, PhotoFacts]
    problems: tuple[str, ...]
    """Photos that are left out, each with the reason."""


def find_photos(folder: Path, tell: Callable[[int, int], object] = lambda done, of: None) -> Photos:
    """Reads the headers of all photos of a folder, not of those below.

    In the order of their times where all have one, else of their names.  A photo that cannot be read is left
    out and named.  Raises CaptureError where there is none that can be read.
    """
    if not folder.is_dir():
        raise CaptureError(f"{folder} is no folder of photos. Give a folder of photos, or a video file.")
    files = sorted(path for path in folder.iterdir() if path.is_file())
    photos = [path for path in files if path.suffix.lower() in PHOTOS]
    others = [path for path in files if path.suffix.lower() in UNREAD]
    problems = [f"{path.name}: {UNREAD[path.suffix.lower()]} files are not read" for path in others]
    facts: dict[str, PhotoFacts] = {}
    for done, path in enumerate(photos, start=1):
        try:
            facts[path.name] = read_facts(path)
        except CaptureError as error:
            problems.append(f"{path.name}: {error}")
        tell(done, len(photos))
    if not facts:
        raw = f" {len(others)} are HEIC or raw ({others[0].name}): convert them to JPEG." if others else ""
        raise CaptureError(
            f"{folder} has {len(photos)} photos (JPEG, PNG, TIFF or WebP), none of which can be read.{raw} "
            "Give a folder with the photos themselves in it."
        )
    if all(fact.time is not None for fact in facts.values()):
        facts = dict(sorted(facts.items(), key=lambda item: (item[1].time, item[0])))
    return Photos(folder, facts, tuple(problems))


def bring_upright(
    photos: Photos, target: Path, tell: Callable[[int, int], object] = lambda done, of: None
) -> Photos:
    """Copies of the photos in another folder: as they are where they are upright, else turned as EXIF says.

    Returns them as they are there, without those whose pixels are damaged.  Copies that are up to date stay;
    photos that lie in the target already are left as they are.
    """
    target.mkdir(parents=True, exist_ok=True)
    lying = [name for name, fact in photos.facts.items() if fact.orientation in TURNED]
    in_place = target.samefile(photos.folder)
    if lying and in_place:
        raise CaptureError(
            f"{lying[0]} and {len(lying) - 1} more of the photos in {target} are not stored upright, and the "
            "photos of a scene must be. Give another folder for the scene: -o."
        )
    facts, problems, copies = {}, list(photos.problems), Copies(target)
    try:
        for done, (name, fact) in enumerate(photos.facts.items(), start=1):
            try:
                if in_place:
                    check_pixels(target / name)
                else:
                    copies.bring(photos.folder / name, turn=fact.orientation in TURNED)
                facts[name] = _upright(fact)
            except CaptureError as error:
                problems.append(f"{name}: {error}")
            tell(done, len(photos.facts))
    finally:
        if not in_place:
            copies.save()
    return Photos(target, facts, tuple(problems))


def _upright(fact: PhotoFacts) -> PhotoFacts:
    """What is true of a photo once it is turned."""
    sideways = fact.orientation in {5, 6, 7, 8}
    size = (fact.height_px, fact.width_px) if sideways else (fact.width_px, fact.height_px)
    camera = f"{fact.camera} turned" if sideways else fact.camera
    return replace(fact, width_px=size[0], height_px=size[1], orientation=1, camera=camera)
