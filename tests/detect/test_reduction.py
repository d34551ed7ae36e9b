"""Blocks keep the strongest response with its sign; pixels beyond the image's edge are none."""

import numpy as np
import pytest

from plnerf.detect.reduction import mean_of_blocks, reduction, strongest_of_blocks, tiles, valid_blocks


def test_a_block_keeps_what_is_farthest_from_zero() -> None:
    values = np.array([[1, -3, 0, 0, 5], [2, 2, 0, -1, -6]], np.float32)
    np.testing.assert_array_equal(strongest_of_blocks(values, 2), [[-3, -1, -6]])
    np.testing.assert_array_equal(strongest_of_blocks(values, 3), [[-3, -6]])
    assert strongest_of_blocks(values, 1) is values


def test_a_block_is_valid_if_all_its_pixels_are() -> None:
    valid = np.ones((4, 5), np.bool_)
    valid[1, 1] = False
    np.testing.assert_array_equal(valid_blocks(valid, 2), [[False, True, True], [True, True, True]])


@pytest.mark.parametrize(
    ("size", "most", "k"), [((480, 320), 1280, 1), ((1280, 900), 1280, 1), ((4000, 2667), 1280, 4)]
)
def test_the_longer_side_decides(size: tuple[int, int], most: int, k: int) -> None:
    assert reduction(size, most) == reduction(size[::-1], most) == k


def test_a_mean_has_the_shape_of_the_blocks_and_their_light() -> None:
    image = np.zeros((5, 7, 3), np.uint8)
    image[:, 4:] = 100
    small = mean_of_blocks(image, 4)
    assert small.shape == (2, 2, 3)
    np.testing.assert_array_equal(small[..., 0], [[0, 100], [0, 100]])


def test_tiles_cover_every_pixel_once() -> None:
    count = np.zeros((70, 45), int)
    for tile in tiles(count.shape, 32, 8):
        count[tile.inner] += 1
        inner = np.zeros_like(count)
        inner[tile.outer][tile.within] = 1
        expected = np.zeros_like(count)
        expected[tile.inner] = 1
        np.testing.assert_array_equal(inner, expected)
    assert (count == 1).all()
