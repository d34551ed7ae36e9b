"""Whether tension strings hold wires at a structure, as images show it, and how long these are.

A string is an order of magnitude thicker than the wire, and lies where the wire would go on.  With g the grey
values across it, less the straight line through those at `far_m` on both sides,

    q = |g(near)| / (|g(core) - g(near)| + |g(far)| + noise)
    p = |g(core) - g(near)| / (|g(near)| + |g(far)| + noise)

q is small of a wire, which has a core only, and large of a string; p is large of a wire.  Where shells of a
wide string reach as far as `far_m`, or to the string of a bundle's next conductor, q is hardly larger than of
a wire, but no wire is seen and p is small.  Medians are taken over images and conductors that are held alike;
where q falls, the string ends.  Half a metre and more beyond, a damper may hang below the wire, and q is
larger once more.

Letters: k places from the structure inwards, d offsets across the wire, r rows, one of each wire in each
image.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from jaxtyping import Bool, Float

from plnerf.line.wire import Wire
from plnerf.survey.config_spans import TensionStringConfig
from plnerf.survey.posed_photos import Photos
from plnerf.survey.refine.projection import MOVES, places_along, project_wire

End = tuple[Wire, int]
"""A wire, and which of its ends."""
MEDIAN_OF_NORMAL = 1.858
"""Standard deviation of the median of n normal variables, times sqrt(n), over their median deviation:
sqrt(pi / 2) / 0.6745."""


@dataclass(frozen=True)
class Strings:
    """What images show of a structure's tension strings."""

    length_m: float | None
    """0 where they show the wires up to the structure; None where they do not show which it is."""
    longest_m: float
    """No string there is longer."""
    misfits: tuple[tuple[float, float], ...] = ()
    """Each length that strings may have, and how badly it fits what images show."""

    def like(self, length_m: float, within_m: float, most: float) -> "Strings":
        """With the length that fits best within a distance of another one, if it fits at most so many times
        as badly as the best of all; else as they are."""
        least = min((misfit for _, misfit in self.misfits), default=0.0)
        near = [(misfit, own) for own, misfit in self.misfits if abs(own - length_m) <= within_m]
        misfit, own = min(near, default=(np.inf, 0.0))
        return replace(self, length_m=own) if misfit <= most * least else self


def shown_strings(
    ends: Sequence[End], photos: Photos, longest_m: float, config: TensionStringConfig
) -> Strings:
    """What images show of the strings of one structure; photos at their full size."""
    shortest = min(wire.base.length_m for wire, _ in ends)
    reach_m = min(longest_m + config.beyond_m, shortest / 2)
    at = np.arange(0.0, reach_m + config.step_m / 2, config.step_m)
    places = [at if k == 0 else wire.base.length_m - at for wire, k in ends]
    near = photos.of(np.concatenate([wire.points(s) for (wire, _), s in zip(ends, places, strict=True)]))
    rows = []
    for i in near.train:
        image = near.images.image(i).astype(np.float32)
        valid = near.images.valid(i) if near.images.has_masks else None
        for (wire, _), s in zip(ends, places, strict=True):
            rows.append(_measure(image, valid, near, i, wire, s, config))
    beside, core = np.moveaxis(np.array(rows).reshape(-1, 2, len(at)), 1, 0)
    inside = (at >= config.window_m[0]) & (at <= config.window_m[1])
    beyond = at > longest_m + config.step_m
    samples = np.isfinite(beside).sum(0)
    if samples[inside].sum() < config.min_samples:
        return Strings(None, longest_m)
    here = float(np.nanmedian(beside[:, inside]))
    if here <= config.bare_q:
        return Strings(0.0, longest_m)
    if samples[beyond].sum() < config.min_samples:
        return Strings(None, longest_m)
    along = (at >= config.window_m[0]) & (at <= config.seen_to * longest_m)
    ratio, sure = _against(beside, inside, beyond, config)
    seen, sure_of_it = _against(core, along, beyond, config)
    hidden = ratio > config.bare_ratio and seen * sure_of_it < config.seen_ratio
    if hidden or (ratio >= max(config.string_ratio, config.bare_ratio * sure) and here >= config.string_q):
        good = samples >= config.min_samples / inside.sum()
        misfits = _misfits(at[good], np.nanmedian(beside[:, good], 0), longest_m, config)
        best = min(misfits, key=lambda one: one[1], default=(None, 0.0))
        return Strings(best[0], longest_m, tuple(misfits))
    bare = ratio <= config.bare_ratio or ratio * sure < config.string_ratio
    return Strings(0.0 if bare and not seen < config.seen_ratio else None, longest_m)


def _against(
    x: Float[np.ndarray, "r k"],
    here: Bool[np.ndarray, " k"],
    beyond: Bool[np.ndarray, " k"],
    config: TensionStringConfig,
) -> tuple[float, float]:
    """The median of x here as a multiple of that beyond, and the factor by which it may be larger or smaller;
    NaN where too little is seen here."""
    if np.isfinite(x[:, here]).sum() < config.min_samples:
        return np.nan, np.nan
    ratio = float(np.nanmedian(x[:, here]) / max(np.nanmedian(x[:, beyond]), 1e-6))
    return ratio, float(np.exp(config.sigmas * np.hypot(_spread(x[:, here]), _spread(x[:, beyond]))))


def _spread(q: Float[np.ndarray, "r k"]) -> float:
    """Standard deviation of the logarithm of the median of q, by how rows differ: the places of one
    conductor in one image see the same background, and count once."""
    rows = q[np.isfinite(q).any(1)]
    x = np.log(np.maximum(np.nanmedian(rows, 1), 1e-6))
    off = float(np.median(np.abs(x - np.median(x))))
    return MEDIAN_OF_NORMAL * off / float(np.sqrt(len(x)))


def _misfits(
    at: Float[np.ndarray, " k"], q: Float[np.ndarray, " k"], longest_m: float, config: TensionStringConfig
) -> list[tuple[float, float]]:
    """The places at which the logarithm of q may step downwards, and how badly each such step fits it."""
    x = np.log(np.maximum(q, 1e-6))
    inner = np.flatnonzero((at >= config.window_m[1]) & (at <= longest_m + config.step_m))
    falls = [k for k in inner if np.median(x[1:k]) > np.median(x[k:])]
    return [(float(at[k]), _misfit(x[1:k]) + _misfit_of_wire(x[k:], config)) for k in falls]


def _misfit_of_wire(x: Float[np.ndarray, " k"], config: TensionStringConfig) -> float:
    """How badly one level fits, or one of all places but those of a damper, which have their own."""
    first, longest = (round(metres / config.step_m) for metres in (config.damper_from_m, config.damper_m))
    dampers = (
        slice(low, high)
        for low in range(first, len(x) - 1)
        for high in range(low + 2, min(low + longest, len(x)) + 1)
    )
    with_one = (_misfit(np.delete(x, one)) + _misfit(x[one]) for one in dampers)
    return min(_misfit(x), min(with_one, default=np.inf))


def _misfit(x: Float[np.ndarray, " k"]) -> float:
    return float(np.abs(x - np.median(x)).sum())


def _measure(
    image: Float[np.ndarray, "h w c"],
    valid: Bool[np.ndarray, "h w"] | None,
    photos: Photos,
    i: int,
    wire: Wire,
    s: Float[np.ndarray, " k"],
    config: TensionStringConfig,
) -> Float[np.ndarray, "2 k"]:
    """q and p at places along a wire in one image; NaN where it does not show them well."""
    places = places_along(wire.base, wire.theta, s)
    seen = project_wire(photos.cameras[[i]], places, np.zeros(MOVES), 1.0, config.end_on)
    by_m = np.linalg.norm(seen.by_yz, axis=1)
    d = np.arange(-config.far_m[1], config.far_m[1] + config.sample_m / 2, config.sample_m)
    pixel = seen.pixel[:, None] + (d * by_m[:, None])[..., None] * seen.normal[:, None]
    size = np.array(image.shape[1::-1])
    good = seen.good & (by_m >= config.least_px_per_m) & ((pixel > 0) & (pixel < size)).all((1, 2))
    both = np.full((2, len(s)), np.nan)
    if not good.any():
        return both
    x, y = np.moveaxis((pixel[good] - 0.5).astype(np.float32), 2, 0)
    if valid is not None:
        column, row = np.clip(seen.pixel[good], 0, size - 1).astype(int).T
        good[good] = valid[row, column]
        x, y = x[valid[row, column]], y[valid[row, column]]
    grey = cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).reshape(*x.shape, -1)
    away = np.abs(d)
    near, far = (away >= config.near_m[0]) & (away <= config.near_m[1]), away >= config.far_m[0]
    line = np.stack([np.ones(len(d)), d], 1)
    g = grey - np.einsum("dc,cf,kfb->kdb", line, np.linalg.pinv(line[far]), grey[:, far])
    middle = g[:, near].mean(1)
    aside = np.sqrt((middle**2).mean(1))
    core = np.sqrt(((g[:, away <= config.core_m] - middle[:, None]) ** 2).mean((1, 2)))
    around = np.sqrt((g[:, far] ** 2).mean((1, 2))) + config.noise
    both[:, good] = aside / (core + around), core / (aside + around)
    return both
