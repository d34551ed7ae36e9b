"""Spherical rectification: rows of a pair match, disparities are distances, and no pair is stretched."""

from dataclasses import replace

import numpy as np
import pytest
from tests.survey.test_stereo import row_of_cameras, taken, views_of

from plnerf.survey.stereo.config import MatchConfig
from plnerf.survey.stereo.pair import match_pair
from plnerf.survey.stereo.rectify import Sphere, angles, axes_about, disparity_at, inverse_distance_at
from plnerf.survey.stereo.stereo_views import Picture, View

RANDOM = np.random.default_rng(5)


def pair(towards: list[float]) -> tuple[View, View, float, np.ndarray]:
    """Two views, the second one moved, their baseline, and the axes of their grid."""
    one = views_of(row_of_cameras())[0]
    other = replace(one, centre=one.centre + np.array(towards))
    b = float(np.linalg.norm(towards))
    return one, other, b, axes_about(np.array(towards) / b, one.axis + other.axis)


@pytest.mark.parametrize("towards", [[0.2, 0.0, 0.0], [0.0, 0.1, 0.2], [0.1, 0.3, -0.1], [-0.2, 0.0, 0.05]])
def test_a_point_has_one_azimuth_and_its_disparity_is_its_distance(towards: list[float]) -> None:
    one, other, b, R = pair(towards)
    points = (
        one.centre
        + RANDOM.uniform(0.5, 8.0, (200, 1))
        * one.rays()[::20, ::20].reshape(-1, 3)[:200][RANDOM.integers(0, 108, 200)]
    )
    seen = []
    for view in (one, other):
        rays = points - view.centre
        seen.append(angles((rays / np.linalg.norm(rays, axis=1, keepdims=True)).T, R))
    (left, row), (right, same) = seen
    assert row == pytest.approx(same, abs=1e-9) and (left >= right).all()
    t = np.linalg.norm(points - one.centre, axis=1)
    assert 1 / inverse_distance_at(left - right, left, b) == pytest.approx(t, rel=1e-6)
    for k in range(0, 200, 20):
        here = slice(k, k + 1)
        assert disparity_at(float(t[k]), left[here], b) == pytest.approx((left - right)[here], abs=1e-9)


def test_a_grid_shows_each_direction_where_the_image_shows_it() -> None:
    """The column of a pixel, drawn as grey values, arrives where the pixel's two angles are."""
    one, _, _, R = pair([0.1, 0.05, 0.02])
    columns = np.broadcast_to(np.arange(one.width, dtype=np.uint8), (one.height, one.width))
    per_rad = np.full(2, one.pixels_per_rad)
    at = np.stack(angles(np.moveaxis(one.rays(), -1, 0), R), -1) * per_rad
    low, high = np.floor(at.min((0, 1))) - 4, np.ceil(at.max((0, 1))) + 4
    size = (int(high[0] - low[0]), int(high[1] - low[1]))
    grey, valid = Sphere(R, per_rad, low, size).resampled(Picture(one, columns, np.ones_like(columns, bool)))
    column, row = np.floor(at - low).astype(int)[8:-8:5, 8:-8:5].reshape(-1, 2).T
    assert np.abs(grey[row, column] - columns[8:-8:5, 8:-8:5].ravel().astype(float)).max() <= 1.0
    assert valid[row, column].all() and not valid[:2].any() and not valid[:, :2].any()


def test_directions_beyond_a_lens_are_not_valid() -> None:
    """The polynomial of this lens folds back: it maps directions far outside into the image again."""
    one = replace(views_of(row_of_cameras())[0], distortion=np.array([-0.3, 0.0, 0.0, 0.0, 0.0]))
    whole = Picture(one, np.zeros((one.height, one.width), np.uint8), np.ones((one.height, one.width), bool))
    R = axes_about(np.array([1.0, 0, 0]), one.axis)
    wide = Sphere(R, np.full(2, 100.0), np.array([-140.0, -140.0]), (280, 280))
    _, valid = wide.resampled(whole)
    share = valid.sum() / 100.0**2 / (one.width * one.height / one.pixels_per_rad**2)
    assert 0.9 < share < 1.25  # columns by elevation take more than their share of the sphere


@pytest.fixture
def grids(monkeypatch: pytest.MonkeyPatch) -> list[tuple[int, int]]:
    """Columns and rows of every grid that is resampled."""
    sizes: list[tuple[int, int]] = []
    resampled = Sphere.resampled

    def counted(sphere: Sphere, one: Picture) -> object:
        sizes.append(sphere.size)
        return resampled(sphere, one)

    monkeypatch.setattr(Sphere, "resampled", counted)
    return sizes


@pytest.mark.parametrize("turn_deg", [0.0, 20.0, 35.0])
def test_oblique_pairs_are_matched_at_about_as_many_pixels_as_the_images_have(
    turn_deg: float, grids: list[tuple[int, int]]
) -> None:
    """The partner stands ahead of the image at the side, as along a line that is flown along."""
    one = views_of(row_of_cameras())[0]
    towards = np.cos(np.radians(turn_deg)) * np.array([1.0, 0, 0]) + np.sin(np.radians(turn_deg)) * one.axis
    other = replace(one, centre=one.centre + 0.05 * towards)
    match_pair(taken(one), taken(other), 1.5, MatchConfig())
    assert max(columns * rows for columns, rows in grids) < 2 * one.width * one.height


def test_nothing_is_searched_nearer_than_the_baseline_allows(grids: list[tuple[int, int]]) -> None:
    one, other, *_ = pair([0.2, 0.0, 0.0])
    config = MatchConfig()
    limit = 0.2 / config.max_parallax / config.nearest
    for near in (2 * limit, limit, limit / 50):
        match_pair(taken(one), taken(other), near, config)
    far, at, nearer = (grids[k][0] for k in (0, 2, 4))
    assert far < at == nearer


def test_what_the_partner_does_not_show_is_not_matched(grids: list[tuple[int, int]]) -> None:
    """The partner looks 40 degrees further up, so that two thirds of the rows have no match."""
    one, other, *_ = pair([0.2, 0.0, 0.0])
    c, s = np.cos(np.radians(40)), np.sin(np.radians(40))
    up = replace(other, R_line_camera=other.R_line_camera @ np.array([[1, 0, 0], [0, c, -s], [0, s, c]]))
    w = match_pair(taken(one), taken(other), 1.5, MatchConfig())[0].w
    cropped = match_pair(taken(one), taken(up), 1.5, MatchConfig())[0].w
    assert grids[2][1] < 0.5 * grids[0][1]
    assert np.isfinite(w[120:]).any() and not np.isfinite(cropped[120:]).any()


def test_pixels_per_radian_are_those_of_the_solid_angle() -> None:
    """Of a pinhole: 4 arctan(a b / sqrt(1 + a^2 + b^2)) for half sides a and b on the plane z = 1."""
    one = views_of(row_of_cameras())[0]
    a, b = one.width / 2 / one.focal_px[0], one.height / 2 / one.focal_px[1]
    angle = 4 * np.arctan(a * b / np.sqrt(1 + a**2 + b**2))
    assert one.pixels_per_rad == pytest.approx(np.sqrt(one.width * one.height / angle), rel=1e-3)
