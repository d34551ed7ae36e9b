"""What is wrong with photos, before hours are spent on them."""

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from PIL import Image

from plnerf.capture.motion import look_at
from plnerf.capture.photos import Photos, find_photos
from plnerf.capture.references import GEO_TXT, from_photos, read_geo_txt
from plnerf.doctor.config import PHOTOS, PhotoDoctorConfig
from plnerf.doctor.cost import about_cost
from plnerf.doctor.photo_rules import Thumbnail, about_files, about_pictures, about_positions, about_wires
from plnerf.errors import CaptureError
from plnerf.findings import Finding
from plnerf.scene.files import write_text

FORMAT_VERSION = 2
"""1 had neither the settings nor whole sentences."""
SHOWN = 5
"""Names of photos that the text lists."""


@dataclass(frozen=True)
class PhotoDiagnosis:
    """What is wrong with the photos of a folder."""

    photos: int
    """How many can be read."""
    distance_m: float | None
    """From the cameras to the wires, as given or as the photos state it; None: it is not known."""
    findings: tuple[Finding, ...]
    config: PhotoDoctorConfig

    @property
    def usable(self) -> bool:
        """Whether going on makes sense."""
        return not any(finding.degree == "stops" for finding in self.findings)


def examine_photos(
    folder: Path,
    *,
    distance_m: float | None,
    preset: str,
    rays_per_s: float | None,
    config: PhotoDoctorConfig = PHOTOS,
    progress: Callable[[int, int], object] | None = None,
) -> PhotoDiagnosis:
    """Judges all photos of a folder.

    distance_m: from the cameras to the wires; None: their height over the start, where they state it (DJI).
    preset, rays_per_s: what is to be trained, and how fast that is, where it was measured.  Raises
    CaptureError where the folder has no photo that can be read.
    """
    photos = find_photos(folder)
    thumbnails, broken = {}, list(photos.problems)
    for done, name in enumerate(photos.facts, start=1):
        try:
            thumbnails[name] = thumbnail_of(folder / name, config)
        except CaptureError as error:
            broken.append(f"{name}: {error}")
        if progress is not None:
            progress(done, len(photos.facts))
    facts = {name: fact for name, fact in photos.facts.items() if name in thumbnails}
    table = folder / GEO_TXT
    references = read_geo_txt(table, list(facts)) if table.is_file() else from_photos(facts)
    distance = distance_m if distance_m is not None else _height(photos)
    findings = [
        *about_files(facts, broken),
        *about_pictures(thumbnails, config),
        *about_positions(facts, references, config),
        *about_wires(facts, distance, config),
        *([about_cost(facts, preset, rays_per_s)] if facts else []),
    ]
    return PhotoDiagnosis(len(facts), distance, tuple(findings), config)


def thumbnail_of(path: Path, config: PhotoDoctorConfig = PHOTOS) -> Thumbnail:
    """Reads all of a photo, small.  Raises CaptureError where its pixels are damaged."""
    try:
        with Image.open(path) as image:
            image.draft(
                "RGB", (config.judged_px, config.judged_px)
            )  # JPEG: decodes at a half, a quarter, ...
            picture = np.asarray(image.convert("RGB"))
    except Exception as error:  # a decoder that meets damaged bytes can raise anything
        raise CaptureError(f"its pixels cannot be read ({error})") from error
    grey = cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)
    small = cv2.resize(grey, (16, 16), interpolation=cv2.INTER_AREA).astype(np.float64)
    bright, dark = float((grey >= config.bright).mean()), float((grey <= config.dark).mean())
    return Thumbnail(look_at(picture).sharpness, bright, dark, small)


def photos_json(diagnosis: PhotoDiagnosis) -> dict[str, Any]:
    """Plain values."""
    return {
        "format_version": FORMAT_VERSION,
        "photos": diagnosis.photos,
        "usable": diagnosis.usable,
        "distance_m": diagnosis.distance_m,
        "findings": [asdict(finding) for finding in diagnosis.findings],
        "settings": asdict(diagnosis.config),
    }


def write_photo_diagnosis(path: Path, diagnosis: PhotoDiagnosis) -> None:
    """Writes it as JSON."""
    write_text(path, json.dumps(photos_json(diagnosis), indent=1, allow_nan=False) + "\n")


def photo_text(diagnosis: PhotoDiagnosis) -> str:
    """The findings in lines, and what can be done next."""
    words = {"stops": "STOPS", "harms": "harms", "note": "note "}
    lines = [f"{diagnosis.photos} photos can be read."]
    for finding in diagnosis.findings:
        names = ", ".join(finding.where[:SHOWN])
        more = f" and {len(finding.where) - SHOWN} more" if len(finding.where) > SHOWN else ""
        where = f" ({names}{more})" if names else ""
        lines.append(f"{words[finding.degree]}  {finding.kind}: {finding.text}{where}")
    lines.append(
        "Whether the views fix where a wire is can be computed once there are poses: plnerf capture, then "
        "plnerf doctor SCENE."
        if diagnosis.usable
        else "Not usable for wires as it is."
    )
    return "\n".join(lines)


def _height(photos: Photos) -> float | None:
    """Median height over the starting point (DJI), as a guess at the distance to the wires."""
    heights = [fact.above_start_m for fact in photos.facts.values() if fact.above_start_m]
    return float(np.median(heights)) if heights else None
