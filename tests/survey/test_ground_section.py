"""The height of the ground under a wire scatters as its stated deviation says."""

import numpy as np

from plnerf.line.hang import hang
from plnerf.survey.config_ground import GroundSectionConfig
from plnerf.survey.ground_section import ground_under


def test_heights_scatter_as_stated() -> None:
    """Of points that scatter about a plane, ten in a square metre; the wire runs at an angle to it."""
    wire, random = hang((0.0, 0.0, 20.0), (40.0, 9.0, 22.0), 1.0), np.random.default_rng(1)
    at = np.linspace(5.0, 36.0, 40)
    off, stated = [], []
    for _ in range(12):
        xy = random.uniform((-10.0, -12.0), (52.0, 22.0), (20_000, 2))
        z = 0.1 * xy[:, 0] - 0.05 * xy[:, 1] + 0.05 * random.normal(size=len(xy))
        found, sigma = ground_under(
            wire, at, np.column_stack([xy, z]), np.arange(len(xy)), None, GroundSectionConfig()
        )
        off.append(found - wire.points(at)[:, :2] @ [0.1, -0.05])
        stated.append(sigma)
    ratio = np.sqrt(np.mean(np.square(off)) / np.mean(np.square(stated)))
    assert 0.9 < ratio < 1.1, "not as of one cell, nor of the edge between two, but within three"


def test_a_plant_alone_in_unseen_ground_is_not_stated_as_sure() -> None:
    """Flat ground with a hole of 4 m radius below the wire, in which nothing but the top of a bush of 0.8 m
    was measured, exactly: all that is near agrees, and is wrong."""
    wire, random = hang((0.0, 0.0, 20.0), (40.0, 0.0, 20.0), 1.0), np.random.default_rng(1)
    xy = random.uniform((-10.0, -10.0), (50.0, 10.0), (12_000, 2))
    away = np.linalg.norm(xy - [20.0, 0.0], axis=1)
    kept, bush = (away > 4.0) | (away < 0.4), away < 0.4
    points = np.column_stack([xy, np.where(bush, 0.8, 0.0)])[kept]
    at = np.array([10.0, 20.0])
    z, sigma = ground_under(wire, at, points, np.arange(len(points)), None, GroundSectionConfig())
    assert np.abs(z - [0.0, 0.8]).max() < 0.01
    assert sigma[0] < 0.01
    assert 0.8 / 3 < sigma[1] < 0.8
