"""A byte holds the way a ridge runs."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from plnerf.detect.line_ridges import HALF_TURN, LineRidges, joined_ridges, steps_of, turned

ANGLES = st.floats(-7.0, 7.0)


@settings(deadline=None)  # the first call compiles
@given(ANGLES, ANGLES)
def test_in_steps_a_tangent_is_the_same_to_half_a_step(one: float, other: float) -> None:
    """Whichever of its two ways it points."""
    apart = abs((one - other + np.pi / 2) % np.pi - np.pi / 2)
    for turn in (0.0, np.pi, -np.pi):
        (tangent,) = steps_of(np.array([one + turn]))
        assert abs(turned(tangent, other) - apart) < 0.51 * np.pi / HALF_TURN + 1e-9


def test_images_follow_one_another() -> None:
    parts = [LineRidges(np.full((h, 2), h, np.float32), np.full((h, 2), 10 + h, np.uint8)) for h in (1, 2)]
    response, tangent = joined_ridges(parts)
    assert response.tolist() == [1, 1, 2, 2, 2, 2] and tangent.tolist() == [11, 11, 12, 12, 12, 12]
