"""`plnerf doctor PHOTOS`: what is wrong with photos, before hours are spent on them."""

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path

import cv2
import numpy as np
from PIL import Image, UnidentifiedImageError
from rich.console import Console

from plnerf.capture.cost import about_cost
from plnerf.capture.findings import (
    BRIGHT,
    DARK,
    Finding,
    Small,
    about_files,
    about_pictures,
    about_positions,
    about_wires,
)
from plnerf.capture.motion import look_at
from plnerf.capture.photos import Photos, find_photos
from plnerf.capture.references import GEO_TXT, from_photos, read_geo_txt
from plnerf.errors import CaptureError
from plnerf.scene.files import write_text

FORMAT_VERSION = 1
LOOK_PX = 1000
"""Longer side of the pictures that are judged."""
SHOWN = 5


def examine_photos(
    folder: Path,
    *,
    distance_m: float | None,
    wire_diameter_m: float,
    preset: str,
    rays_per_s: float | None,
    out: Path | None,
    console: Console,
    tell: Callable[[int, int], object] = lambda done, of: None,
) -> bool:
    """Prints findings, writes them as JSON where asked, and returns whether going on makes sense.

    preset: what is to be trained, and how fast that is, where it was measured.
    Raises CaptureError where the folder has no photo that can be read.
    """
    photos = find_photos(folder)
    small, broken = {}, list(photos.problems)
    for done, name in enumerate(photos.facts, start=1):
        try:
            small[name] = small_of(folder / name)
        except CaptureError as error:
            broken.append(f"{name}: {error}")
        tell(done, len(photos.facts))
    facts = {name: fact for name, fact in photos.facts.items() if name in small}
    table = folder / GEO_TXT
    references = read_geo_txt(table, list(facts)) if table.is_file() else from_photos(facts)
    distance = distance_m if distance_m is not None else _height(photos)
    findings = [
        *about_files(facts, broken),
        *about_pictures(small),
        *about_positions(facts, references),
        *about_wires(facts, distance, wire_diameter_m),
        *([about_cost(facts, preset, rays_per_s)] if facts else []),
    ]
    usable = not any(finding.degree == "stops" for finding in findings)
    console.print(_text(findings, len(facts), usable), highlight=False, markup=False, soft_wrap=True)
    if out is not None:
        content = {
            "format_version": FORMAT_VERSION,
            "photos": len(facts),
            "usable": usable,
            "distance_m": distance,
            "findings": [asdict(finding) for finding in findings],
        }
        write_text(out, json.dumps(content, indent=1, allow_nan=False) + "\n")
        console.print(f"diagnosis: {out}", markup=False, highlight=False, emoji=False, soft_wrap=True)
    return usable


def small_of(path: Path) -> Small:
    """Reads all of a photo, small.  Raises CaptureError where its pixels are damaged."""
    try:
        with Image.open(path) as image:
            image.draft("RGB", (LOOK_PX, LOOK_PX))  # JPEG: decodes at a half, a quarter, ...
            picture = np.asarray(image.convert("RGB"))
    except (OSError, UnidentifiedImageError, SyntaxError, ValueError) as error:
        raise CaptureError(f"its pixels cannot be read ({error})") from error
    grey = cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)
    tiny = cv2.resize(grey, (16, 16), interpolation=cv2.INTER_AREA).astype(np.float64)
    bright, dark = float((grey >= BRIGHT).mean()), float((grey <= DARK).mean())
    return Small(look_at(picture).sharpness, bright, dark, tiny)


def _height(photos: Photos) -> float | None:
    """Median height over the starting point (DJI), as a guess at the distance to the wires."""
    heights = [fact.above_start_m for fact in photos.facts.values() if fact.above_start_m]
    return float(np.median(heights)) if heights else None


def _text(findings: Sequence[Finding], count: int, usable: bool) -> str:
    words = {"stops": "STOPS", "harms": "harms", "note": "note "}
    lines = [f"{count} photos can be read."]
    for finding in findings:
        names = ", ".join(finding.where[:SHOWN])
        more = f" and {len(finding.where) - SHOWN} more" if len(finding.where) > SHOWN else ""
        where = f" ({names}{more})" if names else ""
        do = f" -> {finding.do}." if finding.do else "."
        lines.append(f"{words[finding.degree]}  {finding.kind}: {finding.what}{where}{do}")
    lines.append(
        "Whether the views fix where a wire is can be told once there are poses: plnerf capture, then plnerf "
        "doctor SCENE."
        if usable
        else "Not usable for wires as it is."
    )
    return "\n".join(lines)
