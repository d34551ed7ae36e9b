"""Two wires side by side, drawn as two passes see them: paired crosswise, they come to where they are."""

from dataclasses import replace

import numpy as np
import pytest
from tests.support.drawn import scene_of, two_passes
from tests.survey.test_refine import CONFIG as REFINE
from tests.survey.test_refine import PIXEL, hung, lit, off

from plnerf.errors import ConfigError
from plnerf.line.ends import TWO_SIDED_95
from plnerf.line.wire import Wire
from plnerf.survey.posed_photos import Photos, photos_of
from plnerf.survey.refine.config import CrossedConfig
from plnerf.survey.refine.crossed_pairs import Pair, _better, _differ, _moved, _pairs, uncrossed
from plnerf.survey.refine.refine import refine_wires

CONFIG = replace(REFINE, crossed=CrossedConfig(same_m=3 * PIXEL, alike_m=PIXEL))
TRUE = (hung(-0.05, 0.04), hung(0.05, 0.04))


@pytest.fixture(scope="module")
def photos(tmp_path_factory: pytest.TempPathFactory) -> Photos:
    cameras = two_passes(8, wobble=0.03)
    return photos_of(scene_of(tmp_path_factory.mktemp("drawn"), cameras, lit(cameras, *TRUE)))


def crossed(photos: Photos) -> list[Wire]:
    """One above the other, where the lines of sight to both cross as well."""
    (pair,) = _pairs(photos, TRUE, CONFIG.crossed)
    found = _moved(TRUE, [pair])
    one, other = (wire.at(np.array([1.0]))[0] for wire in found)
    assert abs(one[1] - other[1]) > 5 * PIXEL
    return found


def worst(wires: tuple[Wire, ...]) -> float:
    """In pixels, of both, whichever is which."""
    orders = ((0, 1), (1, 0))
    return min(max(np.abs(off(wires[k], TRUE[i])).max() for k, i in enumerate(order)) for order in orders)


@pytest.mark.slow
def test_pairs_come_to_the_corners_of_which_more_is_seen(photos: Photos) -> None:
    stuck = refine_wires(photos, crossed(photos), CONFIG)
    assert worst(stuck.wires) > 5
    assert worst(uncrossed(photos, stuck, CONFIG).wires) < 0.5


def test_other_corners_are_in_the_same_lines_of_sight(photos: Photos) -> None:
    """In every photo, either wire at its other corner hides one of the two."""
    s = np.linspace(0.2, 0.8, 7) * TRUE[0].base.length_m
    true, other = (np.array([wire.points(s) for wire in wires]) for wires in (TRUE, crossed(photos)))
    for eye in photos.cameras.centre.numpy()[list(photos.train)]:
        across, there = ((places - eye)[..., 1:] for places in (true, other))
        turns, turns_there = (np.arctan2(one[..., 0], one[..., 1]) for one in (across, there))
        off = np.abs(turns_there[:, None] - turns[None]) * np.linalg.norm(across, axis=-1)[None]
        assert off.min(1).max() < 3 * PIXEL  # the photos weave, so that no place is in all lines exactly


@pytest.mark.slow
def test_pairs_that_are_right_stay(photos: Photos) -> None:
    right = refine_wires(photos, TRUE, CONFIG)
    assert uncrossed(photos, right, CONFIG) is right


@pytest.mark.slow
def test_more_that_is_seen_counts_before_how_pairs_hang(photos: Photos) -> None:
    right, other = refine_wires(photos, TRUE, CONFIG), refine_wires(photos, crossed(photos), CONFIG)
    pair = Pair(0, 1, np.zeros((2, 6)))
    assert _better(right, other, pair, CONFIG.crossed) and not _better(other, right, pair, CONFIG.crossed)
    seen = replace(right, counts=(10, 10))
    assert not _better(seen, other, pair, CONFIG.crossed)
    assert not _better(right, right, pair, CONFIG.crossed)


@pytest.mark.slow
def test_pairs_that_photos_do_not_tell_from_the_others_hold_both(photos: Photos) -> None:
    unsure = replace(CONFIG, crossed=replace(CONFIG.crossed, least_more=1e3, least_unlike=1e3))
    for fit in (refine_wires(photos, TRUE, CONFIG), refine_wires(photos, crossed(photos), CONFIG)):
        found = uncrossed(photos, fit, unsure)
        for one, before in zip(found.wires, fit.wires, strict=True):
            assert np.array_equal(one.theta, before.theta) and "as well be" in one.notes[-1]
            away = min(np.linalg.norm(off(one, wire).mean(0)) * PIXEL for wire in TRUE)
            half = TWO_SIDED_95 * np.linalg.norm(one.sigma_at(np.array([0.9]))[0])
            assert away <= half <= 0.2


@pytest.mark.slow
def test_pairs_whose_other_corners_are_each_others_places_are_not_in_doubt(photos: Photos) -> None:
    """Where wires are above each other as one sees them from both sides, they only change their names."""
    right = refine_wires(photos, TRUE, CONFIG)
    swapped = replace(right, wires=right.wires[::-1], counts=right.counts[::-1])
    pair = Pair(0, 1, np.zeros((2, 6)))
    assert _differ(right, swapped, pair) == 0
    assert _differ(right, refine_wires(photos, crossed(photos), CONFIG), pair) > 5 * PIXEL


def test_photos_from_all_around_or_from_one_side_pair_none(photos: Photos) -> None:
    one_side = replace(photos, train=photos.train[:8])
    assert not _pairs(one_side, TRUE, CONFIG.crossed)
    assert not _pairs(photos, TRUE, replace(CONFIG.crossed, distinct=1e3))  # as if they filled the gap
    assert not _pairs(photos, TRUE[:1], CONFIG.crossed)
    assert not _pairs(photos, TRUE, replace(CONFIG.crossed, near_m=PIXEL))


def test_places_that_are_seen_from_one_side_each_tell_directions_together(photos: Photos) -> None:
    """As where a flight passes the one half of a span on the one side, and comes back along the other."""
    x = photos.cameras.centre.numpy()[:, 0]  # along the span; its first eight photos are the one pass
    halves = tuple(i for i in photos.train if (i < 8) == (x[i] < 0))
    assert len(_pairs(replace(photos, train=halves), TRUE, CONFIG.crossed)) == 1


def test_settings_that_make_no_sense_are_refused() -> None:
    with pytest.raises(ConfigError, match="least_more"):
        CrossedConfig(least_more=0.9)
