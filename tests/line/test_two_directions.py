"""Which lines of sight come from the second of two directions."""

import numpy as np
import pytest

from plnerf.line.two_directions import by_ends_and_middle, second_direction, through_sights

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


def test_a_parabola_is_found_by_the_lines_of_sight_to_it() -> None:
    """Targets lie anywhere on them, and of a curve that is seen whole the tie does not matter."""
    rng = np.random.default_rng(0)
    s, true = np.linspace(0.0, 1.0, 7), np.array([[1.0, 2.0, 0.3], [9.0, 10.0, -1.4]])
    places = by_ends_and_middle(s) @ true.T
    np.testing.assert_allclose(places[[0, 3, 6]], [[1.0, 9.0], [1.8, 8.1], [2.0, 10.0]])
    eyes = np.array([[-8.0, 3.0], [9.0, 5.0], [10.0, 6.0]])
    targets = eyes[:, None] + rng.uniform(0.5, 2.0, (3, 7, 1)) * (places - eyes[:, None])
    sees = np.ones((3, 7), np.bool_)
    sees[1, :2] = False
    targets[1, :2] = 50.0  # not looked at
    found = through_sights(eyes, sees, targets, s, np.zeros(2), 1e3)
    np.testing.assert_allclose(found, true, atol=1e-6)


def test_a_piece_hangs_as_it_is_tied() -> None:
    s, eyes = np.linspace(0.5, 0.5, 2), np.array([[-8.0, 3.0], [9.0, 5.0]])
    targets = np.broadcast_to([1.5, 8.0], (2, 2, 2))
    found = through_sights(eyes, np.ones((2, 2), np.bool_), targets, s, np.array([0.1, -1.0]), 0.01)
    np.testing.assert_allclose(found[:, 2], [0.1, -1.0], atol=1e-3)
    np.testing.assert_allclose(by_ends_and_middle(s[:1]) @ found.T, [[1.5, 8.0]], atol=1e-3)
