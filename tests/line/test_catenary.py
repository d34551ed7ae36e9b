"""Laws of the hanging wire: it passes through its ends, and closed forms agree with brute force."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from plnerf.errors import ConfigError
from plnerf.line.catenary import arc_length, heights, lowest, p_of_sag, sag, sag_at
from plnerf.line.ends import Attached
from plnerf.line.hang import hang

SPANS = [
    ((-20.0, 1.0, 9.0), (20.0, 4.0, 9.4), 1.4),
    ((0.0, 0.0, 0.0), (3.0, -4.0, 6.0), 2.5),  # steep: the lowest point lies outside the span
    ((5.0, 5.0, 30.0), (405.0, 5.0, 12.0), 0.02),  # nearly taut
    ((0.0, 0.0, 1.0), (10.0, 0.0, 1.0), 40.0),  # a deep loop
]


@pytest.mark.parametrize(("a", "b", "sag_m"), SPANS)
def test_a_hung_wire_ends_at_its_attachments_and_has_the_sag_asked_for(a, b, sag_m):
    wire = hang(a, b, sag_m)
    ends = wire.points(np.array([0.0, wire.base.length_m]))
    np.testing.assert_allclose(ends, [a, b], atol=1e-9)
    assert abs(wire.sag.value - sag_m) < 1e-9 and wire.sag.sigma == 0
    assert wire.span_m.value == pytest.approx(math.dist(a[:2], b[:2]), abs=1e-12)
    assert wire.p_m.value == pytest.approx(wire.plane[2], rel=1e-15) and wire.open is None
    for end, point, number in zip(wire.ends, (a, b), (1, 2), strict=True):
        assert isinstance(end, Attached) and end.structure == number and (end.point == point).all()


@pytest.mark.parametrize(("a", "b", "sag_m"), SPANS)
def test_sag_is_the_greatest_drop_below_the_chord(a, b, sag_m):
    wire = hang(a, b, sag_m)
    s = np.linspace(0.0, wire.base.length_m, 200_001)
    chord = a[2] + (b[2] - a[2]) * s / wire.base.length_m
    drop = chord - wire.at(s)[:, 1]
    assert wire.sag.value == pytest.approx(drop.max(), rel=1e-6, abs=1e-9)
    assert wire.sag_at_m == pytest.approx(s[drop.argmax()], abs=0.002 * wire.base.length_m)


@pytest.mark.parametrize(("a", "b", "sag_m"), SPANS)
def test_length_is_the_integral_of_arc(a, b, sag_m):
    wire = hang(a, b, sag_m)
    D, h, p = wire.plane
    x0 = lowest(D, h, p)[0]

    def arc(s: float) -> float:
        return math.hypot(1.0, math.sinh((s - x0) / p))

    integral, _ = quad(arc, 0.0, D, epsabs=1e-11, epsrel=1e-12, limit=200)
    assert wire.length_m == pytest.approx(integral, rel=1e-9) == arc_length(D, h, p)
    polygon = np.linalg.norm(np.diff(wire.polyline(0.01), axis=0), axis=1).sum()
    assert polygon <= wire.length_m * (1 + 1e-12)
    assert polygon == pytest.approx(wire.length_m, rel=1e-4)


def test_the_curve_has_constant_tension_across_the_load():
    """p z'' = sqrt(1 + z'^2) is the equation of a wire under its own weight."""
    D, h, p = hang(*SPANS[0]).plane
    x, step = np.linspace(1.0, 39.0, 50), 1e-3
    below, here, above = (heights(x + d, D, h, p) for d in (-step, 0.0, step))
    second, first = (above - 2 * here + below) / step**2, (above - below) / (2 * step)
    np.testing.assert_allclose(p * second, np.sqrt(1 + first**2), rtol=1e-5)


def test_lowest_point_is_on_the_curve_and_below_its_neighbours():
    D, h, p = hang(*SPANS[0]).plane
    x0, h0 = lowest(D, h, p)
    np.testing.assert_allclose(heights(np.array([x0]), D, h, p), h0, atol=1e-12)
    assert (heights(np.array([x0 - 0.5, x0 + 0.5]), D, h, p) > h0).all()


@pytest.mark.parametrize("step_m", [0.25, 1.0])
def test_polyline_steps_are_no_longer_than_asked(step_m):
    for a, b, sag_m in SPANS:
        gaps = np.linalg.norm(np.diff(hang(a, b, sag_m).polyline(step_m), axis=0), axis=1)
        assert gaps.max() <= step_m


def test_more_tension_less_sag():
    D, h, _ = hang(*SPANS[0]).plane
    sags = [sag(D, h, p) for p in (50.0, 100.0, 200.0, 1000.0)]
    assert sags == sorted(sags, reverse=True)


@given(st.floats(5, 800), st.floats(-0.8, 0.8), st.floats(-4, 0.5))
@settings(max_examples=100, deadline=None)
def test_p_and_sag_determine_each_other(D: float, slope: float, log_sag: float) -> None:
    """Over sags of a ten-thousandth to three times the span."""
    wanted = D * 10**log_sag
    p = p_of_sag(D, slope * D, wanted)
    assert sag(D, slope * D, p) == pytest.approx(wanted, rel=1e-9, abs=1e-9)
    assert 0 < sag_at(D, slope * D, p) < D


def test_a_wire_cannot_hang_upwards():
    with pytest.raises(ConfigError, match="sag must be greater than 0 m, got -1"):
        hang((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), -1.0)
