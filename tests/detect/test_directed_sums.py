"""Averages along lines, in the directions that each pixel may have."""

import cv2
import numpy as np
import pytest

from plnerf.detect.directed_sums import average_along

APART_RAD, HALF_PX = 0.06, 20.0


def drawn(angle_deg: float, shape: tuple[int, int] = (90, 120)) -> np.ndarray:
    """A line of two pixels through the middle of a picture."""
    h, w = shape
    rows, columns = np.mgrid[:h, :w] + 0.5
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    away = np.abs((rows - h / 2) * c - (columns - w / 2) * s)
    return np.clip(1.5 - away, 0, 1).astype(np.float32)


def spread(picture: np.ndarray, low_deg: float, high_deg: float) -> tuple[np.ndarray, np.ndarray]:
    ends = (np.full(picture.shape, np.float32(np.radians(end))) for end in (low_deg, high_deg))
    return average_along(picture, *ends, APART_RAD, HALF_PX)


@pytest.mark.parametrize("angle_deg", [-100, -44, 0, 7, 45, 46, 88, 92, 135, 179, 260])
def test_a_line_has_its_average_and_its_direction(angle_deg: float) -> None:
    picture = drawn(angle_deg)
    average, direction = spread(picture, angle_deg - 14, angle_deg + 11)
    middle = average[44:46, 59:61]
    assert 0.8 <= middle.max() <= 1.0  # its pixels are not all in the middle of the line
    off = (direction[45, 60] - np.radians(angle_deg) + np.pi / 2) % np.pi - np.pi / 2
    assert abs(off) <= 0.7 * APART_RAD


def test_the_direction_nearest_to_a_single_one_counts() -> None:
    average, direction = spread(drawn(30), 30, 30)
    assert average[45, 60] > 0.85
    assert abs(direction[45, 60] - np.radians(30)) <= APART_RAD / 2 + 1e-6


def test_directions_that_are_not_allowed_do_not_count() -> None:
    picture = drawn(20)
    average, direction = spread(picture, 60, 100)
    assert average[45, 60] < 0.2
    assert np.radians(60) - APART_RAD <= direction[45, 60] <= np.radians(100) + APART_RAD


def test_each_pixel_has_directions_of_its_own() -> None:
    picture = np.maximum(drawn(0), drawn(90))
    angle = np.zeros(picture.shape, np.float32)
    angle[:, 60:] = np.pi / 2
    average, direction = average_along(picture, angle - 0.05, angle + 0.05, APART_RAD, HALF_PX)
    assert average[45, 30] > 0.9
    assert average[45, 90] < 0.2  # a line across the only direction that it may have
    assert average[10, 60] > 0.9
    assert direction[45, 30] % np.pi == pytest.approx(0, abs=0.1)
    assert direction[10, 60] == pytest.approx(np.pi / 2, abs=0.1)


def test_dark_lines_have_negative_averages() -> None:
    average, _ = spread(-drawn(70), 50, 90)
    assert average[45, 60] < -0.8


def test_a_line_cut_off_by_the_border_is_averaged_over_its_part_in_the_picture() -> None:
    average, _ = spread(drawn(0), -10, 10)
    assert average[45, 0] == pytest.approx(average[45, 60], rel=0.05)
    corner = np.zeros((90, 120), np.float32)
    corner[0, 0] = 1.0
    average, _ = spread(corner, 30, 60)
    assert average[0, 0] <= 1 / HALF_PX * 1.5  # and a few pixels are no line


def test_a_turned_picture_gives_turned_averages() -> None:
    picture = np.random.default_rng(0).normal(size=(64, 64)).astype(np.float32)
    average, _ = spread(picture, 10, 60)
    turned, _ = spread(np.ascontiguousarray(np.rot90(picture)), -80, -30)
    np.testing.assert_allclose(np.rot90(average), turned, atol=1e-5)


@pytest.mark.parametrize("step", [0, 5, 9, 23, 28, 40, 55])
def test_what_is_even_along_a_line_is_its_own_average(step: int) -> None:
    """Slopes and parabolas across the line are kept, but for what linear interpolation adds to a parabola."""
    angle = step * np.pi / 56  # one of the directions
    rows, columns = np.mgrid[:90, :120].astype(float)
    flat = angle < np.pi / 4 or angle > 3 * np.pi / 4
    across = rows - columns * np.tan(angle) if flat else columns - rows / np.tan(angle)
    inner = np.s_[24:-24, 24:-24]
    for power, more in ((1, 0.0), (2, 0.25)):
        picture = (1 + (across - across.min()) ** power).astype(np.float32)
        ends = np.full(picture.shape, np.float32(angle))
        average, _ = average_along(picture, ends, ends, APART_RAD, HALF_PX)
        off = (average - picture)[inner]
        slack = 2e-5 * picture.max()
        assert off.min() >= -slack and off.max() <= more + slack


def test_all_directions_may_be_allowed() -> None:
    picture = cv2.GaussianBlur(np.random.default_rng(0).normal(size=(50, 70)), (0, 0), 1).astype(np.float32)
    once, _ = spread(picture, 0, 180)
    twice, _ = spread(picture, -180, 180)
    np.testing.assert_array_equal(once, twice)
