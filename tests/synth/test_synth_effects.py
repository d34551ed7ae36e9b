"""Laws of the camera's effects: without them nothing changes, and what they change is what they say."""

import numpy as np
import pytest

from plnerf.synth.effects import (
    FOLLOW,
    LUMINANCE,
    MID_GREY,
    READ_SHARE,
    exposure_drift,
    luminance,
    next_gain,
    sensor_noise,
    slow_drift,
    white_balance_drift,
)


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def test_without_drift_and_noise_a_picture_stays_as_it_is() -> None:
    picture = rng().random((6, 8, 3))
    np.testing.assert_array_equal(exposure_drift(9, 0.0, rng()), np.ones(9))
    np.testing.assert_array_equal(white_balance_drift(9, 0.0, rng()), np.ones((9, 3)))
    np.testing.assert_array_equal(sensor_noise(picture, 0.0, rng()), picture)


@pytest.mark.parametrize("level", [0.0, MID_GREY, 0.7])
def test_noise_has_the_variance_it_states_and_moves_no_mean(level: float) -> None:
    """200 000 values: the mean is known to 0.3 % of the deviation, the deviation to 0.2 %; 4 times that."""
    noisy = sensor_noise(np.full((200, 334, 3), level), 0.02, rng(3))
    deviation = 0.02 * np.sqrt((level + READ_SHARE) / (MID_GREY + READ_SHARE))
    assert noisy.mean() == pytest.approx(level, abs=0.012 * deviation)
    assert noisy.std() == pytest.approx(deviation, rel=0.01)
    halves = noisy - noisy.mean()
    assert abs((halves[:, :-1] * halves[:, 1:]).mean()) < 0.02 * deviation**2  # no memory


def test_mid_grey_has_the_noise_asked_for() -> None:
    noisy = sensor_noise(np.full((200, 334, 3), MID_GREY), 0.013, rng(4))
    assert noisy.std() == pytest.approx(0.013, rel=0.01)


def test_drifts_have_the_deviation_asked_for_and_are_slow() -> None:
    stops = np.log2(exposure_drift(72, 0.4, rng(5)))
    assert stops.mean() == pytest.approx(0.0, abs=1e-12)
    assert stops.std() == pytest.approx(0.4)
    assert np.abs(np.diff(stops)).max() < 0.4 / 2  # from one image to the next
    gains = white_balance_drift(72, 0.1, rng(6))
    assert np.log(gains[:, 0] / gains[:, 2]).std() == pytest.approx(0.1)
    np.testing.assert_array_equal(gains[:, 1], 1.0)
    np.testing.assert_array_equal(slow_drift(1, 0.4, rng()), np.zeros((1, 1)))


def test_drifts_are_the_generators_and_nothing_elses() -> None:
    np.testing.assert_array_equal(exposure_drift(20, 0.3, rng(1)), exposure_drift(20, 0.3, rng(1)))
    assert not np.allclose(exposure_drift(20, 0.3, rng(1)), exposure_drift(20, 0.3, rng(2)))


def test_automatic_exposure_comes_to_mid_grey_and_stays_there() -> None:
    gain = next_gain(None, 0.6)
    assert gain * 0.6 == pytest.approx(MID_GREY)
    assert next_gain(gain, 0.6) == pytest.approx(gain)
    off = []
    for _ in range(20):  # the scene turns darker: the camera follows, by the same share in every image
        gain = next_gain(gain, 0.05)
        off.append(np.log(MID_GREY / (gain * 0.05)))
    np.testing.assert_allclose(np.array(off[1:]) / off[:-1], 1 - FOLLOW)
    assert abs(off[-1]) < 1e-3


def test_luminance_is_a_mean_that_white_brings_to_one() -> None:
    assert LUMINANCE.sum() == pytest.approx(1.0)
    assert luminance(np.full((4, 5, 3), 0.37)) == pytest.approx(0.37)
    half = np.zeros((4, 6, 3))
    half[:, :3] = 1.0
    assert luminance(half) == pytest.approx(0.5)
