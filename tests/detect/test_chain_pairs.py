"""Chains that no plane through both cameras shows in both views are no pair, and meet nowhere."""

import cv2
import numpy as np
from tests.support.drawn import HALF, hanging, polyline, two_passes

from plnerf.detect.chain_pairs import pairs_that_may_meet
from plnerf.detect.chains import Chains, chains_of
from plnerf.detect.config_lines import ChainConfig
from plnerf.detect.meets import meets, partners
from plnerf.detect.views import Views, project_point, views_of

CONFIG = ChainConfig()
LOW, HIGH = np.full(2, -0.5), np.full(2, 0.5)


def cluttered(views: Views) -> Chains:
    """Four wires, and twenty lines in each view that no other shows, as if they did not cross."""
    rng = np.random.default_rng(2)
    parts = []
    for y in (-0.2, -0.07, 0.1, 0.24):
        out, wire = np.zeros(int(views.sizes.prod(1).sum()), np.float32), polyline(hanging(y, 0.05), 300)
        for n in range(len(views.R)):
            seen = [project_point(views, n, *point) for point in wire]
            at = np.array([(int(u), int(v)) for u, v, depth in seen if depth > 0])
            cv2.polylines(picture_of(out, views, n), [at.reshape(-1, 1, 2)], False, 1.0)
        parts.append(chains_of(out, views, 0.5, CONFIG))
    for _ in range(20):
        out = np.zeros_like(out)
        for n, (w, h) in enumerate(views.sizes):
            begin, turn = rng.uniform((0, 0), (w, h)), rng.uniform(0, np.pi)
            end = begin + 60 * np.array([np.cos(turn), np.sin(turn)])
            ends = [tuple(int(v) for v in one) for one in (begin, end)]
            cv2.line(picture_of(out, views, n), *ends, 1.0)
        parts.append(chains_of(out, views, 0.5, CONFIG))
    return together(parts, len(views.R))


def picture_of(out: np.ndarray, views: Views, n: int) -> np.ndarray:
    (w, h), start = views.sizes[n], views.starts[n]
    return out[start : start + w * h].reshape(h, w)


def together(parts: list[Chains], views: int) -> Chains:
    owner, along, bend, ends = (
        np.concatenate([getattr(part, name) for part in parts]) for name in ("owner", "along", "bend", "ends")
    )
    order = np.argsort(owner, kind="stable")
    first = np.searchsorted(owner[order], np.arange(views + 1))
    return Chains(owner[order], along[order], bend[order], ends[order], first)


def test_no_two_chains_that_meet_are_left_out() -> None:
    views = views_of(two_passes(5))
    chains = cluttered(views)
    chosen = partners(views, (-HALF, *LOW), (HALF, *HIGH), CONFIG)
    every = np.array([
        (a, b)
        for n, others in enumerate(chosen)
        for other in others[others >= 0]
        for a in range(chains.first[n], chains.first[n + 1])
        for b in range(chains.first[other], chains.first[other + 1])
    ])  # fmt: skip
    curves = np.full((len(every), 6), np.nan)
    limits = (CONFIG.least_angle, CONFIG.spare, CONFIG.least_length)
    shape = (CONFIG.max_askew, CONFIG.max_slope, CONFIG.max_sag, CONFIG.bend_prior)
    meets(chains, views, every, (-HALF, HALF), (-0.5, 0.5, -0.5, 0.5), limits, shape, curves, 0, len(every))
    meeting = {tuple(pair) for pair in every[np.isfinite(curves[:, 0])].tolist()}
    kept = [tuple(pair) for pair in pairs_that_may_meet(chains, views, chosen, CONFIG.spare).tolist()]
    assert len(meeting) > 50 and meeting <= set(kept)
    assert len(kept) < 0.6 * len(every)
    order = {tuple(pair): k for k, pair in enumerate(every.tolist())}
    places = [order[pair] for pair in kept]
    assert places == sorted(places)


def test_views_without_partners_or_chains_have_no_pairs() -> None:
    views = views_of(two_passes(3))
    chains = cluttered(views)
    none = np.full((len(views.R), 4), -1)
    assert pairs_that_may_meet(chains, views, none, 0.2).shape == (0, 2)
    empty = chains_of(np.zeros(int(views.sizes.prod(1).sum()), np.float32), views, 0.5, CONFIG)
    chosen = partners(views, (-HALF, *LOW), (HALF, *HIGH), CONFIG)
    assert pairs_that_may_meet(empty, views, chosen, 0.2).shape == (0, 2)
