"""How far obstacles reach between their points: half a spacing, whatever the points are of."""

from dataclasses import replace

import numpy as np
import pytest
from tests.support.catenary_surveys import cloud

from plnerf.errors import ConfigError
from plnerf.survey.config_ground import SamplingConfig
from plnerf.survey.sampling import end_sigma_m, sampling_sigma_m

CONFIG = SamplingConfig(
    point_m=1e-9, share=1.0, surface_share=1.0, bar_share=1.0, max_spacing_m=5.0, reach_m=6.0
)


def lattice(dimensions: int, step_m: float) -> np.ndarray:
    """Points of a bar, a surface or a crown, the middle one at 0."""
    one = step_m * np.arange(-4, 5)
    axes = [one if k < dimensions else np.zeros(1) for k in range(3)]
    return np.stack([axis.ravel() for axis in np.meshgrid(*axes)], 1)


ALONG, UP = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])


def sigma(xyz: np.ndarray, towards: np.ndarray | None = None, *, crown: bool = False) -> float:
    middle = int(np.linalg.norm(xyz, axis=1).argmin())
    return sampling_sigma_m(xyz, np.arange(len(xyz)), middle, CONFIG, crown=crown, towards=towards)


@pytest.mark.parametrize("towards", [None, ALONG])
@pytest.mark.parametrize(("dimensions", "crown"), [(1, False), (2, False), (3, False), (3, True)])
def test_the_spacing_is_that_of_the_points(
    dimensions: int, crown: bool, towards: np.ndarray | None
) -> None:
    assert sigma(lattice(dimensions, 0.5), towards, crown=crown) == pytest.approx(0.5, rel=0.3)


def test_between_points_beside_each_other_as_seen_from_the_wire_nothing_is_nearer() -> None:
    for dimensions in (1, 2):
        assert sigma(lattice(dimensions, 0.5), UP) < 1e-6
        slanting = sigma(lattice(dimensions, 0.5), (ALONG + UP) / np.sqrt(2))
        assert slanting == pytest.approx(sigma(lattice(dimensions, 0.5), ALONG) / np.sqrt(2), rel=0.01)


def test_a_crown_s_tip_counts_as_spread_in_space() -> None:
    """A beam rarely meets it: points above one another do not show how far it reaches."""
    xyz = lattice(1, 0.3)
    bar, tip = sigma(xyz), sigma(xyz, crown=True)
    assert bar == pytest.approx(0.3, rel=0.01) and tip > 2 * bar


def test_the_points_of_a_surface_show_its_shape() -> None:
    xyz, index, usual = lattice(2, 0.5), np.arange(81), SamplingConfig()
    roof, plant = (sampling_sigma_m(xyz, index, 40, usual, crown=crown) for crown in (False, True))
    assert usual.point_m < roof < plant / 2
    few = sampling_sigma_m(xyz, index[:6], 0, usual, crown=False)
    assert few > usual.share * usual.max_spacing_m


def test_few_points_are_the_least_certain() -> None:
    xyz = lattice(2, 0.5)
    few, none = (sampling_sigma_m(xyz, np.arange(n), 0, CONFIG, crown=False) for n in (6, 1))
    assert few == none == 5.0
    assert sampling_sigma_m(xyz, np.arange(9), 0, SamplingConfig(), crown=False) > SamplingConfig().point_m


def test_plants_of_images_are_as_uncertain_as_their_points_and_their_spacing() -> None:
    """The twig that is nearest lies between points, however well each is known; the ground does not."""
    xyz = lattice(3, 0.5)
    middle, index = int(np.linalg.norm(xyz, axis=1).argmin()), np.arange(len(xyz))
    points = replace(cloud({5: xyz}), sigma_m=np.full(len(xyz), 0.3))
    groups = ("vegetation", "ground")
    plant, ground = (end_sigma_m(points, index, middle, CONFIG, group=one, towards=UP) for one in groups)
    assert ground == pytest.approx(0.3)
    assert plant == pytest.approx(np.linalg.norm([0.3, CONFIG.leaves_m, sigma(xyz, crown=True)]))
    low = replace(cloud({3: xyz}), sigma_m=np.full(len(xyz), 0.3))
    bush = end_sigma_m(low, index, middle, CONFIG, group="vegetation", towards=UP)
    assert bush == pytest.approx(np.hypot(0.3, sigma(xyz, crown=True)))


def test_settings_that_measure_nothing_are_refused() -> None:
    with pytest.raises(ConfigError, match="3 neighbours or more"):
        SamplingConfig(neighbours=2)
    with pytest.raises(ConfigError, match="above 0"):
        SamplingConfig(share=0.0)
