"""Decodes and reduces all images of a capture into the files of an ``ImageStore``, once.

Letters: n images.  The folder holds ``images.u8`` (3 bytes per pixel at the training resolution),
``valid.u8`` (1 byte per pixel, only with masks) and ``index.json`` (fingerprint and sizes; its presence says
that the others are whole).

Memory: two decoded images, one per worker (measured: 115 MB each for 12 megapixels; the decoder's copy, the
array and the compressed file), whatever the number of images.
"""

import glob
import hashlib
import json
import os
import socket
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import cv2
import numpy as np
import psutil
from jaxtyping import Int, Shaped

from plnerf.errors import SceneError
from plnerf.scene.decode import exif_turns, read_mask, read_rgb, stored_size_px
from plnerf.scene.images import ImageStore
from plnerf.scene.listing import Shot
from plnerf.scene.strict_json import object_of, read_json

MIN_SIDE_PX = 16
_WORKERS = 2
_LAYOUT = 1
"""Raise when the files' layout or the way images are reduced changes: older stores are then built again."""

Progress = Callable[[int, int], None]
"""Called with (images done, images in all)."""


def reduced_sizes_px(shots: Sequence[Shot], downscale: int) -> Int[np.ndarray, "n 2"]:
    """Width and height of each image at the training resolution: full size // downscale."""
    if downscale < 1:
        raise SceneError(
            f"The downscale factor must be 1 (full size) or more, but is {downscale}. Choose 1, 2, 4 or 8."
        )
    sizes = np.array([[s.intrinsics.width, s.intrinsics.height] for s in shots], dtype=np.int64)
    reduced: Int[np.ndarray, "n 2"] = sizes // downscale
    worst = int(reduced.min(1).argmin())
    if reduced[worst].min() < MIN_SIDE_PX:
        most = int(sizes[worst].min()) // MIN_SIDE_PX
        advice = f"Choose a downscale of at most {most}." if most else "Leave images that small out."
        raise SceneError(
            f"Downscaled by {downscale}, the image {shots[worst].path} of "
            f"{sizes[worst, 0]}x{sizes[worst, 1]} pixels would be {reduced[worst, 0]}x{reduced[worst, 1]}; "
            f"each side needs at least {MIN_SIDE_PX} pixels. {advice}"
        )
    return reduced


def open_store(
    shots: Sequence[Shot], root: Path, folder: Path, *, downscale: int, progress: Progress | None = None
) -> ImageStore:
    """The store of these images, built first unless ``folder`` already holds it.

    A store is reused while the files' paths, sizes and modification times, the expected sizes and
    ``downscale`` are the same.  Files are written beside and renamed, the index last; a build removes what
    killed ones have left.  Raises SceneError when an image or a mask cannot be used, or the disk is full.
    """
    sizes = reduced_sizes_px(shots, downscale)
    fingerprint = _fingerprint(shots, root, downscale)
    if not _is_current(folder, fingerprint, sizes):
        check_sizes(shots)
        try:
            _build(shots, folder, sizes, fingerprint, progress)
        except OSError as error:
            raise SceneError(
                f"The image store in {folder} cannot be written ({error.strerror or error}); it needs "
                f"{_pixel_count(sizes) * 4 / 1e6:.0f} MB. Make room, choose another folder, or a larger "
                "downscale."
            ) from error
    return ImageStore(folder, sizes)


def check_sizes(shots: Sequence[Shot]) -> None:
    """Raise SceneError where a stored image is not of its intrinsics' size; reads headers only."""
    found = [stored_size_px(shot.path) for shot in shots]
    for shot, size in zip(shots, found, strict=True):
        want = (shot.intrinsics.width, shot.intrinsics.height)
        if size == want:
            continue
        owner = shot.intrinsics.owner
        peers = {s for other, s in zip(shots, found, strict=True) if other.intrinsics.owner == owner}
        is_px, should_px = f"{size[0]}x{size[1]}", f"{want[0]}x{want[1]}"
        what = f"The image {shot.path} is {is_px} pixels, but the intrinsics of {owner} say {should_px}"
        if size == want[::-1] and exif_turns(shot.path):
            raise SceneError(
                f"{what}. Its EXIF tag turns it by 90 degrees, so the poses were made from upright copies, "
                "while pixels are read as stored here. Turn the files themselves (exiftran -ai FILES, or "
                "jpegtran) and keep the poses."
            )
        if len(peers) > 1:
            listed = ", ".join(f"{w}x{h}" for w, h in sorted(peers)[:4])
            raise SceneError(
                f"{what}: its images have {len(peers)} different sizes ({listed}). Give each frame its own "
                "w, h, fl_x, fl_y, cx and cy, or leave the images of another size out."
            )
        raise SceneError(
            f"{what}. Use the images that the poses were made from, or scale w, h, fl_x, fl_y, cx and cy by "
            "the same factor as the images."
        )


def _build(
    shots: Sequence[Shot],
    folder: Path,
    sizes: Int[np.ndarray, "n 2"],
    fingerprint: str,
    progress: Progress | None,
) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    starts = np.concatenate([[0], np.cumsum(sizes[:, 0] * sizes[:, 1])])
    _remove_left(folder)
    beside = {
        name: folder / f"{name}.{socket.gethostname()}-{os.getpid()}.partial"
        for name in ("images.u8", "valid.u8", "index.json")
    }
    masked = any(shot.mask is not None for shot in shots)
    try:
        _allocate(beside["images.u8"], int(starts[-1]) * 3)
        if masked:
            _allocate(beside["valid.u8"], int(starts[-1]))

        def place(i: int) -> None:
            shot, size = shots[i], (int(sizes[i, 0]), int(sizes[i, 1]))
            reduced = reduce_by_area(read_rgb(shot.path), size)
            _write(beside["images.u8"], 3 * int(starts[i]), reduced)
            if masked:
                usable = np.ones(size[::-1], dtype=np.bool_)
                if shot.mask is not None:
                    ignored = (~read_mask(shot.mask, shot.intrinsics)).astype(np.float32)
                    usable = reduce_by_area(ignored, size) == 0
                _write(beside["valid.u8"], int(starts[i]), usable.astype(np.uint8))

        with ThreadPoolExecutor(_WORKERS) as pool:
            jobs = [pool.submit(place, i) for i in range(len(shots))]
            try:
                for done, job in enumerate(jobs, start=1):  # in order: the first bad image is the one named
                    job.result()
                    if progress is not None:
                        progress(done, len(shots))
            except BaseException:  # also Ctrl-C: do not decode the rest first
                pool.shutdown(cancel_futures=True)
                raise
        for name in ("images.u8", "valid.u8") if masked else ("images.u8",):
            with beside[name].open("rb+") as file:
                os.fsync(file.fileno())
        index = {"layout": _LAYOUT, "fingerprint": fingerprint, "sizes_px": sizes.tolist(), "masked": masked}
        beside["index.json"].write_text(json.dumps(index))
        (folder / "index.json").unlink(missing_ok=True)
        os.replace(beside["images.u8"], folder / "images.u8")
        if masked:
            os.replace(beside["valid.u8"], folder / "valid.u8")
        else:
            (folder / "valid.u8").unlink(missing_ok=True)
        os.replace(beside["index.json"], folder / "index.json")
    finally:
        for path in beside.values():
            path.unlink(missing_ok=True)


def reduce_by_area(
    full: Shaped[np.ndarray, "h w *c"], size_px: tuple[int, int]
) -> Shaped[np.ndarray, "h2 w2 *c"]:
    """The image at another size (width, height), each pixel the mean of the area it covers."""
    if (full.shape[1], full.shape[0]) == size_px:
        return full
    return cv2.resize(full, size_px, interpolation=cv2.INTER_AREA)


def _remove_left(folder: Path) -> None:
    """Removes partial files of processes of this machine that were killed; they are as large as the store."""
    for path in folder.glob(f"*.{glob.escape(socket.gethostname())}-*.partial"):
        process = path.name.removesuffix(".partial").rpartition("-")[2]
        if process.isdecimal() and not psutil.pid_exists(int(process)):
            path.unlink(missing_ok=True)


def _allocate(path: Path, size: int) -> None:
    """Makes a file whose blocks are reserved: a full disk is an OSError now, before anything is decoded."""
    with path.open("wb") as file:
        if hasattr(os, "posix_fallocate"):
            os.posix_fallocate(file.fileno(), 0, size)
        else:
            file.truncate(size)


def _write(path: Path, place: int, values: Shaped[np.ndarray, "h w *c"]) -> None:
    """Puts bytes into their place of a file.

    Not by a map: its pages would count as memory of the process, whole.
    """
    with path.open("rb+") as file:
        file.seek(place)
        file.write(np.ascontiguousarray(values).data)


def _pixel_count(sizes: Int[np.ndarray, "n 2"]) -> int:
    return int((sizes[:, 0] * sizes[:, 1]).sum())


def _is_current(folder: Path, fingerprint: str, sizes: Int[np.ndarray, "n 2"]) -> bool:
    try:
        index = object_of(read_json(folder / "index.json", SceneError), "index.json", SceneError)
        bytes_there = (folder / "images.u8").stat().st_size
        masks_fit = not index["masked"] or (folder / "valid.u8").stat().st_size == _pixel_count(sizes)
    except (SceneError, OSError, KeyError):
        return False  # no store, or one that a crash or another program left: build it
    return bool(index["fingerprint"] == fingerprint and bytes_there == 3 * _pixel_count(sizes) and masks_fit)


def _fingerprint(shots: Sequence[Shot], root: Path, downscale: int) -> str:
    lines = [f"layout {_LAYOUT} downscale {downscale}"]
    for shot in shots:
        lines.append(f"{shot.name} {shot.intrinsics.width} {shot.intrinsics.height}")
        for path in (shot.path, shot.mask):
            if path is not None:
                stat = path.stat()
                below = path.relative_to(root) if path.is_relative_to(root) else path
                lines.append(f"{below} {stat.st_size} {stat.st_mtime_ns}")
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()
