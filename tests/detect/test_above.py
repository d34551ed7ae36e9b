"""Shield wires hang above wires, alone and with another sag."""

from dataclasses import replace

import numpy as np
import pytest

from plnerf.detect.above import above_wires
from plnerf.detect.candidate import Candidate
from plnerf.detect.config import SelectConfig

SELECT, PLANES, LENGTH = SelectConfig(), 101, 2.0


def line(y: float, z: float, sag: float = 0.04, askew: float = 0.0) -> Candidate:
    """One that views fix, level but for its sag, seen in the middle half of the window."""
    theta = np.array([y - askew / 2, y + askew / 2, z, z, sag, 0.0])
    return Candidate(theta, 1e-8 * np.eye(6), 1.0, images=20, odds=800.0, seen=(25, 75), fixed=True)


WIRE, SHIELD = line(0.1, 0.0), line(0.0, 0.2, sag=0.015)


def found(*lines: Candidate) -> list[Candidate]:
    return above_wires(lines, [WIRE], PLANES, LENGTH, SELECT)


def test_a_line_alone_above_a_wire_is_one() -> None:
    others = [line(0.6, 0.2), line(0.1, -0.2), line(0.0, 0.2, askew=0.3), line(0.0, 0.2, sag=0.0)]
    assert found(SHIELD, *others) == [SHIELD]
    assert above_wires([SHIELD], [], PLANES, LENGTH, SELECT) == []


@pytest.mark.parametrize("change", [
    {"fixed": False}, {"odds": SELECT.min_odds - 1}, {"likeness": 1.01 * SELECT.lies}, {"seen": (70, 95)},
    {"covariance": np.eye(6)},
])  # fmt: skip
def test_it_needs_the_evidence_of_a_first_line_beside_the_wire(change: dict[str, object]) -> None:
    assert found(replace(SHIELD, **change)) == []  # type: ignore[arg-type]
