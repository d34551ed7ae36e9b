"""Of two wires side by side each is fitted whole, though each was found as a part of both."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from tests.support.drawn import HALF, at_x, draw, hanging, polyline, scene_of, two_passes

from plnerf.detect import window_search
from plnerf.detect.candidate import Candidate
from plnerf.detect.config import DetectConfig, SelectConfig
from plnerf.detect.detect import detect_wires
from plnerf.detect.evidence import line_evidence
from plnerf.detect.line_ridges import joined_ridges
from plnerf.detect.merged import merged
from plnerf.detect.parabola import curve_odds
from plnerf.detect.search import Search
from plnerf.detect.together import parallel, untangled
from plnerf.detect.views import views_of
from plnerf.scene.scene import Scene

TWINS = (hanging(0.0, 0.07), hanging(0.0, 0.03))
X = np.linspace(-0.98 * HALF, 0.98 * HALF, 80)
DEFAULT = DetectConfig(select=SelectConfig(max_slope_difference=0.1))
"""Twins that swap their ends within half a metre of each other in this short span still hang alike."""
CLOSE = 0.003
"""A pixel at the distance of the passes."""


def theta_of(twin: int) -> np.ndarray:
    """The true curve on the planes X."""
    first, middle, last = at_x(TWINS[twin], np.array([X[0], 0.0, X[-1]]))
    return np.array([first[1], last[1], first[2], last[2], (first[2] + last[2]) / 2 - middle[2], 0.0])


@pytest.fixture(scope="module")
def twins(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    cameras = two_passes(8)
    return scene_of(tmp_path_factory.mktemp("twins"), cameras, draw(cameras, [polyline(w) for w in TWINS]))


def a_search(scene: Scene) -> Search:
    ahead = np.array([1.0, 0.0, 0.0])
    ridges = joined_ridges(
        line_evidence(scene.images, scene.cameras, scene.train, ahead, DEFAULT.evidence)
    )
    return Search(views_of(scene.cameras[list(scene.train)]), ridges, X, DEFAULT)


def masked(search: Search, thetas: Sequence[np.ndarray]) -> list[Candidate]:
    """Lines with the odds of curves beside each other, whose ridges are taken."""
    lines = []
    for theta in thetas:
        odds = float(curve_odds(search.views, search.odds, theta[None], X, 0.0)[0, :, 0].sum())
        lines.append(Candidate(theta, 1e-8 * np.eye(6), 0.3, 14, odds, (0, len(X) - 1), fixed=True))
        search.mask_ridges(lines[-1])
    return lines


def swapped(one: np.ndarray, other: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two curves whose last ends are each other's."""
    last = [False, True, False, True, False, False]
    return np.where(last, other, one), np.where(last, one, other)


def test_twins_that_were_taken_for_one_another_are_two_again(twins: Scene) -> None:
    search, true = a_search(twins), [theta_of(0), theta_of(1)]
    crossing = masked(search, swapped(*true))
    again = [line.theta for line in untangled(search, crossing)]
    nearest = [int(np.argmin([np.abs(theta - one).max() for one in true])) for theta in again]
    assert sorted(nearest) == [0, 1]
    assert all(np.abs(theta - true[k]).max() < CLOSE for theta, k in zip(again, nearest, strict=True))


def test_twins_that_run_side_by_side_stay_as_they_are(twins: Scene) -> None:
    search = a_search(twins)
    lines = masked(search, [theta_of(0), theta_of(1)])
    left, taken = search.claims.left.copy(), search.claims.masks.copy()
    assert parallel(lines[0], lines[1], search) > 0.99
    assert all(one is other for one, other in zip(untangled(search, lines), lines, strict=True))
    assert (search.claims.left == left).all() and (search.claims.masks == taken).all()


def test_two_that_cross_stay_as_they_are_where_nothing_is_likelier(twins: Scene) -> None:
    search = a_search(twins)
    lines = [replace(line, odds=1e6) for line in masked(search, swapped(theta_of(0), theta_of(1)))]
    taken = search.claims.masks.copy()
    assert all(one is other for one, other in zip(untangled(search, lines), lines, strict=True))
    assert (search.claims.masks == taken).all()


def test_only_lines_of_one_span_near_each_other_are_a_pair(twins: Scene) -> None:
    search = a_search(twins)
    one, other = masked(search, swapped(theta_of(0), theta_of(1)))
    assert parallel(one, other, search) < 0.1
    far = replace(other, theta=other.theta + DEFAULT.search.side_by_side * np.array([2, 2, 0, 0, 0, 0]))
    steep = replace(other, theta=other.theta + np.array([0, 0, 0, 0.3, 0, 0]))
    before, beyond = replace(one, seen=(0, 45)), replace(other, seen=(35, 79))
    for a, b in ((one, far), (one, steep), (before, beyond)):
        assert parallel(a, b, search) == 1.0


def mixture_and_piece(search: Search) -> list[Candidate]:
    """A line that leaves the first twin half way, and the rest of that twin."""
    leaving = theta_of(0) + np.array([-0.012, 0.02, 0.0, 0.0, 0.0, 0.0])
    mixture, piece = masked(search, [leaving, theta_of(0)])
    search.release(piece)
    piece = replace(piece, seen=(25, len(X) - 1))
    search.mask_ridges(piece)
    return [mixture, piece]


def test_a_piece_of_a_wire_and_a_mixture_are_one_line(twins: Scene) -> None:
    search = a_search(twins)
    lines = mixture_and_piece(search)
    lines = [replace(line, odds=line.odds / 2) for line in lines]  # each had its ridges alone
    (other,) = masked(search, [theta_of(1)])
    one, same = sorted(merged(search, [*lines, other]), key=lambda line: line is other)
    assert same is other and np.abs(one.theta - theta_of(0)).max() < CLOSE
    assert one.seen[0] < 5 and one.seen[1] > len(X) - 6


def test_two_that_meet_stay_where_one_has_less_than_both(twins: Scene) -> None:
    search = a_search(twins)
    lines = [replace(line, odds=1e6) for line in mixture_and_piece(search)]
    taken = search.claims.masks.copy()
    assert all(one is other for one, other in zip(merged(search, lines), lines, strict=True))
    assert (search.claims.masks == taken).all()


def test_twins_are_not_merged(twins: Scene) -> None:
    true = [theta_of(0), theta_of(1)]
    for curves in (true, swapped(*true)):
        search = a_search(twins)
        lines = masked(search, curves)
        assert all(one is other for one, other in zip(merged(search, lines), lines, strict=True))


def test_what_is_detected_is_what_is_left_of_pairs(twins: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    def without(search: Search, lines: Sequence[Candidate]) -> list[Candidate]:
        assert len(lines) >= len(TWINS)
        return []

    monkeypatch.setattr(window_search, "untangled", without)
    assert detect_wires(twins, DEFAULT) == ()
