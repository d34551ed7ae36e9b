"""Tension strings: where strain and terminal structures hold wires, as images show it.

The curves of adjacent spans meet at the structure, but a tension string ends short of it, and so does the
wire.  A string is an order of magnitude thicker than the wire, and lies where the wire would go on.  With g
the grey values across it, less the straight line through those at `far_m` on both sides,

    q = |g(near)| / (|g(core) - g(near)| + |g(far)| + noise)

is small of a wire, which has a core only, and large of a string.  Its median is taken over images and
conductors, since one structure holds all of them alike; where it falls, the string ends.

Letters: k places from the structure inwards, d offsets across the wire, i images.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from jaxtyping import Bool, Float

from plnerf.line.ends import TWO_SIDED_95, Attached
from plnerf.line.line import Line, Span
from plnerf.line.wire import Wire
from plnerf.survey.config_spans import TensionStringConfig
from plnerf.survey.posed_photos import Photos
from plnerf.survey.refine.projection import MOVES, project_wire

_End = tuple[Wire, int]
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


def with_tension_strings(
    lines: Sequence[Line], photos: Photos, config: TensionStringConfig
) -> tuple[Line, ...]:
    """The lines with their phase conductors ending at the clamps of tension strings where images show these,
    and with attachments as uncertain as such strings are long where images do not show which it is.

    At structures of kind suspension strings hang, whatever the images show.
    """
    full = photos.full_size()
    return tuple(_of_line(line, full, config) for line in lines)


def with_possible_strings(lines: Sequence[Line], config: TensionStringConfig) -> tuple[Line, ...]:
    """The lines of a point cloud, with attachments as uncertain as tension strings are long where the line
    turns by more than strings of suspension let it: of how such strings lie points show too little."""
    found = []
    for line in lines:
        turned = {one.id for one in line.structures if (one.line_angle_deg or 0.0) > config.turned_deg}
        ends = {id_: some for id_, some in _held(line).items() if id_ in turned}
        strings = {
            id_: Strings(None, longest_string_m(line.spans, some, config)) for id_, some in ends.items()
        }
        found.append(_with_strings(line, strings, config))
    return tuple(found)


def _held(line: Line) -> dict[int, list[_End]]:
    """The ends of the conductors that each structure holds; shield wires are clamped to it."""
    held: dict[int, list[_End]] = {}
    for wire in line.wires:
        for k, end in enumerate(wire.ends):
            if isinstance(end, Attached) and wire.kind != "shield":
                held.setdefault(end.structure, []).append((wire, k))
    return held


def _of_line(line: Line, photos: Photos, config: TensionStringConfig) -> Line:
    hanging = {one.id for one in line.structures if one.kind == "suspension"}
    strings = {
        id_: shown_strings(ends, photos, longest_string_m(line.spans, ends, config), config)
        for id_, ends in _held(line).items()
        if id_ not in hanging
    }
    return _with_strings(line, strings, config)


def _with_strings(line: Line, strings: Mapping[int, Strings], config: TensionStringConfig) -> Line:
    """The line whose structures' strings are known; a structure with tension strings is no suspension."""

    def changed(wire: Wire) -> Wire:
        for k, end in enumerate(wire.ends):
            if isinstance(end, Attached) and wire.kind != "shield" and end.structure in strings:
                wire = _ended(wire, k, end, strings[end.structure], config)
        return wire

    strained = {id_ for id_, one in strings.items() if one.length_m}
    return replace(
        line,
        structures=tuple(
            replace(one, kind="strain") if one.id in strained and one.kind == "unknown" else one
            for one in line.structures
        ),
        spans=tuple(replace(span, wires=tuple(changed(wire) for wire in span.wires)) for span in line.spans),
    )


def _ended(wire: Wire, k: int, end: Attached, strings: Strings, config: TensionStringConfig) -> Wire:
    """A wire that its structure's tension strings hold at one end."""
    name = ("first", "last")[k]
    if strings.length_m == 0:
        return wire
    if strings.length_m is None:
        sigma = float(np.hypot(end.sigma_m, strings.longest_m / TWO_SIDED_95))
        note = (
            f"Nothing shows whether a tension string holds its {name} end: its attachment may lie up to "
            f"{strings.longest_m:.1f} m nearer."
        )
        moved = wire
    else:
        sigma = float(np.hypot(end.sigma_m, config.sigma_m))
        note = f"A tension string of about {strings.length_m:.1f} m holds its {name} end."
        L = wire.base.length_m
        moved = wire.between(*((strings.length_m, L) if k == 0 else (0.0, L - strings.length_m)))
    point = moved.points(np.array([0.0, moved.base.length_m]))[k]
    ends = list(moved.ends)
    ends[k] = replace(end, point=point, sigma_m=sigma)
    return replace(moved, ends=(ends[0], ends[1]), notes=(*wire.notes, note))


def longest_string_m(spans: Sequence[Span], ends: Sequence[_End], config: TensionStringConfig) -> float:
    """Greatest length of a structure's tension strings: by the least distance between its phases, below whose
    arms strings as long hang at other structures."""
    least = config.longest_m / config.spacing_share
    for span in spans:
        places = np.array([
            wire.points(np.array([0.0, wire.base.length_m]))[k]
            for wire, k in ends
            if any(one is wire for one in span.wires)
        ]).reshape(-1, 3)
        apart = np.linalg.norm(places[:, None] - places, axis=2)
        apart = apart[apart > config.bundle_m]
        least = min(least, float(apart.min(initial=least)))
    return least * config.spacing_share


def shown_strings(
    ends: Sequence[_End], photos: Photos, longest_m: float, config: TensionStringConfig
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
    every = np.array(rows).reshape(-1, len(at))
    inside = (at >= config.window_m[0]) & (at <= config.window_m[1])
    beyond = at > longest_m + config.step_m
    samples = np.isfinite(every).sum(0)
    if samples[inside].sum() < config.min_samples:
        return Strings(None, longest_m)
    here = float(np.nanmedian(every[:, inside]))
    if here <= config.bare_q:
        return Strings(0.0, longest_m)
    if samples[beyond].sum() < config.min_samples:
        return Strings(None, longest_m)
    ratio = here / float(np.nanmedian(every[:, beyond]))
    if ratio <= config.bare_ratio:
        return Strings(0.0, longest_m)
    sure = np.log(ratio) - config.sigmas * np.hypot(_spread(every[:, inside]), _spread(every[:, beyond]))
    if ratio < config.string_ratio or here < config.string_q or sure < np.log(config.bare_ratio):
        return Strings(None, longest_m)
    good = samples >= config.min_samples / inside.sum()
    return Strings(_end_of_string(at[good], np.nanmedian(every[:, good], 0), longest_m, config), longest_m)


def _spread(q: Float[np.ndarray, "r k"]) -> float:
    """Standard deviation of the logarithm of the median of q, by how rows differ: the places of one
    conductor in one image see the same background, and count once."""
    rows = q[np.isfinite(q).any(1)]
    x = np.log(np.maximum(np.nanmedian(rows, 1), 1e-6))
    off = float(np.median(np.abs(x - np.median(x))))
    return MEDIAN_OF_NORMAL * off / float(np.sqrt(len(x)))


def _end_of_string(
    at: Float[np.ndarray, " k"], q: Float[np.ndarray, " k"], longest_m: float, config: TensionStringConfig
) -> float | None:
    """The place at which a step downwards describes the logarithm of q best; None where none does."""
    x = np.log(np.maximum(q, 1e-6))
    inner = np.flatnonzero((at >= config.window_m[1]) & (at <= longest_m + config.step_m))
    falls = [k for k in inner if np.median(x[1:k]) > np.median(x[k:])]
    best = min(falls, key=lambda k: _misfit(x[1:k]) + _misfit(x[k:]), default=None)
    return None if best is None else float(at[best])


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
) -> Float[np.ndarray, " k"]:
    """q at places along a wire in one image; NaN where it does not show them well."""
    seen = project_wire(photos.cameras[[i]], wire.base, wire.theta, s, np.zeros(MOVES), 1.0, config.end_on)
    by_m = np.linalg.norm(seen.by_yz, axis=1)
    d = np.arange(-config.far_m[1], config.far_m[1] + config.sample_m / 2, config.sample_m)
    pixel = seen.pixel[:, None] + (d * by_m[:, None])[..., None] * seen.normal[:, None]
    size = np.array(image.shape[1::-1])
    good = seen.good & (by_m >= config.least_px_per_m) & ((pixel > 0) & (pixel < size)).all((1, 2))
    q = np.full(len(s), np.nan)
    if not good.any():
        return q
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
    aside = g[:, near].mean(1)
    core = np.sqrt(((g[:, away <= config.core_m] - aside[:, None]) ** 2).mean((1, 2)))
    around = np.sqrt((g[:, far] ** 2).mean((1, 2)))
    q[good] = np.sqrt((aside**2).mean(1)) / (core + around + config.noise)
    return q
