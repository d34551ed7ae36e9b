"""Photos that say next to nothing of a span are left out of its refit, rare directions are not."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.support.drawn import FOCAL, HEIGHT, WIDTH, hanging, pinhole_cameras, scene_of

from plnerf.survey.posed_photos import Photos, photos_of
from plnerf.survey.refine.leverage import leverages, telling

WIRE = hanging(0.0, 0.1)
END_ON = 0.15
NEAR, FAR, ABOVE = range(8), range(8, 12), 12


@pytest.fixture
def photos(tmp_path: Path) -> Photos:
    """Eight near photos from one side, four far ones from there, and a far one from high above."""
    x = np.linspace(-0.6, 0.6, 8)
    near = np.stack([x, np.full(8, -0.45), np.full(8, 0.1)], 1)
    far = np.stack([x[::2], np.full(4, -9.0), np.full(4, 0.1)], 1)
    centres = np.concatenate([near, far, [[0.0, -1.0, 6.0]]])
    cameras = pinhole_cameras(centres, np.concatenate([near, far, [[0.0] * 3]]) * [1, 0, 0] + [0, 0, 0.1])
    blank = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    assert FOCAL < WIDTH  # the near ones see most of the wire
    return replace(photos_of(scene_of(tmp_path, cameras, [blank] * 13)), train=tuple(range(13)))


def test_leverages_are_shares_of_the_two_numbers_of_a_place(photos: Photos) -> None:
    share = leverages(photos, WIRE, END_ON)
    seen = share.sum(0) > 0
    assert share.shape == (13, len(seen)) and seen.sum() > 20
    assert share.sum(0)[seen] == pytest.approx(2, abs=0.02)


def test_the_far_ones_are_left_out_but_for_the_only_one_from_its_direction(photos: Photos) -> None:
    assert telling(photos, [WIRE], 0.005, END_ON).train == (*NEAR, ABOVE)
    assert telling(photos, [WIRE], 0.0, END_ON).train == photos.train
    assert leverages(photos, WIRE, END_ON)[ABOVE].max() > 0.9


def test_where_no_photo_says_anything_all_stay(photos: Photos) -> None:
    assert telling(photos, [WIRE], 0.005, 1.1).train == photos.train
