"""Image and mask files to arrays, and the error texts for files that cannot be used.

Orientation: EXIF rotation is never applied, because poses and intrinsics belong to the pixel grid as it is
stored. The check is the size: an image whose stored width and height are not those of its intrinsics is an
error, which says so when the EXIF rotation explains the difference.
"""

import io
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Shaped, UInt8
from PIL import ExifTags, Image, UnidentifiedImageError

from plnerf.errors import SceneError
from plnerf.scene.listing import Intrinsics

_SIXTEEN_BIT_MODES = {"I", "F", "I;16", "I;16L", "I;16B", "I;16N"}
_TURNED_BY_90 = {5, 6, 7, 8}


def stored_size_px(path: Path) -> tuple[int, int]:
    """Width and height of the stored pixel grid, from the file's header alone."""
    with _open(path, path) as image:
        return image.size


def exif_turns(path: Path) -> bool:
    """Whether the EXIF tag asks viewers to turn the picture by 90 degrees."""
    with _open(path, path) as image:
        return image.getexif().get(ExifTags.Base.Orientation) in _TURNED_BY_90


def read_rgb(path: Path) -> UInt8[np.ndarray, "h w 3"]:
    """The stored pixel grid of an 8-bit RGB picture.  Raises SceneError for every other kind and for broken
    files."""
    data = _bytes(path)
    with _open(path, io.BytesIO(data)) as image:
        _require_rgb(path, image, data)
        return _pixels(path, image).astype(np.uint8, copy=False)


def read_mask(path: Path, intrinsics: Intrinsics) -> Bool[np.ndarray, "h w"]:
    """True where a mask lets the photo be used (nerfstudio's rule: 0 = ignore); same size as the photo."""
    with _open(path, io.BytesIO(_bytes(path))) as image:
        size = (intrinsics.width, intrinsics.height)
        if image.size != size:
            raise SceneError(
                f"The mask {path} is {image.width}x{image.height} pixels, but its photo is "
                f"{size[0]}x{size[1]}. A mask covers the full-size photo pixel by pixel (0 = ignore): write "
                "it again at that size."
            )
        used: Bool[np.ndarray, "h w *c"] = _pixels(path, image) != 0
    if used.ndim == 3:  # colour counts, transparency does not
        used = np.logical_or.reduce(used[..., :-1] if image.mode.endswith("A") else used, axis=-1)
    return used


def _bytes(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise SceneError(
            f"The image {path} cannot be read ({error.strerror}). Check the file and its permissions."
        ) from error


def _open(path: Path, stream: Path | io.BytesIO) -> Image.Image:
    try:
        return Image.open(stream)
    except UnidentifiedImageError as error:
        raise SceneError(
            f"The file {path} is not an image that Pillow knows (JPEG, PNG, TIFF, WebP and others), or its "
            "beginning is damaged. Copy it from the camera again, convert it to JPEG or PNG, or take its "
            "frame out of the file."
        ) from error
    except Exception as error:  # what damaged bytes make Pillow raise has no common base
        raise SceneError(
            f"The image {path} cannot be opened ({error}). Copy it from the camera again, or take its frame "
            "out of the file."
        ) from error


def _pixels(path: Path, image: Image.Image) -> Shaped[np.ndarray, "h w *c"]:
    try:
        return np.asarray(image)
    except Exception as error:  # a decoder that meets damaged bytes can raise anything
        raise SceneError(
            f"The image {path} is damaged: it begins well but cannot be decoded to its end ({error}). Copy "
            "it from the camera again, or take its frame out of the file."
        ) from error


def _require_rgb(path: Path, image: Image.Image, data: bytes) -> None:
    bits = _bits(image, data)
    if image.mode in _SIXTEEN_BIT_MODES or bits > 8:
        raise SceneError(
            f"The image {path} has {max(bits, 16)} bits per channel, but photos must be 8-bit RGB. Convert "
            "all photos with the same tone curve, for example with ImageMagick: mogrify -depth 8 FILES."
        )
    if image.mode in {"RGBA", "LA", "PA", "RGBa", "La"}:
        raise SceneError(
            f"The image {path} has an alpha channel (mode {image.mode}), but photos must be 8-bit RGB. "
            "Flatten it onto a background, and if its transparent part is to be ignored, save the alpha "
            "channel as a mask file and name it as mask_path (0 = ignore)."
        )
    if image.mode in {"1", "L"}:
        raise SceneError(
            f"The image {path} is grey (mode {image.mode}), but photos must be 8-bit RGB. Repeat the channel "
            "three times, for example with ImageMagick: mogrify -type TrueColor -define png:color-type=2 "
            "FILES."
        )
    if image.mode != "RGB":
        raise SceneError(
            f"The image {path} has the colour mode {image.mode}, but photos must be 8-bit RGB. Convert it, "
            "for example with ImageMagick: mogrify -colorspace sRGB -type TrueColor FILES."
        )


def _bits(image: Image.Image, data: bytes) -> int:
    """Bits per channel as stored: Pillow silently reads 16-bit colour PNGs as 8-bit, so its mode does not
    tell."""
    if image.format == "PNG":
        return data[24]  # IHDR: 8 bytes signature, 8 chunk head, 4 width, 4 height, bit depth
    if image.format == "TIFF":
        return int(np.max(getattr(image, "tag_v2", {}).get(258, 8)))  # BitsPerSample, one or one per channel
    return 8
