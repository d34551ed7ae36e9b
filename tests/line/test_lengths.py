"""The length of a wire between its attachments, and whether the world's z is a height."""

from dataclasses import replace

import numpy as np
import pytest

from plnerf.errors import SurveyError
from plnerf.line.ends import Attached, Open
from plnerf.line.frame import LineFrame
from plnerf.line.hang import hang
from plnerf.line.polylines import lengths_along, resample
from plnerf.line.wire import Wire
from plnerf.scene import memory

SIGMA = np.array([0.05, 0.05, 0.04, 0.04, 0.03, 0.0])


def held(sigma_m: float) -> Wire:
    wire = hang((3.0, -2.0, 20.0), (150.0, 40.0, 31.0), 5.0)
    first, last = (
        replace(end, sigma_m=sigma_m) for end in wire.ends if isinstance(end, Attached)
    )  # fmt: skip
    return replace(wire, covariance=np.diag(SIGMA**2), ends=(first, last))


def test_the_length_is_that_of_the_curve() -> None:
    wire = held(0.0)
    assert wire.arc_m is not None
    assert wire.arc_m.value == pytest.approx(lengths_along(wire.polyline(0.01))[-1], abs=1e-4)


def test_its_deviation_is_that_of_drawn_curves() -> None:
    wire, random = held(0.0), np.random.default_rng(0)
    draws = [
        replace(wire, theta=wire.theta + SIGMA * random.normal(size=6)).length_m for _ in range(4000)
    ]  # fmt: skip
    assert wire.arc_m is not None and wire.arc_m.sigma == pytest.approx(np.std(draws), rel=0.06)


def test_uncertain_ends_make_it_uncertain() -> None:
    exact, loose = held(0.0).arc_m, held(0.2).arc_m
    assert exact is not None and loose is not None and exact.value == loose.value
    more = np.sqrt(loose.sigma**2 - exact.sigma**2)
    assert more == pytest.approx(np.hypot(0.2, 0.2), rel=0.02)  # along the wire, little longer than its base


def test_samples_that_do_not_fit_into_memory_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """A coordinate with a digit too many makes a wire of a million kilometres."""
    monkeypatch.setattr(memory, "available_bytes", lambda: 8e9)
    far = np.array([[0.0, 0.0, 0.0], [1e9, 0.0, 0.0]])
    with pytest.raises(SurveyError, match=r"A line that is 1e\+09 long, sampled every 0\.01, needs at least"):
        resample(far, 0.01)
    with pytest.raises(SurveyError, match="Correct its coordinates"):
        hang(far[0], far[1], 1.0).polyline(0.01)


def test_between_open_ends_there_is_none() -> None:
    wire = held(0.0)
    assert replace(wire, ends=(wire.ends[0], Open("hidden"))).arc_m is None


@pytest.mark.parametrize(("degrees", "upright"), [(0.0, True), (0.05, True), (0.2, False), (90.0, False)])
def test_a_leaning_world_has_no_heights(degrees: float, upright: bool) -> None:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    lean = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    turn = np.array([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
    assert LineFrame(turn @ lean, 1.0, np.zeros(3), "m").upright == upright
