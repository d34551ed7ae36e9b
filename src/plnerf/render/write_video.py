"""Pictures on disk to an MP4 that plays everywhere: H.264, 4:2:0, even sizes."""

from collections.abc import Sequence
from pathlib import Path

import imageio_ffmpeg
import numpy as np
from jaxtyping import UInt8
from PIL import Image

from plnerf.errors import PlnerfError
from plnerf.render.picture_files import complete_file


def require_ffmpeg() -> None:
    """Raises PlnerfError where videos cannot be written; to be asked before hours of rendering."""
    try:
        imageio_ffmpeg.get_ffmpeg_exe()
    except RuntimeError as error:
        raise PlnerfError(
            "Videos need ffmpeg, which comes with the package imageio[ffmpeg], but none was found. Install "
            "that package, put an ffmpeg on the PATH, or render without videos (--no-video)."
        ) from error


def write_video(path: Path, pictures: Sequence[Path], fps: float) -> None:
    """Encodes pictures in order, one at a time in memory, and counts them in the file before it is kept.

    Odd sizes lose their last row or column; pictures smaller than the largest are set in its middle on black.
    Raises PlnerfError where ffmpeg ends early; no video is left then.
    """
    sizes = [Image.open(picture).size for picture in pictures]
    width, height = (max(2, max(side) // 2 * 2) for side in zip(*sizes, strict=True))
    with complete_file(path) as beside:
        # Absolute, so that ffmpeg takes neither "-" for an option nor "a:" for a protocol.
        target = str(beside.absolute())
        try:
            _encode(target, pictures, (width, height), fps)
            written, _ = imageio_ffmpeg.count_frames_and_secs(target)
        except (OSError, RuntimeError) as error:  # a broken pipe, or a file that holds no video
            raise _ended_early(path, len(pictures)) from error
        if written != len(pictures):
            raise _ended_early(path, len(pictures), written)


def _encode(target: str, pictures: Sequence[Path], size_px: tuple[int, int], fps: float) -> None:
    writer = imageio_ffmpeg.write_frames(
        target,
        size_px,
        fps=fps,
        codec="libx264",
        pix_fmt_out="yuv420p",
        macro_block_size=2,
        quality=None,
        output_params=["-crf", "18", "-movflags", "+faststart"],
    )
    writer.send(None)
    try:
        for picture in pictures:
            writer.send(np.ascontiguousarray(_on_canvas(picture, *size_px)))
    finally:
        writer.close()


def _ended_early(path: Path, count: int, written: int = 0) -> PlnerfError:
    return PlnerfError(
        f"ffmpeg ended before the video {path} was whole: {written} of {count} pictures are in it. It was "
        "stopped, the disk is full, or the program "
        f"{imageio_ffmpeg.get_ffmpeg_exe()} does not work. Render again, or without videos (--no-video). No "
        "half-written video is left behind."
    )


def _on_canvas(picture: Path, width: int, height: int) -> UInt8[np.ndarray, "{height} {width} 3"]:
    with Image.open(picture) as opened:
        frame = np.asarray(opened.convert("RGB"))[:height, :width]
    canvas = np.zeros((height, width, 3), np.uint8)
    top, left = (height - frame.shape[0]) // 2, (width - frame.shape[1]) // 2
    canvas[top : top + frame.shape[0], left : left + frame.shape[1]] = frame
    return canvas
