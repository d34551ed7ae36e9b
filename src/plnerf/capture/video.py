"""The pictures of a video, upright and with their times; and a chosen few of them as files."""

from collections.abc import Collection, Iterator
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import UInt8

from plnerf.errors import CaptureError
from plnerf.scene.files import complete_file

JPEG_QUALITY = 95


def video_pictures(path: Path) -> Iterator[tuple[str, float | None, UInt8[np.ndarray, "h w 3"]]]:
    """Name (000000, 000001, ...), seconds from the start, and RGB of every picture, turned as the video says.

    Raises CaptureError where the file cannot be opened, or not one picture can be decoded.
    """
    capture = cv2.VideoCapture(str(path))
    try:
        if not path.is_file() or not capture.isOpened():
            raise CaptureError(
                f"{path} cannot be opened as a video. Play it in another program; if it plays, convert it: "
                f"ffmpeg -i {path.name} -c:v libx264 converted.mp4"
            )
        index = 0
        while True:
            decoded, image = capture.read()
            if not decoded:
                break
            time_s = capture.get(cv2.CAP_PROP_POS_MSEC) / 1000.0
            yield f"{index:06d}", time_s, cv2.cvtColor(image, cv2.COLOR_BGR2RGB)
            index += 1
        if index == 0:
            raise CaptureError(
                f"{path} is a video without a picture that can be decoded. Is it cut off? Copy it again."
            )
    finally:
        capture.release()


def stated_count(path: Path) -> int:
    """Pictures that the video's header promises; 0 where it says nothing."""
    capture = cv2.VideoCapture(str(path))
    try:
        return max(0, int(capture.get(cv2.CAP_PROP_FRAME_COUNT)))
    finally:
        capture.release()


def write_pictures(path: Path, names: Collection[str], folder: Path) -> list[Path]:
    """Decodes a video again and writes the named pictures as JPEG files, each complete or not at all."""
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for name, _, image in video_pictures(path):
        if name not in names:
            continue
        target = folder / f"{name}.jpg"
        quality = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
        _, data = cv2.imencode(".jpg", cv2.cvtColor(image, cv2.COLOR_RGB2BGR), quality)
        with complete_file(target) as beside:
            beside.write_bytes(data.tobytes())
        written.append(target)
    return written
