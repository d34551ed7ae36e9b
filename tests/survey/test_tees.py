"""Lines that end at another line's structure."""

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
