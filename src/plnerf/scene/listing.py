"""What a format's reader hands over: the images of a capture, with poses and intrinsics as the file states
them.

Poses are camera-to-world in the world frame, OpenCV axes, float64; intrinsics are those of the full-size
image.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Float

from plnerf.errors import SceneError

MAX_SIDE_PX, MAX_LENS_PX = 100_000, 1e9
"""Larger sizes, and larger numbers of a lens, are damage: sums of their squares would not fit."""


@dataclass(frozen=True)
class Intrinsics:
    """A pinhole with OpenCV's distortion; pixels from the image's top-left corner."""

    width: int
    height: int
    fl_x: float
    fl_y: float
    cx: float
    cy: float
    distortion: tuple[float, float, float, float, float]
    """k1 k2 p1 p2 k3."""
    owner: str
    """Who states them, for error texts: "the whole file", "this frame" or "COLMAP camera 1"."""


@dataclass(frozen=True, eq=False)
class Shot:
    """One image."""

    name: str
    """Path below the scene folder, with slashes."""
    path: Path
    T_world_camera: Float[np.ndarray, "4 4"]
    intrinsics: Intrinsics
    mask: Path | None = None
    wire_mask: Path | None = None
    depth: Path | None = None


@dataclass(frozen=True, eq=False)
class Listing:
    """All images of a capture, sorted by name, and what the file says about the scene as a whole."""

    root: Path
    shots: tuple[Shot, ...]
    format: str
    train: tuple[str, ...] | None = None
    """Names the file wants trained on; None: all that are not held out."""
    test: tuple[str, ...] | None = None
    """Names the file wants held out; None: all not in ``train``, or without ``train`` every eighth."""
    up: Float[np.ndarray, "3"] | None = None
    unit: Literal["m", "unscaled"] = "unscaled"
    crs: str | None = None
    origin: Float[np.ndarray, "3"] | None = None
    """Longitude, latitude (degrees) and height (m) of the world's origin, if it has one."""
    truth: Path | None = None
    left_out: tuple[str, ...] = ()


def some(names: Iterable[str], limit: int = 3) -> str:
    """ "a, b, c and 4 more": enough names to look for, on one line."""
    every = list(names)
    more = f" and {len(every) - limit} more" if len(every) > limit else ""
    return ", ".join(every[:limit]) + more


def check_lens(lens: Intrinsics, where: str) -> None:
    """Raise SceneError where a size or a number of a lens is none that a camera has."""
    focal, size, others = (lens.fl_x, lens.fl_y), (lens.width, lens.height), (lens.cx, lens.cy)
    values = np.array([*focal, *others, *lens.distortion])
    if min(*focal, *size) <= 0 or np.isnan(values).any():
        raise SceneError(
            f"{where}: focal lengths and sizes must be positive, but fl_x, fl_y, w, h are {lens.fl_x:g}, "
            f"{lens.fl_y:g}, {lens.width:g}, {lens.height:g}. Correct the file."
        )
    if max(size) > MAX_SIDE_PX or np.abs(values).max() > MAX_LENS_PX:
        raise SceneError(
            f"{where}: no camera has fl_x, fl_y {lens.fl_x:g}, {lens.fl_y:g}, cx, cy {lens.cx:g}, "
            f"{lens.cy:g} and distortion {', '.join(f'{k:g}' for k in lens.distortion)} in images of "
            f"{lens.width:g} x {lens.height:g} px. Correct the file, or run the pose estimation again."
        )


def check_present(listed: int, missing: Sequence[str], source: Path, *, may_leave_out: bool) -> None:
    """Raise SceneError when images that ``source`` lists are not on disk and cannot be left out.

    ``may_leave_out``: instant-ngp skips frames whose file is absent; that is followed as long as two images
    and at least half of all are there.
    """
    if not missing:
        return
    usable = listed - len(missing)
    names = f"{len(missing)} of the {listed} images that {source} lists are not there ({some(missing)})"
    if not may_leave_out:
        raise SceneError(f"{names}. Copy them into the scene folder, or take their frames out of the file.")
    if usable < 2 or 2 * len(missing) > listed:
        raise SceneError(
            f"{names}. Absent images of an instant-ngp file are left out, but at least two and no fewer than "
            "half must be there: copy the images into the scene folder, below which the file's paths are "
            "looked up."
        )


def check_unique(shots: Sequence[Shot], source: Path) -> None:
    """Raise SceneError when two frames are the same file on disk."""
    seen: dict[Path, Shot] = {}
    for shot in shots:
        first = seen.setdefault(shot.path.resolve(), shot)
        if first is not shot:
            names = first.name if first.name == shot.name else f"as {first.name} and as {shot.name}"
            raise SceneError(
                f"{source} lists the same file twice ({names}), so that one picture would have two poses. "
                "Take one of the two frames out of the file."
            )
