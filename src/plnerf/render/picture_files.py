"""Pictures and arrays as files, each complete or absent."""

from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8, UInt16
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from plnerf.scene.files import complete_file as complete_file
from plnerf.scene.files import write_text as write_text


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
