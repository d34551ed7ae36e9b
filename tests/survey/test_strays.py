"""A curve that runs into a wire of its span and away from it again is not shown; twins and pieces are."""

from dataclasses import replace

import numpy as np
from tests.support.drawn import HALF, hanging

from plnerf.line.base import Base
from plnerf.line.wire import Wire
from plnerf.survey.refine.config import RefineConfig
from plnerf.survey.refine.refine import Refinement
from plnerf.survey.refine.strays import without_strays

CONFIG = RefineConfig(stray_m=0.02, stray_ratio=3.0, stray_indistinct_m=0.05)
LENGTH = 2 * HALF
WIRE = hanging(0.0, 0.0)


def lower_at_one_end(by: float, meets: float) -> Wire:
    """Than the wire."""
    return replace(WIRE, theta=WIRE.theta + np.array([meets, meets, -by, 0.0, 0.0, 0.0]))


def shown(wires: list[Wire], counts: tuple[int, ...], extents: list[Wire] | None = None) -> tuple[bool, ...]:
    refined = Refinement(tuple(wires), 0.0, (True,) * len(wires), counts)
    return without_strays(refined, extents or wires, CONFIG).shown


def test_of_two_curves_that_meet_and_part_the_one_that_stands_out_more_stays() -> None:
    stray = lower_at_one_end(0.1, meets=0.005)
    assert shown([WIRE, stray], (9, 4)) == (True, False)
    assert shown([WIRE, stray], (4, 9)) == (False, True)
    hidden = Refinement((WIRE, stray), 0.0, (False, True), (9, 4))
    assert without_strays(hidden, [WIRE, stray], CONFIG).shown == (False, True)


def test_twins_pieces_of_one_wire_and_others_stay() -> None:
    twin, same = lower_at_one_end(0.001, meets=0.015), lower_at_one_end(0.01, meets=0.001)
    far, parting = lower_at_one_end(0.1, meets=0.03), lower_at_one_end(0.021, meets=0.015)
    for other in (twin, same, far, parting):
        assert shown([WIRE, other], (9, 4)) == (True, True)
    assert shown([], ()) == ()


def test_one_that_does_not_stand_out_may_come_less_near() -> None:
    stray = lower_at_one_end(0.2, meets=0.03)
    for distinct in (True, False):
        refined = Refinement((WIRE, stray), 0.0, (True, True), (9, 4), None, (True, distinct))
        assert without_strays(refined, [WIRE, stray], CONFIG).shown == (True, distinct)


def test_only_where_both_are_do_they_meet() -> None:
    """On one base curves go on where nothing was detected."""
    stray = lower_at_one_end(0.1, meets=0.005)
    a, b = WIRE.base.a, WIRE.base.b
    away = replace(stray, base=Base(a, a + 0.4 * (b - a)))  # the other end is where they meet
    beside = [replace(WIRE, base=Base(a + 0.5 * (b - a), b)), away]
    assert shown([WIRE, stray], (9, 4), [WIRE, away]) == (True, True)
    assert shown([WIRE, stray], (9, 4), beside) == (True, True)
