"""Ridges and their lack as odds: fair by chance, blind beside others' ridges, and as the definition says."""

import cv2
import numpy as np
import pytest
import torch
from scipy.ndimage import distance_transform_edt
from tests.support.drawn import two_passes

from plnerf.detect.claims import boxes_of
from plnerf.detect.config import FARTHEST_PX, OddsConfig
from plnerf.detect.line_ridges import HALF_TURN
from plnerf.detect.nearest import FARTHER, STEPS
from plnerf.detect.odds import (
    BLOCK,
    Odds,
    distances,
    forget,
    odds_of,
    pixels_of,
    place_odds,
    with_own_arrays,
)
from plnerf.detect.parabola import DirectedOdds, odds_along, odds_directed
from plnerf.detect.views import Views, lenses_of, project_point, views_of
from plnerf.scene.cameras import Cameras

CONFIG = OddsConfig()
MISSED = np.log(1 - CONFIG.shown)


def one_view(w: int, h: int) -> Views:
    """A camera at the origin that looks along +z, a pixel wide at distance w."""
    return Views(
        np.eye(3)[None], np.zeros((1, 3)), np.full((1, 2), float(w)), np.array([[w / 2, h / 2]]),
        np.zeros((1, 5)), np.array([[w, h]]), np.zeros(1, np.int64),
    )  # fmt: skip


def at_place(views: Views, odds: Odds, point: tuple[float, float, float], reach: float) -> tuple[float, int]:
    n = len(views.R)
    return place_odds(views, odds, lenses_of(views), point, reach, np.zeros(n, np.int32), np.zeros(n))


def at_pixels(views: Views, odds: Odds, columns: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Odds of the one view at pixels' middles, at their sharpest."""
    (w, h), out = views.sizes[0], []
    for u, v in zip(columns, rows, strict=True):
        point = ((u + 0.5 - w / 2) / w, (v + 0.5 - h / 2) / w, 1.0)
        total, seen = at_place(views, odds, point, 0.0)
        assert seen == 1
        out.append(total)
    return np.array(out)


@pytest.mark.parametrize(("share", "mean"), [(0.002, 0.85), (0.02, 1.0), (0.1, 1.0)])
def test_by_chance_nothing_is_won(share: float, mean: float) -> None:
    """exp(odds) is a ratio of likelihoods: over places without a conductor its mean is 1.

    Less where ridges are so rare that `min_density` makes each count for less.
    """
    rng = np.random.default_rng(0)
    views = one_view(400, 300)
    odds = odds_of((rng.random(400 * 300) < share).astype(np.float32), views, CONFIG)
    ratio = np.exp(at_pixels(views, odds, rng.integers(30, 370, 4000), rng.integers(30, 270, 4000)))
    assert ratio.mean() == pytest.approx(mean, abs=0.1)


def test_a_ridge_counts_most_where_there_are_few_and_its_lack_always_the_same() -> None:
    rng = np.random.default_rng(1)
    views = one_view(400, 100)
    responses = np.zeros((100, 400), np.float32)
    responses[:, 200:] = rng.random((100, 200)) < 0.1
    responses[50, 60] = responses[50, 320] = 1
    responses[44:57, 54:67] *= np.eye(13) > 2  # nothing else near the lonely one
    responses[50, 60] = 1
    odds = odds_of(responses.ravel(), views, CONFIG)
    lonely, crowded = at_pixels(views, odds, np.array([60, 320]), np.array([50, 50]))
    assert lonely == pytest.approx(np.log(CONFIG.shown / CONFIG.min_density + 1 - CONFIG.shown), abs=0.1)
    assert 0 < crowded < 0.6 * lonely
    assert at_pixels(views, odds, np.array([20, 100]), np.array([20, 80])) == pytest.approx([MISSED] * 2)


def without(odds: Odds, left: np.ndarray, others: np.ndarray, views: Views) -> Odds:
    """The odds where the ridges of some pixels of any view are other lines'."""
    again = with_own_arrays(odds)
    every = {n: (slice(0, int(h)), slice(0, int(w))) for n, (w, h) in enumerate(views.sizes)}
    forget(again, odds, left, others, views, CONFIG, every)
    return again


def test_beside_others_ridges_nothing_is_known() -> None:
    views = one_view(200, 100)
    responses = np.zeros((100, 200), np.float32)
    responses[50] = responses[70] = 1
    others = np.zeros((100, 200), bool)
    others[48:53] = True
    first = odds_of(responses.ravel(), views, CONFIG)
    left = np.where(others, 0, responses)
    odds = without(first, left.ravel(), others.ravel(), views)
    rows = np.array([50, 52 + CONFIG.muffled_px, 53 + CONFIG.muffled_px, 70, 90])
    before, after = (at_pixels(views, one, np.full(5, 100), rows) for one in (first, odds))
    assert before[0] > 1 and after[0] == 0 and after[1] == 0
    assert after[2] == before[2] == MISSED
    assert after[3] == before[3] > 1 and after[4] == MISSED


def test_what_others_muffle_is_a_drawn_disc() -> None:
    """Exactly round, it changes which of two wires that lie side by side is found."""
    views, others = one_view(60, 40), np.zeros((40, 60), np.uint8)
    others[[1, 20, 20], [2, 30, 33]] = 1
    first = odds_of(np.zeros(2400, np.float32), views, CONFIG)
    odds = without(first, np.zeros(2400, np.float32), others.ravel() > 0, views)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * CONFIG.muffled_px + 1,) * 2)
    assert ((odds.ridge.reshape(40, 60) == 0) == (cv2.dilate(others, disc) > 0)).all()


@pytest.mark.parametrize("ridges", [0.03, 0.0003])
def test_odds_of_what_did_not_change_are_those_of_before(ridges: float) -> None:
    views, rng = views_of(two_passes(4)), np.random.default_rng(5)
    responses = (rng.random(int(views.sizes.prod(1).sum())) < ridges).astype(np.float32)
    first, others = odds_of(responses, views, CONFIG), np.zeros(len(responses), bool)
    before = with_own_arrays(first)
    for views_changed in ([0, 2], [2, 5, 7]):
        boxes = {}
        for n in views_changed:
            part, shape = pixels_of(views, n)
            box = others[part].reshape(shape)[10:50, 20 + 5 * n : 70]
            box[:] = rng.random(box.shape) < 0.5
            boxes |= boxes_of(np.flatnonzero(others[part]) + part.start, views)
        left = np.where(others, np.float32(0), responses)
        whole = without(first, left, others, views)
        forget(before, first, left, others, views, CONFIG, boxes)
        assert (before.ridge == whole.ridge).all() and (before.free == whole.free).all()
        assert (whole.free != first.free).any() and (whole.ridge != first.ridge).any()


def test_distances_are_to_the_next_ridge_of_the_same_view() -> None:
    views = views_of(two_passes(2))
    sizes = views.sizes.prod(1)
    ridges = np.zeros(sizes.sum(), bool)
    ridges[views.starts[1] + 90 * 240 + 100] = True
    found = distances(ridges, views)
    assert (found[: sizes[0]] == 255).all()  # none: as far as can be
    picture = found[views.starts[1] : views.starts[1] + sizes[1]].reshape(180, 240)
    y, x = np.mgrid[:180, :240]
    away = np.hypot(x - 100, y - 90)
    assert (picture == np.where(away <= FARTHEST_PX, np.floor(STEPS * away + 1e-6), FARTHER)).all()


@pytest.mark.parametrize("share", [0.0005, 0.01, 0.3])
def test_distances_are_exact(share: float) -> None:
    views, rng = views_of(two_passes(1)), np.random.default_rng(3)
    ridges = rng.random(int(views.sizes.prod(1).sum())) < share
    found = distances(ridges, views)
    for n in range(len(views.sizes)):
        part, shape = pixels_of(views, n)
        away = distance_transform_edt(~ridges[part].reshape(shape))
        expected = np.where(away <= FARTHEST_PX, np.floor(STEPS * away + 1e-6), FARTHER)
        assert (found[part].reshape(shape) == expected).all()


def with_lens(cameras: Cameras) -> Cameras:
    lens = torch.tensor([-0.05, 0.02, 0.001, -0.002, 0.003]).repeat(len(cameras), 1)
    return Cameras(
        cameras.R_scene_camera, cameras.centre, cameras.focal_px, cameras.principal_px, lens, cameras.size_px
    )


@pytest.mark.parametrize("lens", [False, True])
def test_odds_of_a_place_are_what_the_views_see_there(lens: bool) -> None:
    cameras = two_passes(3)
    views = views_of(with_lens(cameras) if lens else cameras)
    rng = np.random.default_rng(2)
    responses = (rng.random(int(views.sizes.prod(1).sum())) < 0.03).astype(np.float32)
    others = rng.random(len(responses)) < 0.01
    left = np.where(others, np.float32(0), responses)
    odds = without(odds_of(responses, views, CONFIG), left, others, views)
    for x, y, z, reach in rng.uniform([-0.8, -0.2, -0.3, 0.0], [0.8, 0.2, 0.3, 0.02], (180, 4)):
        total, seen = at_place(views, odds, (x, y, z), reach)
        expected = by_definition(views, odds, (x, y, z), reach)
        assert total == pytest.approx(expected[0], abs=1e-6) and seen == expected[1]


def by_definition(
    views: Views, odds: Odds, point: tuple[float, float, float], reach: float
) -> tuple[float, int]:
    total, seen = 0.0, 0
    depths = [project_point(views, n, *point)[2] for n in range(len(views.R))]
    finest = max((views.focal[n, 0] / depth for n, depth in enumerate(depths) if depth > 0), default=0.0)
    needed = CONFIG.coarsest * min(finest, CONFIG.enough_px / max(reach, 1e-9))
    for n in range(len(views.R)):
        u, v, depth = project_point(views, n, *point)
        if depth < 0 or views.focal[n, 0] / depth < needed:
            continue
        seen += 1
        radius = max(reach * views.focal[n, 0] / depth, odds.sharp_px)
        radii = CONFIG.radii_px
        level = next((k for k, r in enumerate(radii) if r >= 0.7 * radius), len(radii) - 1)
        pixel = views.starts[n] + int(v) * views.sizes[n, 0] + int(u)
        block = odds.starts[n] + int(v) // BLOCK * odds.blocks[n] + int(u) // BLOCK
        if odds.free[pixel] <= STEPS * radius:
            total += odds.shown[level, block]
        elif odds.ridge[pixel] > STEPS * radius:
            total += MISSED
    return total, seen


def test_what_is_too_far_away_to_show_a_wire_does_not_speak_against_it() -> None:
    """One view from 1 away has a ridge, nine from `far` have none."""
    for far, counted in ((0.9 / CONFIG.coarsest, 10), (1.1 / CONFIG.coarsest, 1)):
        near, w = one_view(64, 48), 64
        back = np.array([[0.0, 0.0, -far + 1.0]] * 9)
        views = Views(
            np.repeat(near.R, 10, 0), np.concatenate([near.centre, back]), np.repeat(near.focal, 10, 0),
            np.repeat(near.principal, 10, 0), np.zeros((10, 5)), np.repeat(near.sizes, 10, 0),
            w * 48 * np.arange(10),
        )  # fmt: skip
        responses = np.zeros(10 * w * 48, np.float32)
        responses[24 * w + 32] = 1
        odds = odds_of(responses, views, CONFIG)
        point = (0.5 / w, 0.5 / w, 1.0)
        total, seen = at_place(views, odds, point, 0.0)
        assert seen == counted and (total > 1) == (counted == 1)
        # Within a reach of many pixels of the nearest, those from afar resolve enough.
        assert at_place(views, odds, point, CONFIG.enough_px / 16)[1] == 10


DIRECTED = DirectedOdds(np.radians(5.0), shown=0.9, chance=0.3, end_on=0.15)


def ridge_along_a_line(tangent: int, slope: float = 0.0) -> tuple[Views, Odds, np.ndarray, np.ndarray]:
    """One view of a line at its middle row, with a ridge of one tangent on it; planes, and its curve."""
    views = one_view(400, 100)
    responses, tangents = np.zeros((100, 400), np.float32), np.full(40_000, tangent, np.uint8)
    x = np.linspace(-0.2, 0.2, 9)
    columns = np.arange(100, 300)
    responses[(50 + slope * (columns - 200)).astype(int), columns] = 1
    return views, odds_of(responses.ravel(), views, CONFIG), tangents, x


@pytest.mark.parametrize(
    ("tangent", "runs"), [(0, True), (6, True), (-6 % HALF_TURN, True), (12, False), (128, False)]
)
def test_a_ridge_counts_for_a_curve_by_the_way_it_runs(tangent: int, runs: bool) -> None:
    """By how much likelier a wire's ridge runs so than another's: 6 steps of 256 are 4 degrees."""
    views, odds, tangents, x = ridge_along_a_line(tangent)
    curve = np.array([0.0, 0.0, 1.0, 1.0, 0.0, 0.0])
    plain = odds_along(views, odds, curve, x, 0.0)
    turned = odds_directed(views, odds, tangents, curve, x, DIRECTED)
    np.testing.assert_array_equal(turned[:, 1], plain[:, 1])
    factor = 0.9 / 0.3 if runs else 0.1 / 0.7
    hidden = 1 - CONFIG.shown
    np.testing.assert_allclose(np.exp(turned[:, 0]) - hidden, factor * (np.exp(plain[:, 0]) - hidden))
    beside = curve + np.array([0.05, 0.05, 0, 0, 0, 0])  # 20 px below
    np.testing.assert_allclose(odds_directed(views, odds, tangents, beside, x, DIRECTED)[:, 0], MISSED)


def test_a_curve_runs_as_its_image_does() -> None:
    """Seen from before it: a slope in the image, not in space."""
    slope = 0.2
    tangent = round(np.arctan(slope) * HALF_TURN / np.pi)
    views, odds, tangents, x = ridge_along_a_line(tangent, slope)
    ends = slope * x[[0, -1]] + 0.5 / 400
    curve = np.array([*ends, 1.0, 1.0, 0.0, 0.0])
    level = np.zeros_like(tangents)
    totals = [odds_directed(views, odds, one, curve, x, DIRECTED)[:, 0].sum() for one in (tangents, level)]
    assert totals[0] > odds_along(views, odds, curve, x, 0.0)[:, 0].sum() > totals[1]


def test_a_curve_that_runs_at_the_camera_has_no_way_to_run_in_its_image() -> None:
    views, odds, tangents, x = ridge_along_a_line(128)
    ahead = np.array([[[0.0, 0, 1], [0, 1, 0], [1, 0, 0]]])
    views = views._replace(R=ahead, centre=np.array([[-1.0, 0, 1]]))
    curve = np.array([0.0, 0.01, 1.0, 1.0, 0, 0])
    one = odds_directed(views, odds, tangents, curve, x, DIRECTED)
    np.testing.assert_allclose(one, odds_along(views, odds, curve, x, 0.0))
    assert one[:, 1].all() and one[:, 0].max() > 1
