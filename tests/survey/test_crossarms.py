"""Crossarms at the wires' heights are no wires; short pieces of wires, and lines that cross, are."""

import numpy as np
import pytest

from plnerf.errors import ConfigError
from plnerf.line.base import Base
from plnerf.line.hang import hang
from plnerf.line.line import Structure
from plnerf.line.wire import Wire
from plnerf.survey.config_spans import CrossarmConfig
from plnerf.survey.crossarms import about_crossarms, without_crossarms
from plnerf.survey.span_wires import Junction, span_of
from plnerf.survey.support import Support, Supports

CONFIG = CrossarmConfig()


def supports_of(wires: list[Wire], structure: Structure | None, mine: bool = True) -> Supports:
    """Of a line along x whose first span ends at x = 40; mine: whether the structure is its own."""
    junction = Junction(Base(np.array([40.0, 0.0]), np.array([41.0, 0.0])), span_of(wires), None)
    held = (np.zeros((len(wires), 2)), np.zeros((0, 2)))
    return Supports(((Support(junction, structure, held, mine=mine),),), np.zeros(0, np.bool_))


@pytest.mark.parametrize("mine", [True, False])
def test_what_lies_across_the_line_at_a_structure_is_its_arm(mine: bool) -> None:
    """Also where the structure counts as another line's, such as one that its arms were taken for."""
    wires = [hang((0.0, y, 10.0), (40.0, y, 10.0), 0.8) for y in (-2.5, 2.5)]
    arms = [hang((40.1, -2.6, z), (39.9, 2.6, z), 0.01) for z in (10.0, 10.6)]
    piece = hang((38.0, 2.5, 10.1), (40.0, 2.5, 10.0), 0.01)
    crossing = hang((40.0, -9.0, 7.0), (40.0, 9.0, 7.0), 0.2)
    away = hang((30.0, -2.0, 9.0), (30.0, 2.0, 9.0), 0.01)
    every = [*wires, *arms, piece, crossing, away]
    stands = Structure(1, np.array([40.0, 0.0, 0.0]), 12.0, 0.05, "test")
    kept = without_crossarms(every, supports_of(wires, stands, mine), CONFIG)
    assert [id(one) for one in kept] == [id(one) for one in (*wires, piece, crossing, away)]
    assert without_crossarms(every, supports_of(wires, None), CONFIG) == every


def test_arms_reach_to_the_other_side_of_wires_that_are_found_on_one_alone() -> None:
    """The structure's place is near to their ends then: nothing else shows where its axis is."""
    wires = [hang((0.0, 2.5, z), (40.0, 2.5, z), 0.8) for z in (8.0, 10.0)]
    arms = [hang((40.0, 2.6, z), (40.2, 0.4, z), 0.01) for z in (8.0, 10.0)]
    stands = Structure(1, np.array([40.2, 2.3, 0.0]), 12.0, 0.5, "test")
    assert without_crossarms([*wires, *arms], supports_of(wires, stands), CONFIG) == wires


def test_they_are_reported() -> None:
    assert about_crossarms(0) == []
    assert "One curve was a structure's arm" in about_crossarms(1)[0].what
    assert "2 curves were a structure's arms" in about_crossarms(2)[0].what


def test_settings_that_make_no_sense_are_refused() -> None:
    with pytest.raises(ConfigError, match="across_deg"):
        CrossarmConfig(across_deg=0.0)
