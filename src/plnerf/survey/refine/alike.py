"""Bundles of a span whose twins lie unlike those of all others.

All bundles of a span are alike: their spacers are of one type.  Where most of its pairs of twins lie at one
vector from one another, and a pair lies at another, its images may have been paired crosswise
(`crossed_pairs.py`), or one of its wires may have strayed to what runs beside it.  Such a pair is fitted
again from the others' vector, about its own middle: the middle is the same for both corners of the
parallelogram that lines of sight make.  It stays there if about as much is seen of it.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from plnerf.line.wire import Wire
from plnerf.survey.posed_photos import Photos
from plnerf.survey.refine.config import CrossedConfig, RefineConfig
from plnerf.survey.refine.crossed_pairs import BY_THETA, SHARES, Pair, refitted, seen_of
from plnerf.survey.refine.refine import Refinement
from plnerf.survey.refine.twins import side_by_side

MIDDLE = len(SHARES) // 2


def alike(photos: Photos, refined: Refinement, config: RefineConfig) -> Refinement:
    """The wires of a span, those pairs that were unlike most of its pairs at the others' vector where about
    as much is seen of them there.

    refined: of the span, on one common base; photos: those that show it, at their full size.
    """
    pairs = _unlike(refined.wires, config.crossed)
    if not pairs:
        return refined
    moved = refitted(photos, refined, pairs, config)
    least = config.crossed.as_much
    back = [pair for pair in pairs if seen_of(moved, pair) < least * seen_of(refined, pair)]
    return refined if len(back) == len(pairs) else _with(moved, refined, back)


def _with(one: Refinement, other: Refinement, pairs: Sequence[Pair]) -> Refinement:
    """One fit with some pairs as another has them."""
    take = {k for pair in pairs for k in (pair.one, pair.other)}
    each = [other if k in take else one for k in range(len(one.wires))]
    return replace(
        one,
        wires=tuple(fit.wires[k] for k, fit in enumerate(each)),
        shown=tuple(fit.shown[k] for k, fit in enumerate(each)),
        counts=tuple(fit.counts[k] for k, fit in enumerate(each)),
        distinct=tuple(fit.distinct[k] for k, fit in enumerate(each)),
    )


def _unlike(wires: Sequence[Wire], config: CrossedConfig) -> list[Pair]:
    """Pairs that lie at another vector than most, each with its curves at theirs."""
    if not wires:
        return []
    s = SHARES * wires[0].base.length_m
    places = np.array([wire.at(s) for wire in wires])
    pairs = side_by_side(places, config.near_m)
    apart = np.array([_signed(places[j] - places[i]) for i, j in pairs]).reshape(len(pairs), len(s), 2)
    like = _like(apart, config.same_m)
    if len(pairs) == 0 or like.sum(1).max() < max(config.least_alike, len(pairs) / 2):
        return []
    most = like[like.sum(1).argmax()]
    common = np.median(apart[most], axis=0)
    found = []
    for (i, j), own, same in zip(pairs, apart, most, strict=True):
        if not same:
            middle, sign = (places[i] + places[j]) / 2, np.sign((own * (places[j] - places[i])).sum())
            found.append(Pair(i, j, np.array([_through(middle + k * sign * common / 2) for k in (-1, 1)])))
    return found


def _signed(apart: Float[np.ndarray, "k 2"]) -> Float[np.ndarray, "k 2"]:
    """From either twin to the other, so that it points across the base where it is level, else up."""
    y, z = apart[MIDDLE]
    return apart if (y if abs(y) > abs(z) else z) > 0 else -apart


def _like(apart: Float[np.ndarray, "p k 2"], same_m: float) -> np.ndarray:
    """Which pairs lie at one vector: at most of their places."""
    return np.median(np.linalg.norm(apart[:, None] - apart, axis=3), axis=2) <= same_m


def _through(places: Float[np.ndarray, "k 2"]) -> Float[np.ndarray, "6"]:
    """theta of the curve through y and z at SHARES."""
    (y_a, y_b, y), (z_a, z_b, z) = np.linalg.lstsq(BY_THETA, places, rcond=None)[0].T
    return np.array([y_a, y_b, z_a, z_b, np.hypot(y, z), np.arctan2(y, -z)])
