"""A wire moved to another frame is the same wire: its points, how well it is known, and what holds it."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from plnerf.line.base import Base
from plnerf.line.ends import Attached, Evidence, Open
from plnerf.line.frame import LineFrame
from plnerf.line.move import move_wire
from plnerf.line.wire import Wire

UTM = np.array([500_000.0, 5_700_000.0, 300.0])
LEAN = Rotation.from_euler("yx", [0.2, -0.1]).as_matrix()
"""Of the scene's z axis in the world."""


def a_wire(swing: float) -> Wire:
    """A span of 40 m at an azimuth of its own, seen in two stretches, held at its first end."""
    theta = np.array([0.3, -0.2, 9.0, 10.5, 1.4, swing])
    root = np.random.default_rng(0).normal(0, 0.02, (6, 6))
    base = Base(np.array([-12.0, -16.0]), np.array([12.0, 16.0]))
    evidence = Evidence("60 images", 60, 0.9, 2.0, 0.01, 0.02, True, 0.05, ((1.0, 14.0), (20.0, 39.0)))
    wire = Wire(3, base, theta, root @ root.T, (Open("hidden"), Open("hidden")), evidence, diameter_m=0.03)
    return replace(wire, ends=(Attached(2, wire.points(np.zeros(1))[0], 0.1), wire.ends[1]))


@st.composite
def two_frames(draw: st.DrawFn) -> tuple[LineFrame, LineFrame]:
    """Of one world, near its origin or in UTM, with the same up, some tens of metres apart."""
    made, far = [], draw(st.booleans())
    for _ in range(2):
        R = Rotation.from_euler("z", draw(st.floats(-3.2, 3.2))).as_matrix() @ LEAN
        origin = far * UTM + np.array([draw(st.floats(-50, 50)) for _ in range(3)])
        made.append(LineFrame(R, draw(st.floats(0.05, 20)), origin, "unscaled"))
    return made[0], made[1]


@given(two_frames(), st.sampled_from([0.0, 0.05, -0.8]))
@settings(deadline=None, max_examples=100)
def test_a_moved_wire_is_the_same_wire(frames: tuple[LineFrame, LineFrame], swing: float) -> None:
    old, new = frames
    wire = a_wire(swing)
    moved, factor = move_wire(wire, old, new), new.scale / old.scale
    share = np.linspace(-0.1, 1.1, 40)
    on, there = (one.points(share * one.base.length_m) for one in (wire, moved))
    near = max(1.0, float(np.abs(old.origin_world).max()) / 100)  # rounding of the world's coordinates
    np.testing.assert_allclose(
        there, new.from_world(old.to_world(on)), atol=1e-9 * near * max(1.0, new.scale)
    )
    lengths_m = [np.linalg.norm(np.diff(line, axis=0), axis=1) for line in (on, there)]
    np.testing.assert_allclose(lengths_m[1], factor * lengths_m[0], rtol=1e-9)
    s = np.linspace(0, 1, 9)
    known, kept = (one.sigma_at(s * one.base.length_m) for one in (wire, moved))
    np.testing.assert_allclose(kept, factor * known, rtol=1e-5)
    held = moved.ends[0]
    assert isinstance(held, Attached) and held.structure == 2 and held.sigma_m == pytest.approx(0.1 * factor)
    np.testing.assert_allclose(held.point, moved.points(np.zeros(1))[0], atol=1e-9 * max(1.0, factor))
    assert moved.ends[1] == wire.ends[1] and moved.swing_rad == wire.swing_rad
    seen = moved.evidence.seen_m
    assert seen is not None and seen[1] == pytest.approx((20 * factor, 39 * factor))
    lengths = ("longest_gap_m", "residual_across_m", "residual_up_m", "reach_m")
    for name in lengths:
        assert getattr(moved.evidence, name) == pytest.approx(factor * getattr(wire.evidence, name))
    assert (moved.evidence.count, moved.evidence.coverage) == (60, 0.9)
    assert moved.diameter_m == pytest.approx(0.03 * factor) and moved.id == 3


@given(two_frames())
@settings(deadline=None, max_examples=30)
def test_there_and_back_is_where_it_was(frames: tuple[LineFrame, LineFrame]) -> None:
    old, new = frames
    wire = a_wire(0.1)
    back = move_wire(move_wire(wire, old, new), new, old)
    for one, other in ((back.theta, wire.theta), (back.base.a, wire.base.a), (back.base.b, wire.base.b)):
        np.testing.assert_allclose(one, other, atol=1e-9)
    np.testing.assert_allclose(back.covariance, wire.covariance, atol=1e-12)
    assert move_wire(wire, old, old).theta == pytest.approx(wire.theta, abs=1e-12)
    assert old.same_as(replace(old)) and not old.same_as(replace(old, scale=2 * old.scale))


def test_frames_of_another_up_are_refused() -> None:
    old = LineFrame(np.eye(3), 1.0, UTM, "m")
    new = LineFrame(Rotation.from_euler("x", 0.01).as_matrix(), 1.0, UTM, "m")
    with pytest.raises(ValueError, match=r"z axes differ by 0\.573 degrees"):
        move_wire(a_wire(0.0), old, new)
