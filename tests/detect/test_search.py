"""What makes a line: its stretch, its shape beside the best one's, and what is left when others are known."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from plnerf.detect.detect import (
    LEAST_ODDS,
    LEAST_SHARE,
    ROWS,
    SAGS_ALIKE,
    SLOPES_ALIKE,
    compile_search,
    conductors,
    ends_of,
    hang_alike,
    hangs,
    variants,
)
from plnerf.detect.narrow import curve_point
from plnerf.detect.refit import Fit
from plnerf.detect.search import FAINT, Line, drawn_out, stretches

LENGTH = 2.0


def line(
    y: float = 0.0, rise: float = 0.1, sag: float = 0.04, odds: float = 900.0, planes: int = ROWS
) -> Line:
    covariance = np.eye(5) * 1e-6
    return Line(Fit(np.array([y, y, 0.1, 0.1 + rise, sag]), covariance, 0.3), odds, planes, (0, ROWS - 1))


@given(st.lists(st.integers(-9, 9), min_size=1, max_size=12))
@settings(max_examples=200, deadline=None)
def test_a_stretch_is_the_largest_of_all_sums(odds: list[int]) -> None:
    total, first, last = stretches(np.array([odds], float))[:, 0]
    sums = [sum(odds[a:b]) for a in range(len(odds)) for b in range(a + 1, len(odds) + 1)]
    assert total == max(0, *sums)
    if total > 0:
        assert sum(odds[int(first) : int(last) + 1]) == total


def test_an_end_is_where_something_speaks_against_more() -> None:
    odds = np.array([-9.0, -1, -2, 4, 5, -1, 3, -2, -2, -2, 1])
    assert drawn_out(odds, 3, 6) == (1, 8)  # -3 before, -4 after; one plane more and it is beyond 5
    assert FAINT == 5
    assert drawn_out(np.full(4, 1.0), 1, 2) == (0, 3)
    assert drawn_out(np.array([2.0]), 0, 0) == (0, 0)


def test_alike_is_the_same_slope_and_about_the_same_sag() -> None:
    assert hang_alike(line(), line(y=0.3), LENGTH)
    assert hang_alike(line(), line(sag=0.04 * 0.99 * SAGS_ALIKE), LENGTH)
    assert not hang_alike(line(), line(sag=0.04 * 1.01 * SAGS_ALIKE), LENGTH)
    assert not hang_alike(line(), line(rise=0.1 + 1.01 * SLOPES_ALIKE * LENGTH), LENGTH)
    assert not hang_alike(line(), line(sag=-0.04), LENGTH)
    assert not hang_alike(line(sag=-0.04), line(sag=-0.04), LENGTH)
    for a, b in ((line(), line(sag=0.06)), (line(), line(sag=0.07)), (line(), line(rise=0.14))):
        assert hang_alike(a, b, LENGTH) == hang_alike(b, a, LENGTH)


def test_what_sags_by_no_more_than_its_doubt_does_not_hang() -> None:
    assert hangs(line(sag=0.004), LENGTH) and not hangs(line(sag=0.0019), LENGTH)
    doubtful = line(sag=0.02)
    doubtful.fit.covariance[4, 4] = 0.007**2
    assert not hangs(doubtful, LENGTH)


def test_conductors_hang_like_the_best_or_have_much_evidence() -> None:
    best, twin, road = line(odds=900.0), line(y=0.1, odds=210.0, planes=60), line(sag=0.0, odds=2000.0)
    short = line(y=-0.1, odds=210.0, planes=20)
    other, weak = line(sag=0.1, odds=LEAST_ODDS + 1), line(sag=0.1, odds=LEAST_ODDS - 1)
    part = line(sag=0.1, odds=LEAST_ODDS + 1, planes=int(LEAST_SHARE * ROWS) - 1)
    lines = [road, best, twin, short, other, weak, part]
    assert [id(one) for one in conductors(lines, LENGTH)] == [id(one) for one in (best, twin, other)]
    assert conductors([road], LENGTH) == [] == conductors([], LENGTH)


def test_conductors_that_hang_alike_end_where_the_longest_does() -> None:
    a, b, other = (
        replace(one, ends=ends)
        for one, ends in ((line(), (5, 60)), (line(y=0.1), (10, 80)), (line(sag=0.1), (0, 90)))
    )
    assert ends_of(a, [a, b, other], LENGTH) == ends_of(b, [a, b, other], LENGTH) == (5, 80)
    assert ends_of(other, [a, b, other], LENGTH) == (0, 90)


def test_variants_meet_the_line_in_three_places() -> None:
    own, other = line(rise=0.1, sag=0.04), line(y=0.2, rise=0.12, sag=0.05)
    found = variants(own, [own, other])
    assert len(found) == 4 and (found[0] == own.fit.q).all()
    for q, s in zip(found[1:], (1 / 6, 1 / 2, 5 / 6), strict=True):
        assert curve_point(q, s) == pytest.approx(curve_point(own.fit.q, s))
        assert q[[1, 3]] - q[[0, 2]] == pytest.approx(other.fit.q[[1, 3]] - other.fit.q[[0, 2]])
        assert q[4] == other.fit.q[4]


def test_compiling_needs_no_scene_and_warns_of_nothing(recwarn: pytest.WarningsRecorder) -> None:
    compile_search()
    assert not list(recwarn)
