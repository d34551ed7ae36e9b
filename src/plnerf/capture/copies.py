"""Copies of photos in a scene, upright; each is made again where its photo was replaced under the same name.

A copy shares no bytes on disk with its photo: a hard link would let a program that writes into the scene
write into the user's photo, and the other way round.

photos.json beside the copies' folder says of which bytes each copy was made (SHA-256), and how long it was
and when it was written, so that a copy that was changed since is made again too.
"""

import hashlib
import io
import json
from pathlib import Path

from PIL import Image, ImageOps

from plnerf.errors import CaptureError
from plnerf.scene.files import complete_file, write_text
from plnerf.scene.strict_json import object_of, read_json

RECORD, FORMAT_VERSION = "photos.json", 1


class Copies:
    """The copies in one folder, and the record of what they were made of."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._known = _read_record(folder.with_name(RECORD))

    def bring(self, source: Path, *, turn: bool) -> None:
        """Copies a photo unless its copy is up to date.

        turn: whether EXIF says that it is not stored upright.  Raises CaptureError where its pixels are
        damaged, PlnerfError where the copy cannot be written.
        """
        data = _read(source)
        digest, copy = hashlib.sha256(data).hexdigest(), self._folder / source.name
        known = self._known.get(source.name) == [digest, *_stamp(copy)]
        if known and not copy.samefile(source):  # earlier versions linked, as programs against duplicates do
            return
        check_pixels(io.BytesIO(data))
        with complete_file(copy) as beside:
            if turn:
                with Image.open(io.BytesIO(data)) as image:
                    # Formats without loss pay no attention to the quality.
                    ImageOps.exif_transpose(image).save(beside, quality=95)
            else:
                beside.write_bytes(data)
        self._known[source.name] = [digest, *_stamp(copy)]

    def save(self) -> None:
        """Writes the record."""
        content = {"format_version": FORMAT_VERSION, "photos": self._known}
        write_text(self._folder.with_name(RECORD), json.dumps(content, indent=1) + "\n")


def check_pixels(photo: Path | io.BytesIO) -> None:
    """Decodes a photo.  Raises CaptureError where its pixels are damaged.

    COLMAP would take what is left of one that was cut off.
    """
    try:
        with Image.open(photo) as image:
            image.load()
    except Exception as error:  # a decoder that meets damaged bytes can raise anything
        raise CaptureError(f"its pixels cannot be read ({error})") from error


def _read(source: Path) -> bytes:
    try:
        return source.read_bytes()
    except OSError as error:
        raise CaptureError(f"it cannot be read ({error.strerror or error})") from error


def _stamp(copy: Path) -> list[int]:
    """Length and time of writing; nothing where there is no copy."""
    return [(stat := copy.stat()).st_size, stat.st_mtime_ns] if copy.is_file() else []


def _read_record(path: Path) -> dict[str, list[object]]:
    """The recorded state of each copy; empty if the record is missing or damaged: all are copied again."""
    try:
        content = object_of(read_json(path, CaptureError), str(path), CaptureError)
    except CaptureError:
        return {}
    known = content.get("photos") if content.get("format_version") == FORMAT_VERSION else None
    return known if isinstance(known, dict) else {}
