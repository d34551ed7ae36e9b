"""Masks of photos: where they are black, no features are looked for and nothing is learnt."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Bool
from PIL import Image

from plnerf.capture.exif import PhotoFacts
from plnerf.errors import CaptureError
from plnerf.scene.files import complete_file


def bring_masks(source: Path, facts: Mapping[str, PhotoFacts], target: Path) -> dict[str, Path]:
    """Writes the masks of images as target/IMAGE.png, COLMAP's names; returns their paths by image.

    source: a folder with IMAGE.png (DJI_1.JPG.png) or with the image's own name but for its suffix
    (DJI_1.png), where images without one are used whole; or one picture for all.  A mask has the size of its
    upright image, and is 0 where the image shall be ignored.  Raises CaptureError for one that does not fit,
    and where there is none for any image.
    """
    if not source.exists():
        raise CaptureError(f"There are no masks at {source}. Give a folder of them, or one picture for all.")
    found = {name: source if source.is_file() else _own(source, name) for name in facts}
    if not any(found.values()):
        first = next(iter(facts))
        raise CaptureError(
            f"The folder of masks {source} has none for any of the {len(facts)} images. Name them after the "
            f"images: {first}.png or {Path(first).stem}.png."
        )
    paths = {name: target / f"{name}.png" for name in found}
    for name, mask in found.items():
        _write(mask, paths[name], name, facts[name])
    return paths


def _own(folder: Path, name: str) -> Path | None:
    names = (f"{name}.png", f"{Path(name).stem}.png")
    return next((path for one in names if (path := folder / one).is_file()), None)


def _write(mask: Path | None, target: Path, name: str, facts: PhotoFacts) -> None:
    """As COLMAP reads them: grey, 0 or 255, and one for every image."""
    used = np.ones((facts.height_px, facts.width_px), bool) if mask is None else _read(mask, name, facts)
    with complete_file(target) as beside:
        Image.fromarray(np.where(used, np.uint8(255), np.uint8(0))).save(beside)


def _read(mask: Path, name: str, facts: PhotoFacts) -> Bool[np.ndarray, "h w"]:
    try:
        with Image.open(mask) as image:
            size, used = image.size, np.asarray(image.convert("L")) > 0
    except Exception as error:  # a decoder that meets damaged bytes can raise anything
        raise CaptureError(f"The mask {mask} cannot be read ({error}). Write it again, as PNG.") from error
    if size != (facts.width_px, facts.height_px):
        raise CaptureError(
            f"The mask {mask} is {size[0]} x {size[1]} px, but upright its image {name} is "
            f"{facts.width_px} x {facts.height_px}. A mask covers the whole upright image pixel by pixel: "
            "write it at that size."
        )
    return used
