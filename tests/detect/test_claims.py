"""Lines take ridges and give them back; the odds know of the others' what they would know anew."""

import numpy as np
from tests.support.drawn import two_passes

from plnerf.detect.claims import Claims, around_both, boxes_of, pixels_along
from plnerf.detect.config import OddsConfig
from plnerf.detect.odds import odds_of
from plnerf.detect.views import Views, project_point, views_of

CONFIG = OddsConfig()
ALONG = np.array([0.0, 0.0, 0.1, 0.1, 0.05, 0.0])
ASIDE = np.array([0.2, 0.2, 0.1, 0.1, 0.05, 0.0])
X = np.linspace(-0.8, 0.8, 2000)


def some_ridges(views: Views) -> np.ndarray:
    return (np.random.default_rng(3).random(int(views.sizes.prod(1).sum())) < 0.01).astype(np.float32)


def claims_of(views: Views, responses: np.ndarray) -> Claims:
    return Claims(views, responses, odds_of(responses, views, CONFIG), CONFIG)


def alike(one: Claims, other: Claims) -> bool:
    arrays = [(claims.left, claims.masks, claims.odds.ridge, claims.odds.free) for claims in (one, other)]
    return all((a == b).all() for a, b in zip(*arrays, strict=True))


def test_the_pixels_along_a_curve_are_those_about_its_points() -> None:
    views = views_of(two_passes(3))
    pixels = pixels_along(views, ALONG, X, 2)
    assert (np.diff(pixels) > 0).all()
    true = np.zeros(int(views.sizes.prod(1).sum()), bool)
    for s, x in zip(np.linspace(0, 1, len(X)), X, strict=True):
        for n, (w, h) in enumerate(views.sizes):
            z = 0.1 - 0.05 * 4 * s * (1 - s)
            u, v, depth = project_point(views, n, x, 0.0, z)
            if depth > 0:
                picture = true[views.starts[n] : views.starts[n] + w * h].reshape(h, w)
                picture[max(0, int(v) - 2) : int(v) + 3, max(0, int(u) - 2) : int(u) + 3] = True
    assert np.array_equal(pixels, np.flatnonzero(true)) and len(pixels) > 500


def test_what_is_given_back_is_as_it_was() -> None:
    views = views_of(two_passes(3))
    responses = some_ridges(views)
    first, claims = claims_of(views, responses), claims_of(views, responses)
    one, other = (pixels_along(views, theta, X, 3) for theta in (ALONG, ASIDE))
    claims.take(one)
    claims.update()
    assert not alike(claims, first) and not claims.left[one].any()
    claims.take(other)
    claims.give_back(one)
    claims.update()
    anew = claims_of(views, responses)
    anew.take(other)
    anew.update()
    assert alike(claims, anew)
    claims.give_all_back()
    claims.update()
    assert alike(claims, first)


def test_a_pixel_of_two_lines_is_left_when_both_gave_it_back() -> None:
    views = views_of(two_passes(3))
    responses = some_ridges(views)
    claims = claims_of(views, responses)
    line = pixels_along(views, ALONG, X, 3)
    for _ in range(2):
        claims.take(line)
    claims.update()
    claims.give_back(line)
    claims.update()
    assert not claims.left[line].any()
    claims.give_back(line)
    claims.update()
    assert (claims.left == responses).all()


def test_what_was_handed_in_stays_as_it_is() -> None:
    views = views_of(two_passes(3))
    responses = some_ridges(views)
    odds = odds_of(responses, views, CONFIG)
    before = [part.copy() for part in (responses, odds.ridge, odds.free)]
    claims = Claims(views, responses, odds, CONFIG)
    claims.take(pixels_along(views, ALONG, X, 3))
    claims.update()
    assert all((a == b).all() for a, b in zip(before, (responses, odds.ridge, odds.free), strict=True))


def test_odds_learn_of_a_sharper_radius_with_the_next_update() -> None:
    views = views_of(two_passes(2))
    claims = claims_of(views, some_ridges(views))
    usual = claims.odds.sharp_px
    claims.sharpen(usual / 2)
    assert claims.odds.sharp_px == usual
    claims.update()
    assert claims.odds.sharp_px == claims.sharp_px == usual / 2
    claims.blur(usual)
    assert claims.odds.sharp_px == usual


def test_boxes_hold_the_pixels_of_their_views() -> None:
    views = views_of(two_passes(2))
    (w, _), start = views.sizes[2], int(views.starts[2])
    pixels = start + np.array([3 * w + 7, 4 * w + 2, 9 * w + 5])
    boxes = boxes_of(pixels, views)
    assert boxes == {2: (slice(3, 10), slice(2, 8))}
    assert around_both(boxes[2], (slice(0, 4), slice(5, 30))) == (slice(0, 10), slice(2, 30))
