"""Laws of the hanging wire: it passes through its ends, and closed forms agree with brute force."""

import math

import numpy as np
import pytest
from scipy.integrate import quad

from plnerf.errors import ConfigError
from plnerf.line.catenary import Catenary, hang

SPANS = [
    ((-20.0, 1.0, 9.0), (20.0, 4.0, 9.4), 1.4),
    ((0.0, 0.0, 0.0), (3.0, -4.0, 6.0), 2.5),  # steep: the lowest point lies outside the span
    ((5.0, 5.0, 30.0), (405.0, 5.0, 12.0), 0.02),  # nearly taut
    ((0.0, 0.0, 1.0), (10.0, 0.0, 1.0), 40.0),  # a deep loop
]


@pytest.mark.parametrize(("a", "b", "sag_m"), SPANS)
def test_a_hung_wire_ends_at_its_attachments_and_has_the_sag_asked_for(a, b, sag_m):
    curve = hang(a, b, sag_m)
    ends = curve.points(np.array([0.0, curve.span_m]))
    np.testing.assert_allclose(ends, [a, b], atol=1e-9)
    assert abs(curve.sag_m - sag_m) < 1e-9


@pytest.mark.parametrize(("a", "b", "sag_m"), SPANS)
def test_sag_is_the_greatest_drop_below_the_chord(a, b, sag_m):
    curve = hang(a, b, sag_m)
    s = np.linspace(0.0, curve.span_m, 200_001)
    chord = a[2] + (b[2] - a[2]) * s / curve.span_m
    drop = (chord - curve.heights(s)).max()
    assert curve.sag_m == pytest.approx(drop, rel=1e-6, abs=1e-9)


@pytest.mark.parametrize(("a", "b", "sag_m"), SPANS)
def test_length_is_the_integral_of_arc(a, b, sag_m):
    curve = hang(a, b, sag_m)

    def arc(s: float) -> float:
        return math.hypot(1.0, math.sinh((s - curve.s0_m) / curve.p_m))

    integral, _ = quad(arc, 0.0, curve.span_m, epsabs=1e-11, epsrel=1e-12, limit=200)
    assert curve.length_m == pytest.approx(integral, rel=1e-9)
    polygon = np.linalg.norm(np.diff(curve.polyline(0.01), axis=0), axis=1).sum()
    assert polygon <= curve.length_m * (1 + 1e-12)
    assert polygon == pytest.approx(curve.length_m, rel=1e-4)


def test_the_curve_has_constant_horizontal_tension():
    """p z'' = sqrt(1 + z'^2) is the equation of a wire under its own weight."""
    curve = hang(*SPANS[0])
    s, h = np.linspace(1.0, 39.0, 50), 1e-3
    below, here, above = (curve.heights(s + d) for d in (-h, 0.0, h))
    second, first = (above - 2 * here + below) / h**2, (above - below) / (2 * h)
    np.testing.assert_allclose(curve.p_m * second, np.sqrt(1 + first**2), rtol=1e-5)


def test_lowest_point_is_on_the_curve_and_below_its_neighbours():
    curve = hang(*SPANS[0])
    lowest = np.array(curve.lowest)
    np.testing.assert_allclose(curve.points(np.array([curve.s0_m]))[0], lowest, atol=1e-12)
    assert (curve.heights(np.array([curve.s0_m - 0.5, curve.s0_m + 0.5])) > lowest[2]).all()


@pytest.mark.parametrize("step_m", [0.25, 1.0])
def test_polyline_steps_are_no_longer_than_asked(step_m):
    for a, b, sag_m in SPANS:
        gaps = np.linalg.norm(np.diff(hang(a, b, sag_m).polyline(step_m), axis=0), axis=1)
        assert gaps.max() <= step_m


def test_more_tension_less_sag():
    a, b, _ = SPANS[0]
    sags = [Catenary(a, b, p).sag_m for p in (50.0, 100.0, 200.0, 1000.0)]
    assert sags == sorted(sags, reverse=True)


def test_a_wire_cannot_hang_upwards():
    with pytest.raises(ConfigError, match="sag must be greater than 0 m, got -1"):
        hang((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), -1.0)
