"""A line that is one wire from the one side and another from the other gives way to both wires."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.detect.test_together import X, a_search, masked
from tests.support.drawn import at_x, draw, hanging, polyline, scene_of, two_passes

from plnerf.detect import uncrossed as module
from plnerf.detect.candidate import Candidate
from plnerf.detect.search import Search
from plnerf.detect.uncrossed import uncrossed
from plnerf.scene.scene import Scene

WIRES = (hanging(-0.05, 0.0), hanging(0.05, -0.08))


def theta_of(wire: int) -> np.ndarray:
    """The true curve on the planes X."""
    first, middle, last = at_x(WIRES[wire], np.array([X[0], 0.0, X[-1]]))
    return np.array([first[1], last[1], first[2], last[2], (first[2] + last[2]) / 2 - middle[2], 0.0])


@pytest.fixture(scope="module")
def to_and_fro(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    """Two tracks that weave a little, from whose sides the planes of two wires nearly meet in four lines."""
    cameras = two_passes(8, wobble=0.03)
    return scene_of(tmp_path_factory.mktemp("fro"), cameras, draw(cameras, [polyline(w) for w in WIRES]))


def candidate(theta: np.ndarray, *, fixed: bool) -> Candidate:
    return Candidate(theta, 1e-8 * np.eye(6), 0.3, 8, 1.0, (0, len(X) - 1), fixed=fixed)


@pytest.mark.parametrize("one", [0, 1])
def test_a_wire_is_where_lines_of_sight_to_two_crossed_lines_meet(to_and_fro: Scene, one: int) -> None:
    """A line is the one wire from one side and the other from the other, another lies anywhere on a line of
    sight to a wire: of the two places where such lines of sight cross one is the wire, to within what the
    tracks weave."""
    search = a_search(to_and_fro)
    y, z = 0.45 * np.array([1.0, -1.0]), np.array([0.2, 0.05])  # where the two tracks are
    wire, other = theta_of(one), theta_of(1 - one)
    away = candidate(moved(wire, 0.05, y[0], z[0]), fixed=False)
    mixture = candidate(moved(wire, 0.08, y[1], z[1]), fixed=True)
    places = list(module._crossings(search, mixture, away))
    assert len(places) == 2
    assert min(np.abs(theta - wire).max() for theta in places) < 0.02
    assert min(np.abs(theta - other)[:4].max() for theta in places) > 0.05


def moved(theta: np.ndarray, by: float, y: float, z: float) -> np.ndarray:
    """A curve moved by a part of its way towards a place, at its middle."""
    dy, dz = by * (y - theta[0]), by * (z - theta[2] + theta[4])
    return theta + np.array([dy, dy, dz, dz, 0.0, 0.0])


def test_of_two_that_take_others_places_the_loose_one_is_left_to_be_found(
    to_and_fro: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    search = a_search(to_and_fro)
    old = masked(search, [theta_of(0), theta_of(1)])
    old[1] = replace(old[1], fixed=False)
    new = [replace(line) for line in old]

    def two(search: Search, a: Candidate, b: Candidate, starts: np.ndarray) -> tuple[Candidate, Candidate]:
        assert (a, b) == tuple(old) and starts.shape == (2, 2, 6)
        return new[0], new[1]

    monkeypatch.setattr(module, "likelier_two", two)
    assert uncrossed(search, old) == new[:1]
    alone = a_search(to_and_fro)
    masked(alone, [theta_of(0)])
    assert (search.claims.masks == alone.claims.masks).all()


def test_wires_stay_as_they_are(to_and_fro: Scene) -> None:
    search = a_search(to_and_fro)
    lines = masked(search, [theta_of(0), theta_of(1)])
    lines[1] = replace(lines[1], fixed=False)
    lines = [replace(line, odds=1e6) for line in lines]  # nothing is likelier
    left, taken = search.claims.left.copy(), search.claims.masks.copy()
    assert all(one is other for one, other in zip(uncrossed(search, lines), lines, strict=True))
    assert (search.claims.left == left).all() and (search.claims.masks == taken).all()


def test_only_a_fixed_line_and_one_that_is_not_are_tried(
    to_and_fro: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    tried = []
    monkeypatch.setattr(module, "_crossings", lambda search, *lines: tried.append(lines) or iter(()))
    search = a_search(to_and_fro)
    fixed, other = (candidate(theta_of(k), fixed=True) for k in (0, 1))
    loose, away = replace(other, fixed=False), replace(other, fixed=False, seen=(0, 10))
    uncrossed(search, [fixed, other])
    uncrossed(search, [loose, loose])
    uncrossed(search, [replace(fixed, seen=(40, 79)), away])
    assert not tried
    uncrossed(search, [loose, fixed])
    assert tried == [(fixed, loose)]


def test_views_of_more_than_two_directions_are_left_alone(tmp_path: Path) -> None:
    cameras = two_passes(8, wobble=0.3)
    scene = scene_of(tmp_path, cameras, draw(cameras, [polyline(w) for w in WIRES]))
    search = a_search(scene)
    true = [candidate(theta_of(k), fixed=k == 0) for k in (0, 1)]
    assert list(module._crossings(search, *true)) == []
