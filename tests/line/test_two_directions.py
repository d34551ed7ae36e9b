"""Which lines of sight come from the second of two directions."""

import numpy as np
import pytest

from plnerf.line.two_directions import second_direction

TO_AND_FRO = np.array([30.0, 33.0, 31.0, 70.0, 74.0])


def groups(angles: np.ndarray, **kwargs: float) -> list[int] | None:
    """Whether each is of the first one's direction or of the other."""
    second = second_direction(angles, **({"distinct": 1.0, "least_deg": 5.0} | kwargs))
    return None if second is None else (second != second[0]).astype(int).tolist()


@pytest.mark.parametrize("turn", [0.0, 80.0, 120.0, 148.0, 290.0])
def test_two_directions_are_told_apart_wherever_the_half_turn_begins(turn: float) -> None:
    assert groups(TO_AND_FRO + turn) == [0, 0, 0, 1, 1]
    backwards = TO_AND_FRO + np.array([180.0, 0.0, -180.0, 0.0, 180.0])
    assert groups(backwards + turn) == [0, 0, 0, 1, 1]


def test_directions_need_as_much_between_them_as_either_spans() -> None:
    assert groups(np.array([0.0, 10.0, 21.0, 30.0])) == [0, 0, 1, 1]
    assert groups(np.array([0.0, 12.0, 23.0, 30.0])) is None
    assert groups(TO_AND_FRO, distinct=10.0) is None


def test_narrow_directions_count_as_much_at_least() -> None:
    assert groups(np.array([0.0, 0.1, 4.9, 5.0])) is None
    assert groups(np.array([0.0, 0.1, 5.2, 5.3])) == [0, 0, 1, 1]
    assert groups(np.array([0.0, 0.1, 4.9, 5.0]), least_deg=2.0) == [0, 0, 1, 1]


def test_one_line_of_sight_has_no_second_direction() -> None:
    assert second_direction(np.array([30.0]), 1.0, 5.0) is None
    assert second_direction(np.zeros(0), 1.0, 5.0) is None
    assert second_direction(np.full(4, 30.0), 1.0, 5.0) is None
