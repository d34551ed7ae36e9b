"""Files that are complete or absent: written beside their place, then renamed into it."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8, UInt16
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from plnerf.errors import PlnerfError


@contextmanager
def complete_file(path: Path) -> Iterator[Path]:
    """A path beside `path`, with the same suffix; it becomes `path` when the block ends well.

    Makes the folder.  Raises PlnerfError where the file cannot be written, such as on a full disk.
    """
    beside = path.with_name(f"{path.stem}.partial{path.suffix}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            yield beside
            beside.replace(path)
        finally:
            beside.unlink(missing_ok=True)
    except OSError as error:
        raise PlnerfError(
            f"The file {path} cannot be written ({error.strerror or error}). Make room on the disk, or "
            "check that you may write into its folder. No half-written file is left behind."
        ) from error


def write_text(path: Path, text: str) -> None:
    """A text file in UTF-8."""
    with complete_file(path) as beside:
        beside.write_text(text, encoding="utf-8")


def write_png(
    path: Path, picture: UInt8[np.ndarray, "h w *c"] | UInt16[np.ndarray, "h w"], description: str = ""
) -> None:
    """A PNG, lossless: colour or grey in 8 bits, or grey in 16 bits; the description goes into its text."""
    text = PngInfo()
    if description:
        text.add_text("Description", description)
    with complete_file(path) as beside:
        Image.fromarray(np.ascontiguousarray(picture)).save(beside, "PNG", pnginfo=text)


def write_npy(path: Path, array: Float[np.ndarray, "..."]) -> None:
    """A NumPy file, float32."""
    with complete_file(path) as beside:
        np.save(beside, array.astype(np.float32), allow_pickle=False)
