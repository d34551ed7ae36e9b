"""A progressive sequence out of a video or a series of photos: kept is what moves on, is sharp and shows
something new.

One picture after the other is compared with the last one that was kept.  While they share more than MOST of
their area, nothing is new; from there down to LEAST, a picture is a candidate.  Once they share less, or
nothing that could be recognised, the last of the candidates is kept that is about as sharp as the sharpest.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import UInt8

from plnerf.capture.motion import Look, blurred, look_at, motion_between

MOST, LEAST = 0.92, 0.75
"""Shares of a picture that the next one shows: more is a near-duplicate, less is not asked for."""
AS_SHARP = 0.85
"""Of the sharpest candidate: what is sharp enough to be kept for lying further on."""
Reason = Literal["near-duplicate", "blurred", "another beside it was kept"]


@dataclass(frozen=True)
class Taken:
    """A picture of the sequence as it was measured."""

    name: str
    time_s: float | None
    sharpness: float
    overlap: float | None
    """With the last one kept before it; None for the first, and where it recognises nothing of that."""
    kept: bool
    reason: Reason | None
    """Why it was not kept."""
    gap: bool
    """Kept although it shares less than LEAST with the one before: structure from motion may part here."""


def choose_frames(
    pictures: Iterable[tuple[str, float | None, UInt8[np.ndarray, "h w 3"]]],
    *,
    most: float = MOST,
    least: float = LEAST,
    tell: Callable[[int], object] = lambda done: None,
) -> list[Taken]:
    """Measures pictures in their order (name, time, RGB) and decides which are kept.

    Only looks are held, not the pictures.  `tell` hears how many were looked at.
    """
    names, times, looks = [], [], []
    for name, time, image in pictures:
        names.append(name)
        times.append(time)
        looks.append(look_at(image))
        tell(len(looks))
    blur = blurred(np.array([look.sharpness for look in looks]))
    kept, overlaps, gaps = _walk(looks, blur, most, least)
    return [
        Taken(
            names[i],
            times[i],
            looks[i].sharpness,
            overlaps.get(i),
            i in kept,
            None if i in kept else _reason(i, blur, overlaps, most),
            i in gaps,
        )
        for i in range(len(looks))
    ]


def _walk(
    looks: list[Look], blur: np.ndarray, most: float, least: float
) -> tuple[set[int], dict[int, float], set[int]]:
    """Indices kept, overlaps with the last one kept, and those kept in spite of a gap."""
    sharp = [i for i in range(len(looks)) if not blur[i]]
    if not sharp:
        return set(), {}, set()
    last = sharp[0]
    at = last + 1
    kept: set[int] = {last}
    overlaps: dict[int, float] = {}
    gaps: set[int] = set()
    while at < len(looks):
        candidates: list[int] = []
        beyond: int | None = None  # the first one that shows too little
        for i in range(at, len(looks)):
            motion = motion_between(looks[last], looks[i])
            shared = motion.overlap if motion else None
            if shared is not None:
                overlaps[i] = shared
            if blur[i]:
                continue
            if shared is None or shared < least:
                beyond = i
                break
            if shared <= most:
                candidates.append(i)
        if candidates:
            sharpest = max(looks[i].sharpness for i in candidates)
            last = [i for i in candidates if looks[i].sharpness >= AS_SHARP * sharpest][-1]
        elif beyond is not None:
            last = beyond
            gaps.add(last)
        else:
            break  # nothing new any more
        kept.add(last)
        at = last + 1
    return kept, overlaps, gaps


def _reason(i: int, blur: np.ndarray, overlaps: dict[int, float], most: float) -> Reason:
    if blur[i]:
        return "blurred"
    return "near-duplicate" if overlaps.get(i, 1.0) > most else "another beside it was kept"
