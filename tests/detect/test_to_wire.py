"""A wire is what the fit says, with its uncertainty, in the unit of the line's frame."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from tests.support.drawn import FRAMES, two_passes

from plnerf.detect.candidate import Candidate
from plnerf.detect.config import CertaintyConfig
from plnerf.detect.to_wire import (
    certain_stretch,
    is_known,
    known_ends,
    sigmas_along,
    transport_matrix,
    typical_footprint,
    usual_sigma,
    wire_of,
    worst_sigma,
)
from plnerf.detect.views import views_of
from plnerf.detect.windows import Window
from plnerf.line.curve import LEAST_BEND_M
from plnerf.line.frame import LineFrame
from plnerf.line.wire import Wire

CONFIG = CertaintyConfig()
PLAIN = Window(np.zeros(3), 0.0, 1.0, np.full(2, -1.0), np.full(2, 1.0), np.arange(1), 96)
"""A window whose frame is the scene's."""
NUMBERS = st.floats(-1, 1)
UPRIGHT = st.tuples(NUMBERS, NUMBERS, NUMBERS, NUMBERS, st.floats(0, 0.2), st.just(0.0)).map(np.array)
THETAS = st.tuples(NUMBERS, NUMBERS, NUMBERS, NUMBERS, st.floats(0.001, 0.2), st.floats(-0.1, 0.1)).map(
    np.array
)
SHARES = st.tuples(st.floats(0, 0.4), st.floats(0.5, 1.0))
PLANES = 9
X = np.linspace(-0.8, 0.9, PLANES)


def by_definition(theta: np.ndarray, s: np.ndarray) -> np.ndarray:
    """y and z of the fit's letters at s of the way from the first plane to the last."""
    y_A, y_B, z_A, z_B, b, d = theta
    y, z = y_A + (y_B - y_A) * s, z_A + (z_B - z_A) * s
    return np.stack([y + 4 * d * s * (1 - s), z - 4 * b * s * (1 - s)], -1)


def a_covariance(seed: int, size: float = 0.01) -> np.ndarray:
    part = size * np.random.default_rng(seed).normal(size=(6, 6))
    return part @ part.T


def a_wire(
    theta: np.ndarray,
    covariance: np.ndarray,
    ends: tuple[int, int] = (0, PLANES - 1),
    footprint: float = 0.001,
    scale: float = 1.0,
    seen: tuple[int, int] = (0, PLANES - 1),
    window: Window = PLAIN,
) -> Wire:
    """In a metric scene of so many scene units per metre."""
    candidate = Candidate(theta, covariance, 0.4, 17, 900.0, seen)
    frame = LineFrame.of_scene(replace(FRAMES, scale=scale))
    return wire_of(candidate, ends, window, X, footprint, frame, CONFIG)


@given(THETAS, st.floats(-3.1, 3.1), st.floats(0.1, 30.0), st.floats(0.01, 2.0))
@settings(deadline=None)
def test_a_wire_of_a_turned_window_is_where_the_window_has_it(
    theta: np.ndarray, azimuth_rad: float, half: float, scale: float
) -> None:
    window = replace(PLAIN, origin=np.array([0.3, -2.0, 1.5]), azimuth_rad=azimuth_rad, half=half)
    wire = a_wire(theta, np.eye(6) * 1e-6, scale=scale, window=window)
    ends = wire.points(np.array([0.0, wire.base.length_m])) * scale
    wanted = np.concatenate([X[[0, -1], None], by_definition(theta, np.array([0.0, 1.0]))], 1)
    np.testing.assert_allclose(window.of_scene(ends), wanted, atol=1e-7)  # of a flat wire: cosh of 1e-8


@given(THETAS, SHARES)
@settings(deadline=None)
def test_transport_keeps_the_parabola(theta: np.ndarray, ends: tuple[float, float]) -> None:
    low, high = ends
    t = np.linspace(0, 1, 9)
    moved = transport_matrix(low, high) @ theta
    np.testing.assert_allclose(
        by_definition(moved, t), by_definition(theta, low + t * (high - low)), atol=1e-12
    )
    np.testing.assert_allclose(transport_matrix(0.0, 1.0), np.eye(6), atol=1e-15)


@given(UPRIGHT, st.integers(0, 3), st.integers(5, 8), st.floats(0.01, 2.0))
@example(np.array([0.0, 0, 1, 0, 0, 0]), 0, 5, 0.01)  # straight: its lowest point is as far as p is long
@settings(deadline=None)
def test_a_wire_goes_where_the_fit_says(theta: np.ndarray, first: int, last: int, scale: float) -> None:
    """Its ends exactly; its bend is that of a catenary whose sag is the parabola's."""
    wire = a_wire(theta, np.eye(6) * 1e-6, (first, last), scale=scale)
    x = X[[first, last]]
    ends = wire.points(np.array([0.0, wire.base.length_m])) * scale
    np.testing.assert_allclose(ends[:, 0], x, atol=1e-12)
    np.testing.assert_allclose(ends[:, 1:], by_definition(theta, (x - X[0]) / (X[-1] - X[0])), atol=1e-9)
    share = (x[1] - x[0]) / (X[-1] - X[0])
    sag, length = wire.drop_between(0.0, wire.base.length_m), wire.base.length_m
    askew = np.hypot(length, wire.theta[1] - wire.theta[0]) / length
    least = LEAST_BEND_M * askew**2  # no wire bends less, in the plane in which it hangs
    assert sag == pytest.approx(theta[4] * share**2 / scale, rel=1e-6, abs=1e-6 + least)
    assert wire.swing_rad == 0


def test_a_flat_wire_is_the_parabola_within_its_thickness() -> None:
    """A sag of 2 % of the length: the catenary of the same b departs by less than 0.1 % of the sag."""
    theta = np.array([0.1, 0.11, 0.2, 0.21, 0.034, 0.0])
    wire, s = a_wire(theta, np.eye(6) * 1e-6), np.linspace(0, 1, 30)
    apart = np.abs(wire.at(s * wire.base.length_m) - by_definition(theta, s))
    assert apart.max() < 1e-3 * theta[4]


def test_a_wire_is_cut_to_where_it_is_certain_over_half_of_it() -> None:
    """Known to 1 cm in its middle, and the less the farther from there."""
    covariance, x = np.diag([1e-4, 1e-4, 1e-4, 1e-4, 0.0, 0.0]), np.linspace(-1, 1, 41)
    spread = transport_matrix(-20.0, 21.0)  # from the stretch in which the ends are known so well
    candidate = Candidate(np.zeros(6), spread @ covariance @ spread.T, 0.3, 9, 900.0, (0, 40))
    cut = certain_stretch(candidate, (0, 40), x, 1e-4, 1.0, CONFIG)
    assert 0 < cut[0] == 40 - cut[1] and is_known(candidate, cut, x, 1e-4, 1.0, CONFIG)
    assert not is_known(candidate, (cut[0] - 1, cut[1] + 1), x, 1e-4, 1.0, CONFIG)
    known = replace(candidate, covariance=covariance)
    assert certain_stretch(known, (3, 30), x, 1e-4, 1.0, CONFIG) == (3, 30)
    nowhere = replace(candidate, covariance=np.eye(6))
    assert certain_stretch(nowhere, (3, 30), x, 1e-4, 1.0, CONFIG) == (3, 30)


def test_a_wire_that_wind_swings_hangs_in_a_turned_plane() -> None:
    """15 degrees, to either side; how sure y and z are is what the fit says of its two parts."""
    for turn in np.radians([15.0, -15.0]):
        theta = np.array([0.1, 0.11, 0.2, 0.21, 0.05 * np.cos(turn), 0.05 * np.sin(turn)])
        wire, s = a_wire(theta, np.diag([0.0, 0.0, 0.0, 0.0, 4.0, 1.0]) * 1e-6), np.linspace(0, 1, 30)
        assert wire.swing_rad == pytest.approx(turn)
        assert np.abs(wire.at(s * wire.base.length_m) - by_definition(theta, s)).max() < 1e-3 * 0.05
        (middle,) = wire.sigma_at(np.array([wire.base.length_m / 2]))
        assert middle == pytest.approx([0.001, 0.002], rel=0.01)


@pytest.mark.slow
@given(st.integers(0, 1000), THETAS)
@settings(max_examples=10, deadline=None)
def test_sigma_is_the_spread_where_and_whither_it_is_largest(seed: int, theta: np.ndarray) -> None:
    """Against many curves drawn from the covariance, in all directions across."""
    covariance, (low, high) = a_covariance(seed), (0.2, 0.9)
    T = transport_matrix(low, high)
    drawn = np.random.default_rng(seed).multivariate_normal(theta, covariance, 20_000)
    angle = np.linspace(0, np.pi, 60)
    across = np.stack([np.cos(angle), np.sin(angle)])
    spread = max((by_definition(drawn.T, at) @ across).std(0).max() for at in np.linspace(low, high, 20))
    assert worst_sigma(T @ covariance @ T.T) == pytest.approx(spread, rel=0.03)


@given(st.integers(0, 1000))
@settings(deadline=None)
def test_a_longer_wire_is_no_more_certain(seed: int) -> None:
    covariance = a_covariance(seed)
    T = [transport_matrix(0.5 - half, 0.5 + half) for half in (0.005, 0.25, 0.5, 0.75)]
    sigmas = [worst_sigma(one @ covariance @ one.T) for one in T]
    assert all(a <= 1.01 * b for a, b in pairwise(sigmas))


@given(st.integers(0, 1000), st.floats(1e-5, 0.1), st.floats(0.01, 2.0))
@settings(deadline=None)
def test_reach_covers_the_uncertainty_and_some_pixels(seed: int, footprint: float, scale: float) -> None:
    covariance = a_covariance(seed)
    evidence = a_wire(np.zeros(6), covariance, footprint=footprint, scale=scale).evidence
    sigma = worst_sigma(covariance)
    reach = max(CONFIG.reach_sigmas * sigma, CONFIG.reach_px * footprint)
    assert evidence.reach_m == pytest.approx(reach / scale)
    enough = max(CONFIG.certain_px * footprint / scale, CONFIG.certain_m)
    assert evidence.certain == (usual_sigma(covariance) / scale <= enough)


@given(st.integers(0, 1000), st.floats(1e-4, 0.1))
@settings(deadline=None)
def test_a_wire_is_drawn_out_as_far_as_its_place_is_certain(seed: int, footprint: float) -> None:
    covariance, seen, ends = a_covariance(seed), (3, 5), (1, 8)
    candidate = Candidate(np.zeros(6), covariance, 0.4, 17, 900.0, seen)
    low, high = known_ends(candidate, ends, X, footprint, CONFIG)
    known = sigmas_along(covariance, np.linspace(0, 1, PLANES)) <= CONFIG.certain_px * footprint
    assert 1 <= low <= 3 and 5 <= high <= 8  # what was seen stays
    assert known[low:3].all() and known[6 : high + 1].all()
    assert low == 1 or not known[low - 1]
    assert high == 8 or not known[high + 1]


def test_the_wire_itself_states_the_same_uncertainty() -> None:
    """By the derivatives of its own curve."""
    theta = np.array([0.1, 0.11, 0.2, 0.21, 0.034, 0.006])
    covariance = np.diag([1.0, 2.0, 3.0, 1.5, 0.7, 0.3]) * 1e-6
    assert a_wire(theta, covariance, scale=0.05).worst_sigma() == pytest.approx(
        worst_sigma(covariance) / 0.05, rel=1e-3
    )


def test_evidence_is_where_it_was_seen_between_its_ends() -> None:
    theta, step = np.array([0.0, 0.0, 0.0, 0.0, 0.1, 0.0]), X[1] - X[0]
    evidence = a_wire(theta, np.eye(6) * 1e-6, (1, 7), scale=0.5, seen=(3, 8)).evidence
    assert (evidence.source, evidence.count) == ("17 images", 17)
    assert evidence.coverage == pytest.approx(4 / 6)
    assert evidence.longest_gap_m == pytest.approx(2 * step / 0.5)
    assert evidence.seen_m == (pytest.approx((2 * step / 0.5, 6 * step / 0.5)),)


def test_the_footprint_is_that_of_the_nearest_views() -> None:
    """Of level passes beside a straight wire: their distance over the focal length, whoever is farther."""
    cameras = two_passes(8, distance=0.45, wobble=0.0)
    views = views_of(cameras)
    straight = np.array([0.0, 0.0, 0.05, 0.05, 0.0, 0.0])
    x = np.linspace(-0.7, 0.7, 50)
    found = typical_footprint(views, straight, x, CONFIG)
    assert 0.45 / 150 < found < 1.1 * 0.45 / 150
    all_views = typical_footprint(views, straight, x, replace(CONFIG, nearest_views=1.0))
    assert all_views > 1.3 * found
