"""Supports are where the wires are held, and are not invented."""

from dataclasses import replace

import numpy as np
import pytest

from plnerf.detect.curves import Curve
from plnerf.scene.transforms import Frames
from plnerf.survey.attachments import held_at
from plnerf.survey.bodies import find_columns
from plnerf.survey.field_surface import Surface
from plnerf.survey.supports import BY_BODY_M, BY_FIELD_M, BY_STEREO_M, between_supports

METRE = 0.05
"""Of the scene's unit; the world is in metres."""
FRAMES = Frames(np.eye(3), METRE, np.array([100.0, 200.0, 10.0]), "m", None, "file")
CURVES = [
    Curve((across * METRE, 0.0), (0.0, 0.0, 0.001 / METRE), (-0.9, 0.9), 0.01, 0.05, True)
    for across in (-2.0, 0.0, 2.0)
]


def wire_lines() -> list[np.ndarray]:
    """Of the curves, in metres."""
    return [curve.points(np.linspace(-1, 1, 80)) / METRE for curve in CURVES]


def ground(random: np.random.Generator) -> np.ndarray:
    """Ten metres below."""
    return np.column_stack([random.uniform(-22, 22, (4000, 2)), random.normal(-10, 0.05, 4000)])


def arm(random: np.random.Generator, x: float, n: int = 90, depth: float = 0.1) -> np.ndarray:
    """What holds the wires, a metre above them, and the strings they hang from."""
    z = np.interp(x, *wire_lines()[0][:, [0, 2]].T)
    along, y = random.normal(x, depth, n), random.uniform(-2.2, 2.2, n)
    beam = np.column_stack([along, y, random.normal(z + 1, 0.05, n)])
    across = random.choice([-2.0, 0.0, 2.0], n)
    strings = np.column_stack([random.normal(x, depth, n), across, random.uniform(z, z + 1, n)])
    return np.concatenate([beam, strings])


def body(random: np.random.Generator, x: float, n: int = 900) -> np.ndarray:
    """A lattice a metre and a half deep whose near side is seen better."""
    off = random.uniform(-0.75, 0.75, n)
    y = np.where(random.random(n) < 0.8, -0.75, 0.75)
    return np.column_stack([x + off, y, random.uniform(-10, 2, n)])


def surface(*parts: np.ndarray) -> Surface:
    """Of the world, of parts in the scene's metres."""
    xyz = FRAMES.to_world(METRE * np.concatenate(parts))
    n = len(xyz)
    return Surface(xyz, np.zeros((n, 3), np.uint8), np.full(n, 0.05), np.tile([0.0, 1.0, 0.0], (n, 1)))


def test_wires_are_held_where_their_strings_are() -> None:
    random = np.random.default_rng(0)
    points = np.concatenate([ground(random), body(random, 15.3), arm(random, 15.0)])
    at = held_at(points, wire_lines(), 12.5, 17.5)
    assert at == pytest.approx(15.0, abs=0.05)
    beyond = held_at(points, wire_lines()[:1], 9.0, 21.0)  # by one wire, and from far
    assert beyond == pytest.approx(15.0, abs=0.05)


def test_crowns_specks_and_the_wires_themselves_hold_nothing() -> None:
    random = np.random.default_rng(1)
    wires = wire_lines()
    assert held_at(np.zeros((0, 3)), wires, 10.0, 18.0) is None
    assert held_at(ground(random), wires, 10.0, 18.0) is None
    crown = random.normal(size=(900, 3)) * [1.5, 1.5, 0.8] + [14, 0, 0.8]
    assert held_at(crown, wires, 10.0, 18.0) is None
    on = np.concatenate([line + random.normal(size=line.shape) * 0.05 for line in wires * 20])
    assert held_at(on, wires, 10.0, 18.0) is None
    z = np.interp(15.0, *wires[0][:, [0, 2]].T)
    below = arm(random, 15.0) * [1, 1, -1] + [0, 0, 2 * z]  # the tip of a plant
    assert held_at(below, wires, 10.0, 18.0) is None
    assert held_at(arm(random, 15.0, n=4), wires, 10.0, 18.0) is None


def test_a_body_is_found_by_what_fills_the_corridor() -> None:
    random = np.random.default_rng(2)
    ends = [line[(line[:, 0] > -18) & (line[:, 0] < 18)] for line in wire_lines()]
    first, last = find_columns(np.concatenate([ground(random), body(random, 15.0)]), ends)
    assert first is None and last is not None
    assert last.x_m == pytest.approx(15, abs=0.2) and last.foot_m == pytest.approx(-10, abs=0.3)
    bush = np.column_stack([random.normal(-15, 1, 900), np.zeros(900), random.uniform(-10, -4, 900)])
    assert find_columns(np.concatenate([ground(random), bush]), ends)[0] is None


def test_curves_end_at_supports_by_the_best_that_shows_them() -> None:
    random = np.random.default_rng(3)
    floor = ground(random)
    shown = surface(floor, body(random, 15.3), arm(random, 15.0))
    field = surface(floor, body(random, 15.3), arm(random, -14.8))
    cut, supports = between_supports(shown, field, CURVES, FRAMES)
    assert [at and at.sigma_m for at in supports.held] == [BY_FIELD_M, BY_STEREO_M]
    for curve in cut:
        assert np.array(curve.ends) / METRE == pytest.approx([-14.8, 15.0], abs=0.1)
    shorter = [replace(curve, ends=(-0.7, 0.9)) for curve in CURVES]
    cut, again = between_supports(shown, field, shorter, FRAMES)
    assert again.held == supports.held and all(curve.ends[0] == -0.7 for curve in cut)
    # The second has a body, the first has none: it stands on the ground below what holds the wires.
    first, last = supports.towers
    assert first.foot == pytest.approx([100 - 14.8, 200.0, 0.0], abs=0.4) and first.height_m > 10
    assert last.foot == pytest.approx([115.0, 200.0, 0.0], abs=0.9)
    assert supports.points[4000:4900].mean() > 0.6 and supports.points[:4000].sum() == 0


def test_a_body_alone_is_less_exact_and_no_support_leaves_the_curves() -> None:
    random = np.random.default_rng(4)
    floor = ground(random)
    cut, supports = between_supports(surface(floor), surface(floor, body(random, 15.0)), CURVES, FRAMES)
    assert supports.held[0] is None and supports.held[1] and supports.held[1].sigma_m == BY_BODY_M
    assert all(curve.ends[0] == -0.9 and curve.ends[1] / METRE == pytest.approx(15, abs=0.2) for curve in cut)
    cut, supports = between_supports(surface(floor), surface(floor), CURVES, FRAMES)
    assert [one.ends for one in cut] == [one.ends for one in CURVES] and supports.towers == ()
    assert between_supports(surface(floor), surface(floor), [], FRAMES)[0] == []
