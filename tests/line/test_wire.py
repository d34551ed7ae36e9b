"""Laws of a wire of six parameters: against brute force, rotation, finite differences and sampling."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from plnerf.line.base import Base, base_of
from plnerf.line.curve import transport
from plnerf.line.ends import Attached, Evidence, Open, Quantity
from plnerf.line.wire import Wire

ENDS = (Attached(1, np.zeros(3), 0.0), Attached(2, np.zeros(3), 0.0))


Numbers = tuple[list[float], list[float], list[float]]
"""Both ends of the base, and theta."""


@st.composite
def numbers(draw: st.DrawFn, swings: bool = True) -> Numbers:
    """Of spans of 10 to 800 m in any direction, level to steep, taut to slack, upright to far swung."""
    L, azimuth = draw(st.floats(10, 800)), draw(st.floats(-3.2, 3.2))
    share = st.floats(-0.05, 0.05)
    y_A, y_B = draw(share) * L, draw(share) * L
    z_A = draw(st.floats(0, 100))
    z_B = z_A + draw(st.floats(-0.8, 0.8)) * L
    b = L * 10 ** draw(st.floats(-3.5, -0.7))
    phi = draw(st.floats(-0.8, 0.8)) if swings else 0.0
    a = [draw(st.floats(-1e3, 1e3)), draw(st.floats(-1e3, 1e3))]
    end = [a[0] + L * math.cos(azimuth), a[1] + L * math.sin(azimuth)]
    return a, end, [y_A, y_B, z_A, z_B, b, phi]


def made(drawn: Numbers) -> Wire:
    """A wire of these numbers, with a covariance that correlates all of them."""
    a, b, theta = drawn
    spread = np.array([0.1, 0.2, 0.1, 0.15, 0.2, 0.01])
    mixed = np.eye(6) + 0.3 * np.triu(np.ones((6, 6)), 1)
    covariance = (mixed @ mixed.T) * np.outer(spread, spread) * 1e-2
    base = Base(np.array(a), np.array(b))
    return Wire(1, base, np.array(theta), covariance, ENDS, Evidence("given", 1))


def places(wire: Wire, count: int = 50) -> np.ndarray:
    return np.linspace(0.0, wire.base.length_m, count)


def chord(wire: Wire, s: np.ndarray) -> np.ndarray:
    """y and z of the straight line between the ends."""
    t = (s / wire.base.length_m)[:, None]
    return (1 - t) * wire.theta[[0, 2]] + t * wire.theta[[1, 3]]


@given(numbers())
@settings(max_examples=100, deadline=None)
def test_the_curve_passes_through_its_ends(drawn: Numbers) -> None:
    wire = made(drawn)
    ends = wire.at(np.array([0.0, wire.base.length_m]))
    np.testing.assert_allclose(ends, [wire.theta[[0, 2]], wire.theta[[1, 3]]], atol=1e-8)
    points = wire.points(places(wire))
    np.testing.assert_allclose(wire.base.local(points)[:, 0], places(wire), atol=1e-9)
    np.testing.assert_allclose(points[0, :2], wire.base.a + wire.theta[0] * wire.base.n, atol=1e-8)


@given(numbers())
@settings(max_examples=100, deadline=None)
def test_sag_and_lowest_point_agree_with_brute_force(drawn: Numbers) -> None:
    wire = made(drawn)
    s = places(wire, 40_001)
    drop = (chord(wire, s) - wire.at(s))[:, 1]
    assert wire.sag is not None
    assert wire.sag.value == pytest.approx(drop.max(), rel=1e-6, abs=1e-9)
    assert abs(wire.sag_at_m - s[drop.argmax()]) < 1e-3 * wire.base.length_m
    low_s, low_z = wire.lowest
    z = wire.at(s)[:, 1]
    assert low_z == pytest.approx(z.min(), abs=1e-5 * wire.base.length_m)
    assert 0 <= low_s <= wire.base.length_m
    assert low_z <= z.min() + 1e-9
    assert wire.at(np.array([low_s]))[0, 1] == pytest.approx(low_z, abs=1e-9)


def hung(D: float, h: float, p: float, x: np.ndarray) -> np.ndarray:
    """Heights of the catenary of parameter p from the origin to (D, h), by a root of its own."""
    x0 = brentq(
        lambda x0: p * (math.cosh((D - x0) / p) - math.cosh(x0 / p)) - h,
        -D - 2 * p,
        D + 2 * p,
        xtol=1e-9,
        maxiter=1000,
    )
    return p * (np.cosh((x - x0) / p) - math.cosh(x0 / p))


@given(numbers())
@settings(max_examples=100, deadline=None)
def test_a_swung_wire_is_an_upright_catenary_turned_about_its_base(drawn: Numbers) -> None:
    """Turn the chord back by the swing, hang a catenary under it, and turn that."""
    wire = made(drawn)
    y_A, y_B, z_A, z_B, b, phi = wire.theta
    L, p = wire.base.length_m, wire.base.length_m**2 / (8 * b)
    c, s = math.cos(phi), math.sin(phi)
    turn = np.array([[c, -s], [s, c]])  # of (y, z), which takes down to the load
    dy, dz = turn.T @ [y_B - y_A, z_B - z_A]
    t = np.linspace(0, 1, 40)
    D = math.hypot(L, dy)
    upright = np.stack([dy * t, hung(D, dz, p, D * t)], 1)
    expected = [y_A, z_A] + upright @ turn.T
    np.testing.assert_allclose(wire.at(L * t), expected, atol=1e-7 * max(1.0, L))


@given(numbers())
@settings(max_examples=100, deadline=None)
def test_the_curve_lies_in_the_plane_of_chord_and_load(drawn: Numbers) -> None:
    wire = made(drawn)
    s = places(wire)
    points = np.column_stack([s, wire.at(s)])
    phi = wire.swing_rad
    load = np.array([0.0, math.sin(phi), -math.cos(phi)])
    normal = np.cross(points[-1] - points[0], load)
    normal /= np.linalg.norm(normal)
    assert np.abs((points - points[0]) @ normal).max() < 1e-9 * wire.base.length_m
    drop = wire.at(s) - chord(wire, s)  # along the load at every place
    assert np.abs(drop @ [math.cos(phi), math.sin(phi)]).max() < 1e-9 * wire.base.length_m


@given(numbers(swings=False))
@settings(max_examples=50, deadline=None)
def test_an_upright_wire_is_the_limit_of_a_swung_one(drawn: Numbers) -> None:
    wire = made(drawn)
    swung = replace(wire, theta=wire.theta + np.array([0, 0, 0, 0, 0, 1e-9]))
    np.testing.assert_allclose(wire.at(places(wire)), swung.at(places(wire)), atol=1e-6)
    assert np.abs(np.diff(wire.at(places(wire))[:, 0], 2)).max() < 1e-12 * wire.base.length_m  # y is linear


@given(numbers(), st.floats(-0.2, 0.5), st.floats(0.6, 1.3))
@settings(max_examples=100, deadline=None)
def test_another_base_and_back_changes_nothing(drawn: Numbers, low: float, high: float) -> None:
    """Neither the curve, nor its covariance; on the way, neither places nor their deviations."""
    wire = made(drawn)
    L = wire.base.length_m
    there = wire.between(low * L, high * L)
    s = np.linspace(max(low, 0.0), min(high, 1.0), 30) * L
    np.testing.assert_allclose(there.points(s - low * L), wire.points(s), atol=1e-7)
    np.testing.assert_allclose(there.sigma_at(s - low * L), wire.sigma_at(s), rtol=1e-4, atol=1e-9)
    back = there.on(wire.base)
    np.testing.assert_allclose(back.theta, wire.theta, rtol=1e-9, atol=1e-7)
    scale = np.sqrt(np.diag(wire.covariance))
    np.testing.assert_allclose(
        back.covariance / np.outer(scale, scale), wire.covariance / np.outer(scale, scale), atol=1e-3
    )
    sag = replace(wire.between(low * L, high * L), ends=ENDS).sag
    assert sag is not None
    assert wire.drop_between(low * L, high * L) == pytest.approx(sag.value, rel=1e-9, abs=1e-9)


@given(numbers(), st.floats(-30, 30), st.floats(-0.2, 0.5), st.floats(0.6, 1.3))
@settings(max_examples=100, deadline=None)
def test_a_base_beside_the_old_one_changes_nothing(
    drawn: Numbers, aside: float, low: float, high: float
) -> None:
    wire = made(drawn)
    cut = wire.base.cut(low * wire.base.length_m, high * wire.base.length_m)
    there = wire.on(Base(cut.a + aside * cut.n, cut.b + aside * cut.n))
    s = np.linspace(0, cut.length_m, 30)
    from_old = wire.base.local(there.points(s))[:, 0]
    np.testing.assert_allclose(there.points(s), wire.points(from_old), atol=1e-7)
    np.testing.assert_allclose(there.sigma_at(s), wire.sigma_at(from_old), rtol=1e-4, atol=1e-9)
    assert there.swing_rad == pytest.approx(wire.swing_rad, abs=1e-12)


@pytest.mark.parametrize("turn_deg", [-3.0, 1.0, 3.0])
def test_a_turned_base_keeps_the_curve_but_for_millimetres(turn_deg: float) -> None:
    """Ends that lie on the new base's ends; the load's part along it moves what is between them."""
    base = Base(np.array([3.0, 4.0]), np.array([83.0, 64.0]))
    wire = Wire(1, base, np.array([1, 4, 20, 26, 2.0, 0.35]), np.eye(6), ENDS, Evidence("given", 1))
    c, s = math.cos(math.radians(turn_deg)), math.sin(math.radians(turn_deg))
    u = np.array([[c, -s], [s, c]]) @ base.u
    there = wire.on(Base.along(base.a + 2 * base.n, u, 5.0, 95.0))
    local = base.local(there.points(np.linspace(0, there.base.length_m, 30)))
    off = np.linalg.norm(local[:, 1:] - wire.at(local[:, 0]), axis=1)
    assert max(off[0], off[-1]) < 1e-6 and off.max() < 4e-3


def test_deviations_of_a_swung_wire_on_another_base_agree_with_sampling() -> None:
    """Places, sag, lowest point and swing of half a wire that 20 degrees of swing blow aside."""
    random, base = np.random.default_rng(10), Base(np.zeros(2), np.array([0.0, 120.0]))
    theta = np.array([0.5, -1.0, 30.0, 33.0, 4.0, math.radians(20)])
    spread = np.array([0.03, 0.05, 0.04, 0.02, 0.05, math.radians(0.5)])
    mixed = np.eye(6) + 0.3 * np.triu(np.ones((6, 6)), 1)
    covariance = (mixed @ mixed.T) * np.outer(spread, spread)
    wire = Wire(1, base, theta, covariance, ENDS, Evidence("given", 1))
    cut = replace(wire.between(20.0, 80.0), ends=ENDS)
    draws = [replace(wire, theta=one) for one in random.multivariate_normal(theta, covariance, 4000)]
    s = np.array([0.0, 25.0, 60.0])
    places = np.std([one.at(s + 20.0) for one in draws], axis=0)
    np.testing.assert_allclose(cut.sigma_at(s), places, rtol=0.05)
    sags = [one.drop_between(20.0, 80.0) for one in draws]
    assert cut.sag is not None and cut.swing_deg is not None
    assert cut.sag.sigma == pytest.approx(np.std(sags), rel=0.05)
    assert cut.sag.value == pytest.approx(np.mean(sags), abs=0.005)
    assert cut.swing_deg.value == pytest.approx(20.0)
    assert cut.swing_deg.sigma == pytest.approx(math.degrees(math.sqrt(covariance[5, 5])))
    lowest = [one.lowest for one in draws]
    assert wire.lowest == pytest.approx(np.median(lowest, axis=0), abs=0.1)


def test_a_swing_that_was_held_is_not_stated() -> None:
    base = Base(np.zeros(2), np.array([60.0, 0.0]))
    held = np.pad(np.eye(5), (0, 1))
    wire = Wire(1, base, np.array([0, 0, 9, 9, 1.0, 0]), held, ENDS, Evidence("given", 1))
    assert wire.swing_deg is None
    measured = replace(wire, covariance=np.diag([1, 1, 1, 1, 1, 0.01])).swing_deg
    assert measured is not None and (measured.value, measured.sigma) == (0.0, math.degrees(0.1))
    given_one = replace(wire, theta=np.array([0, 0, 9, 9, 1.0, 0.1])).swing_deg
    assert given_one is not None and given_one.value == pytest.approx(math.degrees(0.1))


def test_what_was_seen_moves_with_the_base() -> None:
    base = Base(np.zeros(2), np.array([100.0, 0.0]))
    evidence = Evidence("83 images", 83, seen_m=((0.0, 20.0), (40.0, 90.0)))
    wire = Wire(1, base, np.array([0, 0, 20, 20, 2.0, 0]), np.zeros((6, 6)), ENDS, evidence)
    assert wire.between(30.0, 80.0).evidence.seen_m == ((10.0, 50.0),)
    assert wire.between(-10.0, 110.0).evidence.seen_m == ((10.0, 30.0), (50.0, 100.0))
    assert replace(wire, evidence=Evidence("points", 9)).between(0.0, 50.0).evidence.seen_m is None


@given(numbers())
@settings(max_examples=60, deadline=None)
def test_derivatives_agree_with_finite_differences(drawn: Numbers) -> None:
    """Of the fourth order, with steps of their own; sigma_at and worst_sigma by the same covariance."""
    wire = made(drawn)
    s = places(wire, 12)
    J = wire.by_theta(s)
    for k in range(6):
        h = np.zeros(6)
        h[k] = 1e-3 * max(1.0, abs(wire.theta[k])) if k != 5 else 1e-3
        h[4] = 1e-3 * wire.theta[4] if k == 4 else 0.0
        f = [replace(wire, theta=wire.theta + m * h).at(s) for m in (-2, -1, 1, 2)]
        expected = (f[0] - 8 * f[1] + 8 * f[2] - f[3]) / (12 * h[k])
        np.testing.assert_allclose(J[:, :, k], expected, rtol=2e-5, atol=2e-5 * np.abs(expected).max() + 1e-6)
    of_place = [np.sqrt(np.diag(one @ wire.covariance @ one.T)) for one in J]
    np.testing.assert_allclose(wire.sigma_at(s), of_place, rtol=1e-9)
    directions = np.array([[math.cos(a), math.sin(a)] for a in np.linspace(0, math.pi, 721)])
    fine = wire.by_theta(places(wire, 20))
    across = np.einsum("ad,mdk,kl,mel,ae->ma", directions, fine, wire.covariance, fine, directions)
    assert wire.worst_sigma() == pytest.approx(math.sqrt(across.max()), rel=1e-4)


OPEN = Open("not filmed")


@pytest.mark.parametrize(
    ("ends", "reason"),
    [
        ((OPEN, ENDS[1]), "the first end is open (not filmed)"),
        ((ENDS[0], Open("hidden")), "the last end is open (hidden)"),
        ((OPEN, Open("hidden")), "the first end is open (not filmed) and the last end is open (hidden)"),
    ],
)
@given(drawn=numbers())
@settings(max_examples=10, deadline=None)
def test_there_is_no_sag_between_ends_that_nothing_holds(drawn: Numbers, ends: tuple, reason: str) -> None:
    wire = made(drawn)
    loose = replace(wire, ends=ends)
    assert (loose.sag, loose.span_m, loose.p_m, loose.arc_m) == (None, None, None, None)
    assert loose.open == reason and wire.open is None
    assert None not in (wire.sag, wire.span_m, wire.p_m, wire.arc_m)
    assert loose.length_m == wire.length_m and math.isfinite(loose.drop_between(1.0, 9.0))


def lengths_of(theta: np.ndarray, L: float) -> dict[str, np.ndarray]:
    """Sag, span, p and length of many curves at once, (n, 6) to (n)."""
    y, z, b, phi = theta[:, 1] - theta[:, 0], theta[:, 3] - theta[:, 2], theta[:, 4], theta[:, 5]
    h, across = z * np.cos(phi) - y * np.sin(phi), z * np.sin(phi) + y * np.cos(phi)
    D, p = np.hypot(L, across), L**2 / (8 * b)
    x0 = D / 2 - p * np.arcsinh(h / (2 * p * np.sinh(D / (2 * p))))
    x = x0 + p * np.arcsinh(h / D)  # where the slope is the chord's
    drop = h / D * x - p * (np.cosh((x - x0) / p) - np.cosh(x0 / p))
    arc = p * (np.sinh((D - x0) / p) + np.sinh(x0 / p))
    return {"sag": drop * np.cos(phi), "span_m": np.hypot(L, y), "p_m": p, "arc_m": arc}


@pytest.mark.parametrize("phi", [0.0, 0.35])
def test_deviations_agree_with_sampling(phi: float) -> None:
    """Of sag, span, p and the wire's length over draws of theta, and of the ends' places along the wire."""
    random = np.random.default_rng(8)
    base = Base(np.zeros(2), np.array([200.0, 60.0]))
    theta = np.array([1.0, -2.0, 30.0, 42.0, 5.0, phi])
    spread = np.array([0.05, 0.08, 0.04, 0.06, 0.05, 0.01 * bool(phi)])
    mixed = np.eye(6) + 0.4 * np.triu(np.ones((6, 6)), 1)
    covariance = (mixed @ mixed.T) * np.outer(spread, spread)
    wire = Wire(1, base, theta, covariance, ENDS, Evidence("given", 1))
    draws = lengths_of(random.multivariate_normal(wire.theta, covariance, 20_000), base.length_m)
    for name, values in draws.items():
        stated: Quantity = getattr(wire, name)
        assert stated.value == pytest.approx(lengths_of(wire.theta[None], base.length_m)[name][0])
        assert stated.sigma == pytest.approx(values.std(), rel=0.03), name
        assert stated.half_95 == pytest.approx(1.96 * stated.sigma, rel=1e-4)
        inside = np.abs(values - stated.value) <= stated.half_95
        assert inside.mean() == pytest.approx(0.95, abs=0.012), name


def test_uncertain_ends_add_to_sag_span_and_length() -> None:
    """At one p the ends move along the wire by sigma each: drawn, and stated."""
    random = np.random.default_rng(9)
    base = Base(np.zeros(2), np.array([200.0, 0.0]))
    ends = (Attached(1, np.zeros(3), 0.3), Attached(2, np.zeros(3), 0.4))
    wire = Wire(1, base, np.array([0, 0, 30, 30, 5.0, 0]), np.zeros((6, 6)), ends, Evidence("given", 1))
    off = random.normal(size=(2000, 2)) * [0.3, 0.4]
    for name in ("sag", "span_m", "arc_m"):
        values = [
            lengths_of(transport(wire.theta, base, there)[None], there.length_m)[name][0]
            for there in (base.cut(low, 200 + high) for low, high in off)
        ]
        assert getattr(wire, name).sigma == pytest.approx(np.std(values), rel=0.05), name


@given(numbers(), st.floats(0.05, 5.0))
@settings(max_examples=60, deadline=None)
def test_polylines_have_the_steps_asked_for_and_the_wires_length(drawn: Numbers, step_m: float) -> None:
    wire = made(drawn)
    line = wire.polyline(step_m)
    steps = np.linalg.norm(np.diff(line, axis=0), axis=1)
    assert steps.max() <= step_m * (1 + 1e-9)
    assert steps.sum() <= wire.length_m * (1 + 1e-12)
    dense = np.linalg.norm(np.diff(wire.points(places(wire, 4001)), axis=0), axis=1).sum()
    assert wire.length_m == pytest.approx(dense, rel=1e-5)


@pytest.mark.parametrize("b", [0.0, 1e-12, -1.0, 1e-6])
def test_a_straight_wire_is_finite(b: float) -> None:
    """A bend of nothing, or of less, is a straight line within the micrometre that stands for it."""
    base = Base(np.zeros(2), np.array([300.0, 0.0]))
    wire = Wire(1, base, np.array([0, 1, 9, 12, b, 0.0]), 1e-4 * np.eye(6), ENDS, Evidence("given", 1))
    assert np.abs(wire.at(places(wire)) - chord(wire, places(wire))).max() < 2e-6
    for one in (wire.sag, wire.span_m, wire.p_m, wire.arc_m):
        assert one is not None and math.isfinite(one.value) and math.isfinite(one.sigma)
    assert np.isfinite(wire.polyline(10.0)).all()


@given(numbers())
@settings(max_examples=50, deadline=None)
def test_the_base_is_found_again_from_points(drawn: Numbers) -> None:
    """Of an upright wire in its own plane: up to direction, and to the offset from a chosen base."""
    wire = made(drawn)
    flat = replace(wire, theta=wire.theta * [0, 0, 1, 1, 1, 0])
    found = base_of(flat.points(places(flat, 200)))
    assert abs(found.u @ flat.base.u) == pytest.approx(1, abs=1e-9)
    assert found.length_m == pytest.approx(flat.base.length_m, rel=1e-9)
    local = found.local(flat.points(places(flat, 30)))
    assert np.abs(local[:, 1]).max() < 1e-6
    np.testing.assert_allclose(
        found.place(local[:, 0], local[:, 1:]), flat.points(places(flat, 30)), atol=1e-9
    )
