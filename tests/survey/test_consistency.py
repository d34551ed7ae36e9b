"""The consistency filter: points that one image alone, or one pair, has are dropped."""

import numpy as np

from plnerf.survey.stereo.config import ConsistencyConfig
from plnerf.survey.stereo.consistency import consistent


def kept_of(points: np.ndarray, image: np.ndarray, radius: np.ndarray) -> np.ndarray:
    return consistent(points, image, radius, ConsistencyConfig())


def test_things_that_four_images_show_are_kept_of() -> None:
    random = np.random.default_rng(0)
    wall = np.column_stack([random.uniform(0, 4, (3000, 2)), random.normal(0, 0.02, 3000)])
    speck = np.array([[2.0, 2.0, 1.5]]) + random.normal(size=(9, 3)) * 0.02
    points = np.concatenate([wall, speck])
    image = np.concatenate([random.integers(0, 8, 3000), np.full(9, 5)])
    radius = np.full(len(points), 0.3)
    kept = kept_of(points, image, radius)
    assert kept[:3000].mean() > 0.99 and not kept[3000:].any()
    image[3000:3003] = [1, 2, 3]  # and 5
    assert kept_of(points, image, radius)[3000:].all()
    # Two images are one pair's mistake.
    image[3000:3009] = [1, 2, 1, 2, 1, 2, 1, 2, 1]
    assert not kept_of(points, image, radius)[3000:].any()


def test_few_points_and_none_support_nothing() -> None:
    assert kept_of(np.zeros((0, 3)), np.zeros(0, int), np.zeros(0)).shape == (0,)
    assert not kept_of(np.eye(3), np.array([0, 1, 1]), np.full(3, 9.0)).any()
    assert kept_of(np.eye(4)[:, :3], np.arange(4), np.full(4, 9.0)).all()


def test_support_must_be_supported_itself() -> None:
    """A chain whose last link alone has enough: it falls apart from its ends."""
    points = np.array([[x, 0.0, 0.0] for x in range(5)])
    image = np.array([0, 1, 2, 3, 0])
    assert not kept_of(points, image, np.full(5, 2.5)).all()
    assert not kept_of(points, image, np.full(5, 1.5)).any()
