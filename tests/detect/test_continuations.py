"""Lines that begin where wires end are told from lines that pass elsewhere, or begin elsewhere."""

from dataclasses import replace

import numpy as np
import pytest
from tests.support.drawn import FRAMES, hanging

from plnerf.detect.candidate import Candidate
from plnerf.detect.config import SearchConfig, SelectConfig
from plnerf.detect.continuations import ends_of_lines, ends_of_wires, goes_on, of_next_span, slopes_of
from plnerf.detect.parabola import curve_points
from plnerf.detect.windows import Window
from plnerf.line.frame import LineFrame

CONFIG = SearchConfig()
X = np.linspace(-1, 1, 81)
END = np.array([[[0.1, 0.3, 0.2], [0.3, 0.4, 0.2]]])
"""Of a wire that runs at 27 degrees to the window, about (0.2, 0.35, 0.2)."""


def through(x: float, y: float, z: float, climb: float = 0.1) -> np.ndarray:
    """A curve along the window that climbs by so much over its length."""
    low = z - climb * (x + 1) / 2
    return np.array([[y, y, low, low + climb, 0.0, 0.0]])


def test_a_line_that_crosses_the_end_and_is_seen_beside_it_goes_on() -> None:
    seen = np.array([[-0.5, 0.15]])
    assert goes_on(through(0.2, 0.35, 0.2), seen, END, X, CONFIG).tolist() == [True]
    assert goes_on(through(0.29, 0.395, 0.2), seen, END, X, CONFIG).tolist() == [True]
    for curve in (through(0.2, 0.35, 0.2 + 2 * CONFIG.onward), through(0.2, 0.45, 0.2)):  # above it; past it
        assert goes_on(curve, seen, END, X, CONFIG).tolist() == [False]
    elsewhere = np.array([[-0.9, 0.2 - 1.5 * CONFIG.around]])
    assert goes_on(through(0.2, 0.35, 0.2), elsewhere, END, X, CONFIG).tolist() == [False]
    assert goes_on(through(0.2, 0.35, 0.2), seen, np.zeros((0, 2, 3)), X, CONFIG).tolist() == [False]


def test_ends_of_lines_are_pieces_of_their_curves() -> None:
    theta = np.array([0.1, 0.2, 0.3, 0.35, 0.05, 0.01])
    line = Candidate(theta, np.eye(6), 0.3, 9, 900.0, (20, 60), fixed=True)
    ends = ends_of_lines([line, replace(line, fixed=False)], X, CONFIG.around)
    assert ends.shape == (2, 2, 3) and ends[:, :, 0].mean(1) == pytest.approx(X[[20, 60]])
    y, z = curve_points(theta, (ends[:, :, 0] + 1) / 2)
    np.testing.assert_allclose(ends[:, :, 1:], np.stack([y, z], -1))


def test_ends_of_wires_are_where_they_are_in_a_turned_window() -> None:
    frame = LineFrame.of_scene(FRAMES)
    window = Window(np.array([0.1, 0.2, 0.0]), 0.7, 0.5, -np.ones(2), np.ones(2), np.arange(1), 80)
    wire = hanging(0.05, 0.1, 0.03)
    (first, last) = ends_of_wires([wire], window, frame, CONFIG.around)
    on = frame.from_scene(window.to_scene(np.concatenate([first, last])))
    near = CONFIG.around * window.unit_m(frame)
    assert wire.base.local(on)[:, 0] == pytest.approx(
        [-near, near, wire.base.length_m - near, wire.base.length_m + near]
    )
    np.testing.assert_allclose(wire.base.local(on)[:, 1:], wire.at(wire.base.local(on)[:, 0]), atol=1e-9)
    doubtful = replace(wire, evidence=replace(wire.evidence, certain=False))
    assert not len(ends_of_wires([doubtful], window, frame, CONFIG.around))


def test_slopes_are_those_where_a_line_is_seen() -> None:
    theta = np.array([0.1, 0.2, 0.3, 0.35, 0.05, 0.01])
    line = Candidate(theta, np.eye(6), 0.3, 9, 900.0, (10, 30))
    s, step = 20 / 80, 1e-5
    y, z = np.subtract(curve_points(theta, s + step), curve_points(theta, s - step)) / (2 * step * 2.0)
    assert slopes_of(line, X) == pytest.approx([y, z])


def test_a_faint_line_alone_is_none_of_the_next_span() -> None:
    select = SelectConfig()
    one = Candidate(through(0.2, 0.3, 0.2)[0], np.eye(6), 0.3, 9, 90.0, (30, 50))
    beside = replace(one, theta=through(0.2, 0.5, 0.2, climb=0.1 + 1.9 * select.max_slope_difference)[0])
    steeper = replace(one, theta=through(0.2, 0.5, 0.2, climb=0.1 + 2.1 * select.max_slope_difference)[0])
    assert of_next_span([one, beside], X, select) == [one, beside]
    assert of_next_span([one, steeper], X, select) == of_next_span([one], X, select) == []
    on_ground = replace(beside, likeness=1.01 * select.lies_alike)
    assert of_next_span([one, on_ground], X, select) == []


def test_a_line_that_surely_bends_upwards_is_no_wire() -> None:
    select = SelectConfig()
    known = np.diag([1e-6] * 4 + [0.01**2, 1e-6])
    one = Candidate(through(0.2, 0.3, 0.2)[0], known, 0.3, 9, 90.0, (30, 50))
    bent = -0.01 * select.sag_sigmas_free * np.eye(6)[4]
    beside = replace(one, theta=through(0.2, 0.5, 0.2)[0] + 0.99 * bent)
    upwards = replace(beside, theta=through(0.2, 0.5, 0.2)[0] + 1.01 * bent)
    assert of_next_span([one, beside], X, select) == [one, beside]
    assert of_next_span([one, upwards], X, select) == []


def test_a_clear_line_alone_is_one_of_the_next_span_if_it_hangs() -> None:
    select = SelectConfig()
    curve = through(0.2, 0.3, 0.2)[0]
    hanging_a_little, standing = curve + 0.01 * np.eye(6)[4], curve - 0.01 * np.eye(6)[4]
    one = Candidate(hanging_a_little, np.eye(6), 0.3, 9, 1.01 * select.min_odds, (30, 50))
    assert of_next_span([one], X, select) == [one]
    for other in (
        replace(one, odds=0.99 * select.min_odds),
        replace(one, theta=standing),
        replace(one, likeness=1.01 * select.lies_alike),
    ):
        assert of_next_span([other], X, select) == []
