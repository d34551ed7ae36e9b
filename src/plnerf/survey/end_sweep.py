"""Where a line is held, by photos that agree on one plane across it only: a plane sweep.

Photos of a flight along the line show a distant arm with its insulators, or the pins on a crossarm, by few
pixels and from one side, too little for a map of depths.  But all of that stands in one upright plane across
the line.  Seen on that plane, all photos show the same patch about a wire; on planes before and behind it
they do not (R. Collins, "A space-sweep approach to true multi-image matching", CVPR 1996).  The wire itself
and a smooth background look alike on all planes, so what counts is the correlation above its median.

Letters: t along a junction's axis, y to its left, z up; w wires, m planes, a x b samples of a patch upwards
and to the left.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32
from scipy.sparse.csgraph import connected_components

from plnerf.line.base import Base
from plnerf.line.wire import Wire
from plnerf.survey.config_end_sweep import EndSweepConfig
from plnerf.survey.posed_photos import Photos
from plnerf.survey.span_wires import Junction, crossing
from plnerf.survey.stereo.stereo_views import Picture, picture, view_of

UP = np.array([0.0, 0.0, 1.0])
NODES_M = 0.25
"""Distance of the places that are projected; those between are interpolated."""
MOST_CHANNELS = 128
"""An image in OpenCV 5 has no more."""


@dataclass(frozen=True, eq=False)
class _Patches:
    """What a photo shows of the patches about one wire."""

    grey: Float32[np.ndarray, "a b m"]
    mean: Float32[np.ndarray, "a b m"]
    """In windows around the samples."""
    variance: Float32[np.ndarray, "a b m"]
    inside: Bool[np.ndarray, "a b m"]
    moves: Float[np.ndarray, "2"]
    """How far in y and z, in metres, its picture of a plane shifts when the plane moves by a metre."""


def held_across(
    junction: Junction, photos: Photos, low: float, high: float, config: EndSweepConfig
) -> tuple[float, int] | None:
    """Where between two places of the axis photos agree on what holds wires, and on how many of them, those
    of a bundle counted once; None: nowhere.

    photos: at their full size; lengths are metres.
    """
    t = np.arange(low, high + config.step_m / 2, config.step_m)
    wires = [wire for side in junction.sides for wire in side if _passes(wire, junction.axis, t)]
    if not wires:
        return None
    every = zip(wires, _scores(wires, junction.axis, photos, t, config), strict=True)
    peaks = [(wire, peak) for wire, score in every if (peak := _peak(t, score, config)) is not None]
    best: tuple[float, int] | None = None
    for _, here in peaks:
        near = [(wire, peak) for wire, peak in peaks if abs(peak - here) <= config.agree_m]
        middle = float(np.median([peak for _, peak in near]))
        count = _phases([wire for wire, _ in near], junction.axis, middle, config)
        if best is None or count > best[1]:
            best = middle, count
    return best


def own_places(
    junction: Junction, photos: Photos, t0: float, body_y: float, config: EndSweepConfig
) -> tuple[tuple[float | None, ...], ...]:
    """Of the wires before and after a structure at t0, where each one is held near to it: pins stand before
    a pole, for one.  None where photos do not show it.

    body_y: of the structure's body, which hides what is before it and is no part of what holds the wires.
    """
    reach = config.own_m + config.beside_m + config.step_m
    t = np.arange(t0 - reach, t0 + reach + config.step_m / 2, config.step_m)
    found = []
    for wires in junction.sides:
        passing = [k for k, wire in enumerate(wires) if _passes(wire, junction.axis, t)]
        own: list[float | None] = [None] * len(wires)
        if passing:
            scores = _scores([wires[k] for k in passing], junction.axis, photos, t, config, body_y)
            for k, score in zip(passing, scores, strict=True):
                peak = _peak(t, score, config)
                own[k] = peak if peak is not None and abs(peak - t0) <= config.own_m else None
        found.append(tuple(own))
    return tuple(found)


def _scores(
    wires: Sequence[Wire],
    axis: Base,
    photos: Photos,
    t: Float[np.ndarray, " m"],
    config: EndSweepConfig,
    body_y: float | None = None,
) -> Float[np.ndarray, "w m"]:
    """Of each wire, by how much photos agree more on each plane than usual; NaN where too few show it."""
    places = [wire.points(crossing(wire, axis, t)) for wire in wires]
    middle = np.mean([one[len(t) // 2] for one in places], axis=0)
    near = _nearest(photos, axis, middle, config)
    if len(near) * (len(near) - 1) < 2 * config.min_pairs:
        return np.full((len(wires), len(t)), np.nan)
    pictures = [_picture(photos, i, middle, config) for i in near]
    every = np.array([axis.local(one)[:, 1:] for one in places])
    return np.array([_score(one, every, axis, pictures, config, body_y) for one in places])


def _passes(wire: Wire, axis: Base, t: Float[np.ndarray, " m"]) -> bool:
    """Whether a wire's curve, which may be a short piece's and steep, passes all planes."""
    with np.errstate(over="ignore", invalid="ignore"):
        return bool(np.isfinite(wire.points(crossing(wire, axis, t))).all())


def _nearest(photos: Photos, axis: Base, place: Float[np.ndarray, "3"], config: EndSweepConfig) -> list[int]:
    """The nearest photos that show a place well, along the line rather than across it."""
    apart = photos.distances(place[None])[:, 0]
    train = np.array(photos.train)
    ray = place - photos.cameras.centre.numpy()[train]
    steep = np.abs(ray[:, :2] @ axis.u) / np.linalg.norm(ray, axis=1)
    focal = photos.cameras.focal_px.numpy()[train, 0]
    good = (steep >= np.cos(np.radians(config.most_off_deg))) & (apart <= focal / config.least_px_per_m)
    order = np.argsort(np.where(good, apart, np.inf), kind="stable")[: min(config.photos, int(good.sum()))]
    return [int(i) for i in train[order]]


def _picture(photos: Photos, i: int, place: Float[np.ndarray, "3"], config: EndSweepConfig) -> Picture:
    """Photo i, reduced so that its pixels at a place are about as large as the samples."""
    cameras = photos.cameras
    apart = float(np.linalg.norm(place - cameras.centre[i].numpy()))
    reduced = max(1, round(float(cameras.focal_px[i, 0]) * config.sample_m / apart))
    longest_px = -(-int(cameras.size_px[i].max()) // reduced)
    return picture(photos, i, view_of(photos, i, longest_px), longest_px)[0]


def _score(
    places: Float[np.ndarray, "m 3"],
    every: Float[np.ndarray, "w m 2"],
    axis: Base,
    pictures: Sequence[Picture],
    config: EndSweepConfig,
    body_y: float | None = None,
) -> Float[np.ndarray, " m"]:
    """Of the wire that passes the planes at `places`.  every: y and z at which all wires pass them."""
    y = np.arange(-config.aside_m, config.aside_m + config.sample_m / 2, config.sample_m)
    z = np.arange(config.height_m[0], config.height_m[1] + config.sample_m / 2, config.sample_m)
    looks = [_patches(places, (z, y), one, axis, config) for one in pictures]
    total, pairs = np.zeros((len(z), len(y), len(places)), np.float32), np.zeros((1, 1, 1), np.int64)
    for one, other in combinations(looks, 2):
        if not config.parallax[0] <= np.linalg.norm(one.moves - other.moves) <= config.parallax[1]:
            continue
        both = _smooth(one.grey * other.grey, config) - one.mean * other.mean
        noise = config.noise**2
        alike = both / np.sqrt((one.variance + noise) * (other.variance + noise))
        seen = one.inside & other.inside
        total += np.where(seen, alike, 0)
        pairs = pairs + seen
    own = axis.local(places)[:, 1:]
    off = every - own  # w m 2
    away = np.hypot(y[:, None] - off[:, None, None, :, 0], z[:, None, None] - off[:, None, None, :, 1])
    enough = (pairs >= config.min_pairs) & (away >= config.clear_m).all(0)
    if body_y is not None:
        enough &= np.abs(y[:, None] + own[:, 0] - body_y) >= config.body_m
    alike = np.where(enough, total / np.maximum(pairs, 1), np.nan)
    score = np.full(len(places), np.nan)
    seen = enough.any(2)  # the samples that some plane shows
    if seen.any():
        usual = np.maximum(np.nanmedian(alike[seen], axis=1), config.usual)
        more = np.maximum(alike[seen] - usual[:, None] - config.above_usual, 0)
        here = enough.mean((0, 1)) >= config.least_seen
        score[here] = np.nansum(more[:, here], axis=0) / enough.sum((0, 1))[here]
    return score


def _patches(
    places: Float[np.ndarray, "m 3"],
    zy: tuple[Float[np.ndarray, " a"], Float[np.ndarray, " b"]],
    shown: Picture,
    axis: Base,
    config: EndSweepConfig,
) -> _Patches:
    view, n = shown.view, np.append(axis.n, 0.0)
    # Between nodes so near to each other pixels are linear to a fiftieth of one.
    (z, of_z), (y, of_y) = (_nodes(one) for one in zy)
    nodes = z[:, None, None, None] * UP + y[:, None, None] * n + places
    pixels = view.project(nodes.reshape(-1, 3))[0].reshape((*nodes.shape[:3], 2))
    before = ((nodes - view.centre) @ view.axis > 0).all((0, 1))
    pixels = np.einsum("ai,bj,ijmc->abmc", of_z, of_y, pixels, optimize=True)
    inside = before & ((pixels >= 0) & (pixels < (view.width, view.height))).all(-1)
    x, y = np.moveaxis((pixels - 0.5).astype(np.float32), -1, 0)
    flat = x.shape[0], x.shape[1] * x.shape[2]
    grey = cv2.remap(shown.grey.astype(np.float32), x.reshape(flat), y.reshape(flat), cv2.INTER_LINEAR)
    grey = grey.reshape(x.shape).astype(np.float32)
    column, row = pixels[inside].astype(int).T
    inside[inside] = shown.valid[row, column]
    mean = _smooth(grey, config)
    ray = places.mean(0) - view.centre
    moves = np.array([ray[:2] @ axis.n, ray[2]]) / (ray[:2] @ axis.u)
    return _Patches(grey, mean, np.maximum(_smooth(grey * grey, config) - mean * mean, 0), inside, moves)


def _nodes(places: Float[np.ndarray, " k"]) -> tuple[Float[np.ndarray, " j"], Float[np.ndarray, "k j"]]:
    """Every few of equidistant places, and the weights that interpolate linearly between these."""
    nodes = np.linspace(places[0], places[-1], max(2, round((places[-1] - places[0]) / NODES_M) + 1))
    away = np.abs(places[:, None] - nodes) / (nodes[1] - nodes[0])
    return nodes, np.maximum(1 - away, 0)


def _smooth(values: Float32[np.ndarray, "a b m"], config: EndSweepConfig) -> Float32[np.ndarray, "a b m"]:
    """Means over windows, plane by plane."""
    side = 2 * round(config.window_m / config.sample_m / 2) + 1
    parts = np.array_split(values, -(-values.shape[2] // MOST_CHANNELS), axis=2)
    smooth = [cv2.boxFilter(one, -1, (side, side), borderType=cv2.BORDER_REPLICATE) for one in parts]
    return np.concatenate([one.reshape(*values.shape[:2], -1) for one in smooth], 2, dtype=np.float32)


def _peak(t: Float[np.ndarray, " m"], score: Float[np.ndarray, " m"], config: EndSweepConfig) -> float | None:
    """Where the score is highest, weighed with its neighbours; None where that stands out little."""
    score = np.nan_to_num(score)
    away = np.abs(t - t[score.argmax()])
    elsewhere = score[away > config.beside_m].max(initial=0.0)
    if score.max() < max(config.least_score, config.distinct * elsewhere):
        return None
    near = away <= 1.5 * config.step_m
    return float(t[near] @ score[near] / score[near].sum())


def _phases(wires: Sequence[Wire], axis: Base, t: float, config: EndSweepConfig) -> int:
    """How many groups the wires make whose members are near to each other."""
    at = np.concatenate([wire.points(crossing(wire, axis, np.array([t]))) for wire in wires])
    apart = np.linalg.norm(at[:, None] - at, axis=-1)
    return int(connected_components(apart < config.apart_m)[0])
