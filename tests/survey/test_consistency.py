"""What one image's depths show alone is no thing."""

import numpy as np

from plnerf.survey.stereo.consistency import confirmed


def test_things_that_four_images_show_are_confirmed() -> None:
    random = np.random.default_rng(0)
    wall = np.column_stack([random.uniform(0, 4, (3000, 2)), random.normal(0, 0.02, 3000)])
    speck = np.array([[2.0, 2.0, 1.5]]) + random.normal(size=(9, 3)) * 0.02
    points = np.concatenate([wall, speck])
    image = np.concatenate([random.integers(0, 8, 3000), np.full(9, 5)])
    radius = np.full(len(points), 0.3)
    kept = confirmed(points, image, radius)
    assert kept[:3000].mean() > 0.99 and not kept[3000:].any()
    image[3000:3003] = [1, 2, 3]  # and 5
    assert confirmed(points, image, radius)[3000:].all()
    # Two images are one pair's mistake.
    image[3000:3009] = [1, 2, 1, 2, 1, 2, 1, 2, 1]
    assert not confirmed(points, image, radius)[3000:].any()


def test_few_points_and_none_confirm_nothing() -> None:
    assert confirmed(np.zeros((0, 3)), np.zeros(0, int), np.zeros(0)).shape == (0,)
    assert not confirmed(np.eye(3), np.array([0, 1, 1]), np.full(3, 9.0)).any()
    assert confirmed(np.eye(4)[:, :3], np.arange(4), np.full(4, 9.0)).all()


def test_company_must_be_confirmed_itself() -> None:
    """A chain whose last link alone has enough: it falls apart from its ends."""
    points = np.array([[x, 0.0, 0.0] for x in range(5)])
    image = np.array([0, 1, 2, 3, 0])
    assert not confirmed(points, image, np.full(5, 2.5)).all()
    assert not confirmed(points, image, np.full(5, 1.5)).any()
