"""Lines that end at another line's structure."""

from dataclasses import replace

import numpy as np

from plnerf.line.base import Base
from plnerf.line.ends import Evidence, Open
from plnerf.line.line import Structure
from plnerf.line.wire import Wire
from plnerf.survey.chains import junctions
from plnerf.survey.config_spans import ChainConfig
from plnerf.survey.config_wires import SupportConfig
from plnerf.survey.span_wires import SpanWires
from plnerf.survey.support import Support
from plnerf.survey.tees import with_tees

OPEN = Open("a test")


def ending_at(x: float, length: float) -> list[Support]:
    """The supports of a line of one wire that runs north, and at whose last end a structure is seen."""
    base = Base(np.array([x, -length]), np.array([x, 0.0]))
    theta = np.array([0.0, 0.0, 10.0, 10.0, 1.0, 0.0])
    wire = Wire(0, base, theta, 1e-4 * np.eye(6), (OPEN, OPEN), Evidence("a test", 1))
    first, last = junctions((SpanWires(base, (wire,)),), ChainConfig())
    nothing, at = np.zeros((0, 2)), np.zeros((1, 2))
    structure = Structure(0, np.array([x, 0.0, 0.0]), 12.0, 0.1, "a test")
    return [Support(first, None, (nothing, nothing)), Support(last, structure, (at, nothing))]


def test_lines_that_end_at_one_structure_share_that_of_the_longest() -> None:
    """The third ends at the second's, which turns out to be the first's."""
    apart = 0.75 * SupportConfig().tee_m
    lines = [ending_at(k * apart, 60.0 - 10 * k) for k in range(3)]
    found = with_tees(lines, SupportConfig())
    assert [line[-1].structure for line in found] == [lines[0][-1].structure] * 3
    assert [line[-1].mine for line in found] == [True, False, False]
    assert all(line[0].structure is None for line in found)


def test_a_line_that_ends_farther_away_has_a_structure_of_its_own() -> None:
    lines = [ending_at(k * 1.5 * SupportConfig().tee_m, 60.0) for k in range(2)]
    found = with_tees(lines, SupportConfig())
    assert [line[-1].structure for line in found] == [line[-1].structure for line in lines]
    assert all(line[-1].mine for line in found)


def test_a_few_metres_beside_a_structure_have_it_at_one_end_only() -> None:
    tee_m = SupportConfig().tee_m
    first, piece = ending_at(0.0, 60.0), ending_at(0.5 * tee_m, 0.6 * tee_m)
    (own, others) = with_tees([first, piece], SupportConfig())
    assert own[-1].structure is first[-1].structure and own[-1].mine
    assert others[0].structure is None
    assert others[-1].structure is first[-1].structure and not others[-1].mine


def test_an_end_that_follows_another_line_to_the_structure_at_its_other_end_is_open() -> None:
    """The last line runs from the first's structure to the second's, which turns out to be the first's."""
    first, second = ending_at(0.0, 60.0), ending_at(0.75 * SupportConfig().tee_m, 50.0)
    ends = zip(ending_at(100.0, 40.0), (first, second), strict=True)
    between = [replace(end, structure=line[-1].structure, mine=False) for end, line in ends]
    found = with_tees([first, second, between], SupportConfig())
    assert found[1][-1].structure is first[-1].structure
    assert [one.structure for one in found[2]] == [first[-1].structure, None]
