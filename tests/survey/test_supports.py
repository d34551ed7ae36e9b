"""Supports are where the wires are held, and are not invented."""

from dataclasses import replace

import numpy as np
import pytest

from plnerf.line.base import Base
from plnerf.line.ends import Attached, Evidence, Open
from plnerf.line.wire import Wire
from plnerf.survey.attach import hung_between, lines_of, trimmed
from plnerf.survey.attachments import held_at
from plnerf.survey.bodies import Body, find_bodies, pole_axis
from plnerf.survey.chains import Chain, find_chains, wires_of
from plnerf.survey.config_spans import ChainConfig
from plnerf.survey.config_wires import AttachmentConfig, BodyConfig, PoleConfig, SupportConfig
from plnerf.survey.span_wires import rewired
from plnerf.survey.support import Supports, each_structure_once
from plnerf.survey.supports import find_supports, scenery_of
from plnerf.survey.surface import Surface

CONFIG = SupportConfig()
WIRES = [
    Wire(
        0, Base(np.array([-18.0, 0.0]), np.array([18.0, 0.0])), np.array([y, y, 0.324, 0.324, 0.324, 0.0]),
        np.eye(6) * 1e-4, (Open("not searched"), Open("not searched")), Evidence("a test", 1, reach_m=1.0),
    )
    for y in (-2.0, 0.0, 2.0)
]  # fmt: skip


def wire_lines() -> list[np.ndarray]:
    """Of the wires, beyond their ends too."""
    return [wire.points(np.linspace(-2.0, 38.0, 80)) for wire in WIRES]


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
    """Of parts."""
    xyz = np.concatenate(parts)
    n = len(xyz)
    return Surface(xyz, np.zeros((n, 3), np.uint8), np.full(n, 0.05), np.tile([0.0, 1.0, 0.0], (n, 1)))


def test_wires_are_held_where_their_strings_are() -> None:
    random = np.random.default_rng(0)
    points = np.concatenate([ground(random), body(random, 15.3), arm(random, 15.0)])
    at = held_at(points, wire_lines(), 12.5, 17.5, AttachmentConfig())
    assert at is not None and at.x_m == pytest.approx(15.0, abs=0.05) and at.wires == 3
    beyond = held_at(points, wire_lines()[:1], 9.0, 21.0, AttachmentConfig())  # by one wire, and from far
    assert beyond is not None and beyond.x_m == pytest.approx(15.0, abs=0.05) and beyond.wires == 1


def test_a_single_wire_holds_nothing_where_the_others_show_something_elsewhere() -> None:
    random = np.random.default_rng(4)
    z = np.interp(15.0, *wire_lines()[0][:, [0, 2]].T)
    above = random.uniform(z + 0.3, z + 1, 60)
    one = np.column_stack([random.normal(15.0, 0.1, 60), np.full(60, 2.0), above])
    alone = held_at(one, wire_lines(), 12.5, 17.5, AttachmentConfig())
    assert alone is not None and alone.x_m == pytest.approx(15.0, abs=0.05) and alone.wires == 1
    # Of a lattice, over a metre: at no one place.
    members = np.column_stack(
        [random.uniform(14.1, 15.9, 60), random.choice([-2.0, 0.0], 60), above]
    )
    assert held_at(members, wire_lines(), 12.5, 17.5, AttachmentConfig()) is None
    assert held_at(np.concatenate([one, members]), wire_lines(), 12.5, 17.5, AttachmentConfig()) is None


def test_crowns_specks_and_the_wires_themselves_hold_nothing() -> None:
    random = np.random.default_rng(1)
    wires = wire_lines()
    assert held_at(np.zeros((0, 3)), wires, 10.0, 18.0, AttachmentConfig()) is None
    assert held_at(ground(random), wires, 10.0, 18.0, AttachmentConfig()) is None
    crown = random.normal(size=(900, 3)) * [1.5, 1.5, 0.8] + [14, 0, 0.8]
    assert held_at(crown, wires, 10.0, 18.0, AttachmentConfig()) is None
    on = np.concatenate([line + random.normal(size=line.shape) * 0.05 for line in wires * 20])
    assert held_at(on, wires, 10.0, 18.0, AttachmentConfig()) is None
    z = np.interp(15.0, *wires[0][:, [0, 2]].T)
    below = arm(random, 15.0) * [1, 1, -1] + [0, 0, 2 * z]  # the tip of a plant
    assert held_at(below, wires, 10.0, 18.0, AttachmentConfig()) is None
    assert held_at(arm(random, 15.0, n=4), wires, 10.0, 18.0, AttachmentConfig()) is None


def test_a_body_is_found_by_what_fills_the_corridor() -> None:
    random = np.random.default_rng(2)
    ends = [line[(line[:, 0] > -18) & (line[:, 0] < 18)] for line in wire_lines()]
    first, last = find_bodies(np.concatenate([ground(random), body(random, 15.0)]), ends, BodyConfig())
    assert first is None and last is not None
    assert last.x_m == pytest.approx(15, abs=0.2) and last.foot_m == pytest.approx(-10, abs=0.3)
    bush = np.column_stack([random.normal(-15, 1, 900), np.zeros(900), random.uniform(-10, -4, 900)])
    assert find_bodies(np.concatenate([ground(random), bush]), ends, BodyConfig())[0] is None


def test_a_body_is_where_other_points_show_something_too() -> None:
    """A young field shows a body 2.7 m before the tower, and as well as the tower."""
    random = np.random.default_rng(7)
    ends = [line[(line[:, 0] > -18) & (line[:, 0] < 18)] for line in wire_lines()]
    floor = ground(random)
    noise = np.column_stack([np.full(60, 12.3), np.zeros(60), np.linspace(-10, 1, 60)])
    field = np.concatenate([floor, noise, body(random, 15.0, n=600)])
    stereo = np.concatenate([floor, body(random, 15.0, n=60)])
    alone, both = (find_bodies(field, ends, BodyConfig(), also)[1] for also in (None, stereo))
    assert alone is not None and abs(alone.x_m - 15.0) > 0.5
    assert both is not None and both.x_m == pytest.approx(15.0, abs=0.1)
    assert find_bodies(field, ends, BodyConfig(), floor) == (None, None)


def test_a_poles_axis_is_between_its_sides_wherever_its_crossarm_holds_the_wires() -> None:
    random = np.random.default_rng(8)
    turn = random.uniform(0, 2 * np.pi, 900)
    pole = np.column_stack([15 + 0.15 * np.cos(turn), 0.1 + 0.15 * np.sin(turn), random.uniform(-10, 0, 900)])
    held = Body(15.2, 0.0, -10.0, 1.0)  # on pins before it
    assert pole_axis(held, 0.05, pole, 0.0, PoleConfig()) == pytest.approx(15.0, abs=0.02)
    upper = pole[pole[:, 2] > -3]
    assert pole_axis(held, 0.05, upper, 0.0, PoleConfig()) == pytest.approx(15.0, abs=0.02)
    for none in (pole[pole[:, 2] > -1.2], pole[:40], pole * [1, 1, 0.05], body(random, 15.0)):
        assert pole_axis(held, 0.05, none, 0.0, PoleConfig()) is None  # a crossarm, too little, a lattice
    afar = replace(held, x_m=15.45)  # a leg of a lattice, unless where wires are held is known no better
    assert pole_axis(afar, 0.05, pole, 0.0, PoleConfig()) is None
    assert pole_axis(afar, 0.3, pole, 0.0, PoleConfig()) is not None
    wide = pole * [1, 0, 1] + (pole - [15, 0, 0]) * [8, 0, 0]  # of which only a part is near
    assert pole_axis(replace(held, x_m=16.5), 0.7, wide, 0.0, PoleConfig()) is None


def found(
    shown: Surface, field: Surface | None, wires: list[Wire], config: SupportConfig = CONFIG
) -> tuple[Supports, tuple[Chain, ...], tuple[Chain, ...]]:
    """The supports of wires, the chain of these and what is left between the supports."""
    chains = find_chains(wires, ChainConfig())
    scenery = scenery_of(shown, field, chains, config)
    supports = find_supports(scenery, chains, config, ChainConfig())
    return supports, chains, trimmed(chains, supports)


def ends_of(wire: Wire) -> list[float]:
    return [float(wire.base.a[0]), float(wire.base.b[0])]


def test_wires_end_at_structures_by_the_best_that_shows_them() -> None:
    random = np.random.default_rng(3)
    floor = ground(random)
    shown = surface(floor, body(random, 15.3), arm(random, 15.0))
    field = surface(floor, body(random, 15.3), arm(random, -14.8))
    supports, _, extents = found(shown, field, WIRES)
    assert [one.sigma_m for one in supports.seen] == [CONFIG.by_field_m, CONFIG.by_stereo_m]
    for wire in wires_of(extents):
        assert ends_of(wire) == pytest.approx([-14.8, 15.0], abs=0.1)
    shorter = [wire.between(4.0, 36.0) for wire in WIRES]
    again, _, extents = found(shown, field, shorter)
    for one, other in zip(again.seen, supports.seen, strict=True):
        assert one.foot == pytest.approx(other.foot, abs=0.1)
    assert all(ends_of(wire)[0] == pytest.approx(-14.0) for wire in wires_of(extents))
    # The second has a body, the first has none: it stands on the ground below what holds the wires.
    first, last = supports.seen
    assert first.foot == pytest.approx([-14.8, 0.0, -10.0], abs=0.4) and first.height_m > 10
    assert last.foot == pytest.approx([15.0, 0.0, -10.0], abs=0.9)
    assert (first.id, last.id) == (1, 2)
    assert supports.points[4000:4900].mean() > 0.6 and supports.points[:4000].sum() == 0


def test_a_body_alone_holds_no_wire_and_no_structure_leaves_the_wires() -> None:
    random = np.random.default_rng(4)
    floor = ground(random)
    seen_by_both = surface(floor, body(random, 15.0, n=100)), surface(floor, body(random, 15.0))
    # What the field alone shows may be its noise, and what both show may be a tree.
    only_field = surface(floor, floor), surface(floor, body(random, 15.0))
    for seen in (seen_by_both, only_field, (surface(floor, floor), surface(floor, floor))):
        nothing, _, extents = found(*seen, WIRES)
        assert nothing.seen == ()
        assert [ends_of(wire) for wire in wires_of(extents)] == pytest.approx(np.array([[-18.0, 18.0]] * 3))
    assert found(surface(floor), None, [])[0].seen == ()


def test_what_is_above_one_wire_of_several_holds_it_beside_a_body_only() -> None:
    random = np.random.default_rng(8)
    floor, z = ground(random), float(np.interp(15.0, *wire_lines()[0][:, [0, 2]].T))
    twig = np.column_stack([
        random.normal(15.0, 0.1, 90), random.normal(0.0, 0.1, 90), random.uniform(z + 0.3, z + 1.2, 90)
    ])  # fmt: skip
    assert found(surface(floor, twig), None, WIRES)[0].seen == ()
    (one,) = found(surface(floor, twig, body(random, 15.2)), None, WIRES)[0].seen
    assert one.sigma_m == CONFIG.by_stereo_m and "seen by stereo" in one.evidence
    (alone,) = found(surface(floor, twig), None, WIRES[1:2])[0].seen
    assert alone.sigma_m == CONFIG.by_stereo_m


def test_a_wire_has_a_sag_between_two_structures_only() -> None:
    random = np.random.default_rng(5)
    floor = ground(random)
    one, chains, extents = found(surface(floor, body(random, 15.3), arm(random, 15.0)), None, WIRES)
    wire = wires_of(hung_between(chains, extents, one))[1]
    assert isinstance(wire.ends[0], Open) and isinstance(wire.ends[1], Attached)
    assert wire.sag is None and wire.p_m is None and wire.span_m is None
    assert wire.open is not None and "first end is open" in wire.open
    arms = surface(floor, body(random, 15.3), arm(random, 15.0), arm(random, -15.0))
    two, chains, extents = found(arms, None, WIRES)
    hung = hung_between(chains, extents, two)
    held = wires_of(hung)[1]
    assert held.sag is not None and held.sag.value == pytest.approx(0.001 * 15**2, abs=3e-3)
    # What 5 cm at either end of 30 m add: at a fixed p the sag goes with the square of the span.
    exact = [replace(end, sigma_m=0.0) for end in held.ends if isinstance(end, Attached)]
    own = replace(held, ends=(exact[0], exact[1])).sag
    by_ends = 2 * held.sag.value / held.base.length_m * np.sqrt(2) * CONFIG.by_stereo_m
    assert own is not None and held.sag.sigma == pytest.approx(np.hypot(own.sigma, by_ends), rel=1e-9)
    assert held.ends[1].point == pytest.approx(held.points(np.array([held.base.length_m]))[0])
    (line,) = lines_of(hung, two, two.seen)
    assert line.spans[0].structures == (1, 2) and len(line.structures) == 2


def test_a_few_metres_of_a_span_have_their_structure_once() -> None:
    random = np.random.default_rng(8)
    shown = surface(ground(random), body(random, 15.3), arm(random, 15.0))
    short = [wire.between(33.0, 36.0) for wire in WIRES]  # x from 15 to 18
    supports, chains, extents = found(shown, None, short)
    (structure,) = supports.seen
    assert structure.foot[0] == pytest.approx(15.0, abs=0.1)
    for wire in wires_of(hung_between(chains, extents, supports)):
        assert sorted(type(end).__name__ for end in wire.ends) == ["Attached", "Open"]
        assert wire.base.length_m == pytest.approx(3.0, abs=0.2)
    ((first, last),) = supports.chains
    assert first.structure is structure and last.structure is None
    between = replace(last, structure=structure, junction=replace(last.junction, after=last.junction.before))
    kept = each_structure_once([first, between], CONFIG.least_span)
    assert kept[0].structure is None and kept[1].structure is structure  # it holds two spans


def test_a_wire_ends_at_a_structure_beyond_where_images_show_it() -> None:
    random = np.random.default_rng(6)
    shown = surface(ground(random), body(random, 15.3), arm(random, 15.0))
    short = [wire.between(0.0, 31.0) for wire in WIRES]  # to x = 13
    supports, chains, extents = found(shown, None, short)
    assert ends_of(wires_of(extents)[0])[1] == pytest.approx(13.0)
    assert ends_of(wires_of(hung_between(chains, extents, supports))[0])[1] == pytest.approx(15.0, abs=0.1)


def test_a_wire_that_is_seen_beyond_a_structure_only_is_held_by_none() -> None:
    random = np.random.default_rng(7)
    shown = surface(ground(random), body(random, 15.3), arm(random, 15.0))
    supports, chains, extents = found(shown, None, WIRES)
    (first, _, last), piece = WIRES, WIRES[1].between(34.0, 36.0)  # x from 16 to 18
    beyond = tuple((rewired(span, [first, piece, last]),) for (span,) in extents)
    _, wire, other = wires_of(hung_between(chains, beyond, supports))
    assert ends_of(wire) == pytest.approx(np.array([16.0, 18.0]))
    assert isinstance(wire.ends[0], Open) and isinstance(wire.ends[1], Open)
    assert isinstance(other.ends[1], Attached)


def test_a_piece_of_a_wire_about_a_single_structure_is_held_by_none() -> None:
    random = np.random.default_rng(7)
    shown = surface(ground(random), body(random, 15.3), arm(random, 15.0))
    supports, chains, extents = found(shown, None, WIRES)
    ((_, last),) = supports.chains
    there = (np.repeat(last.at[0][:1], 3, 0), last.at[1])
    same = replace(supports, chains=((replace(last, at=there[::-1]), last),))
    for apart_m in (0.0, 1e-15, 1e-9):
        a_little = replace(last, at=(there[0] + np.array([apart_m, 0.0]), last.at[1]))
        both = replace(supports, chains=((replace(last, at=there[::-1]), a_little),))
        assert all(wire.base.length_m > 1.0 for wire in wires_of(trimmed(chains, both)))
    hung = wires_of(hung_between(chains, extents, same))
    assert all(isinstance(end, Open) for wire in hung for end in wire.ends)
    assert all(np.isfinite(wire.points(np.array([0.0, 1.0]))).all() for wire in hung)
