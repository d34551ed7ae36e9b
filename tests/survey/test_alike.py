"""Twins that lie at another vector than most of their span come to it, if they are seen there."""

from dataclasses import replace

import numpy as np
import pytest
from tests.support.drawn import scene_of, two_passes
from tests.survey.test_refine import CONFIG as REFINE
from tests.survey.test_refine import PIXEL, hung, lit, off

from plnerf.errors import ConfigError
from plnerf.survey.posed_photos import Photos, photos_of
from plnerf.survey.refine.alike import _unlike, _with, alike
from plnerf.survey.refine.config import CrossedConfig, RefineConfig
from plnerf.survey.refine.crossed_pairs import Pair, _moved, _pairs, uncrossed
from plnerf.survey.refine.refine import refine_wires
from plnerf.survey.refine.twins import side_by_side

CONFIG = replace(REFINE, crossed=CrossedConfig(near_m=0.12, same_m=3 * PIXEL, alike_m=PIXEL))
TRUE = tuple(hung(y, z, 0.04) for z in (0.04, 0.18, -0.1) for y in (-0.05, 0.05))
"""Three pairs, one above the other."""


@pytest.fixture(scope="module")
def photos(tmp_path_factory: pytest.TempPathFactory) -> Photos:
    cameras = two_passes(8, wobble=0.03)
    return photos_of(scene_of(tmp_path_factory.mktemp("drawn"), cameras, lit(cameras, *TRUE)))


def test_pairs_are_wires_that_are_each_others_nearest() -> None:
    s = np.linspace(0, TRUE[0].base.length_m, 5)
    places = np.array([wire.at(s) for wire in TRUE])
    assert side_by_side(places, 0.12) == ((0, 1), (2, 3), (4, 5))
    assert side_by_side(places[:3], 0.12) == ((0, 1),)
    assert side_by_side(places, 0.08) == () == side_by_side(places[:1], 1.0) == side_by_side(places[:0], 1.0)


def test_a_pair_at_another_vector_is_put_at_that_of_most() -> None:
    """About its own middle, whichever of its wires comes first."""
    two = replace(CONFIG.crossed, least_alike=2)
    turned = [hung(0.0, 0.04 + k * 0.05, 0.04) for k in (-1, 1)]
    for first, second in ((0, 1), (1, 0)):
        (pair,) = _unlike([turned[first], turned[second], *TRUE[2:]], two)
        assert (pair.one, pair.other) == (0, 1)
        found = [wire.theta for wire in TRUE[:2]]
        assert min(np.abs(pair.thetas - order).max() for order in (found, found[::-1])) < 1e-2 * PIXEL
    assert not _unlike([*turned, *TRUE[2:]], CONFIG.crossed)  # two of three say nothing
    assert not _unlike(TRUE, two) and not _unlike([], two) and not _unlike(TRUE[:1], two)


@pytest.mark.slow
def test_pairs_come_to_where_they_are_alike(photos: Photos) -> None:
    config: RefineConfig = replace(CONFIG, crossed=replace(CONFIG.crossed, least_alike=2))
    (pair, *_) = _pairs(photos, TRUE, config.crossed)
    stuck = refine_wires(photos, _moved(TRUE, [pair]), config)
    before = max(np.abs(off(one, true)).max() for one, true in zip(stuck.wires, TRUE, strict=True))
    found = alike(photos, stuck, config)
    orders = [(0, 1), (1, 0)]
    after = min(
        max(np.abs(off(found.wires[k], TRUE[i])).max() for k, i in enumerate(order)) for order in orders
    )
    assert before > 5 and after < 0.5
    assert alike(photos, found, config) is found and uncrossed(photos, found, config) is found


@pytest.mark.slow
def test_a_pair_of_which_less_is_seen_there_stays(photos: Photos) -> None:
    config = replace(CONFIG, crossed=replace(CONFIG.crossed, least_alike=2, as_much=1e3))
    (pair, *_) = _pairs(photos, TRUE, config.crossed)
    stuck = refine_wires(photos, _moved(TRUE, [pair]), config)
    assert alike(photos, stuck, config) is stuck


def test_settings_that_make_no_sense_are_refused() -> None:
    with pytest.raises(ConfigError, match="least_alike"):
        CrossedConfig(least_alike=1)
    with pytest.raises(ConfigError, match="as_much"):
        CrossedConfig(as_much=0.0)


@pytest.mark.slow
def test_some_pairs_are_taken_from_another_fit(photos: Photos) -> None:
    fit, other = refine_wires(photos, TRUE, CONFIG), refine_wires(photos, TRUE[::-1], CONFIG)
    found = _with(fit, other, [Pair(2, 3, np.zeros((2, 6)))])
    for k in range(len(TRUE)):
        taken = other if k in (2, 3) else fit
        assert (found.wires[k], found.counts[k]) == (taken.wires[k], taken.counts[k])
    assert found.widths == fit.widths
