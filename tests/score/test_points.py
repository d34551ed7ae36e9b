"""The score of wires obeys what everybody takes for granted of it."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.support.spans import SPAN_M, on, span, turned, wire

from plnerf.errors import ConfigError
from plnerf.line.polylines import lengths_along
from plnerf.line.wire import Wire
from plnerf.score.config import DEFAULT, PointScoreConfig
from plnerf.score.points import PointScore, score_points
from plnerf.score.truth import Truth

CONFIG = DEFAULT.points

TRUTH = span(wire(-2.0), wire(2.0), wire(0.0, 12.0, sag_m=0.8))


def noisy(seed: int, truth: Truth = TRUTH) -> np.ndarray:
    """Points scattered about the wires, with holes, strays, and clutter in between."""
    rng = np.random.default_rng(seed)
    points = on(truth, 0.05)
    points = points[rng.random(len(points)) < 0.6] + rng.normal(0, 0.04, (1, 3))
    points += rng.normal(0, 0.05, points.shape)
    clutter = rng.uniform([-15, -4, 3], [15, 4, 13], (300, 3))
    return np.concatenate([points, clutter])


def seen(wire: Wire, *stretches: tuple[float, float]) -> Wire:
    """The wire of which images show so much."""
    return replace(wire, evidence=replace(wire.evidence, seen_m=stretches))


def numbers(score: PointScore) -> np.ndarray:
    """All of a score's numbers but the counts of points."""
    wires = [
        (
            *w.recall,
            w.covered_share,
            w.longest_gap_m,
            w.fragments,
            w.vertical_rmse_m or -1,
            w.horizontal_rmse_m or -1,
        )
        for w in score.wires
    ]
    return np.array([*score.recall, *score.precision, *score.f1, *np.ravel(wires)])


def test_perfect_points_score_one_everywhere() -> None:
    score = score_points(on(TRUTH), TRUTH)
    assert score.recall == score.precision == score.f1 == (1, 1, 1)
    for line in score.wires:
        assert line.recall == (1, 1, 1) and line.covered_share == 1 and line.fragments == 1
        assert line.longest_gap_m <= 0.02 + 1e-9
        assert line.vertical_rmse_m is not None and line.horizontal_rmse_m is not None
        assert max(line.vertical_rmse_m, line.horizontal_rmse_m) < 1e-6
    lengths = [lengths_along(line.polyline())[-1] for line in TRUTH.wires]
    assert np.allclose([w.scored_m for w in score.wires], np.array(lengths) - 2 * CONFIG.tower_m, atol=0.03)
    assert not score.notes


@given(st.floats(0, 2 * np.pi), st.sampled_from([0.07, 0.15, 0.2]))
@settings(max_examples=20, deadline=None)
def test_shifted_wires_are_right_at_the_tolerances_above_their_shift(angle: float, shift_m: float) -> None:
    score = score_points(on(TRUTH) + shift_m * np.array([0, np.cos(angle), np.sin(angle)]), TRUTH)
    for t, tolerance in enumerate(CONFIG.tolerances_m):
        assert score.recall[t] == score.precision[t] == score.f1[t] == float(shift_m < tolerance)
    for line in score.wires:
        assert line.horizontal_rmse_m == pytest.approx(shift_m * abs(np.cos(angle)), abs=1e-5)
        assert line.vertical_rmse_m == pytest.approx(shift_m * abs(np.sin(angle)), abs=1e-5)
        assert line.covered_share == 1 and line.fragments == 1


@given(st.floats(-15, 13), st.floats(0.6, 2.5))
@settings(max_examples=20, deadline=None)
def test_a_hole_is_found_as_long_as_it_is(start: float, length_m: float) -> None:
    line = on(span(wire(0.0)), 0.01)
    along = lengths_along(line)
    begin = along[np.searchsorted(line[:, 0], start)]
    kept = line[(along <= begin) | (along >= begin + length_m)]
    (found,) = score_points(kept, span(wire(0.0))).wires
    assert found.longest_gap_m == pytest.approx(length_m, abs=0.021)
    assert found.longest_gap_from_m == pytest.approx(start + SPAN_M / 2, abs=0.03)
    assert found.fragments == 2
    assert found.covered_share == pytest.approx(1 - length_m / found.scored_m, abs=1e-3)
    for t, tolerance in enumerate(CONFIG.tolerances_m):  # the points at its edges reach into it
        assert found.recall[t] == pytest.approx(1 - (length_m - 2 * tolerance) / found.scored_m, abs=1e-3)


def test_gaps_that_are_joined_part_nothing() -> None:
    line = on(span(wire(0.0)), CONFIG.join_m - 0.01)
    (found,) = score_points(line, span(wire(0.0))).wires
    assert found.fragments == 1 and found.covered_share == 1
    (parted,) = score_points(on(span(wire(0.0)), CONFIG.join_m + 0.05), span(wire(0.0))).wires
    assert parted.fragments > 60 and parted.covered_share == pytest.approx(0, abs=0.03)


@given(st.integers(0, 99), st.data())
@settings(max_examples=15, deadline=None)
def test_duplicates_and_order_change_nothing(seed: int, data: st.DataObject) -> None:
    points = noisy(seed)
    rng = np.random.default_rng(data.draw(st.integers(0, 99)))
    again = np.concatenate([points, points[rng.integers(0, len(points), 400)]])
    rng.shuffle(again)
    assert (numbers(score_points(again, TRUTH)) == numbers(score_points(points, TRUTH))).all()


@given(st.integers(0, 99), st.floats(-4, 4), st.tuples(*[st.floats(-500, 500)] * 3))
@settings(max_examples=15, deadline=None)
def test_moving_points_and_truth_together_changes_nothing(
    seed: int, turn_rad: float, shift: tuple[float, float, float]
) -> None:
    motion, points = turned(turn_rad, np.array(shift)), noisy(seed)
    a, b = score_points(points, TRUTH), score_points(motion(points), TRUTH.moved(motion))
    assert numbers(a) == pytest.approx(numbers(b), abs=1e-6)


def test_density_does_not_weigh() -> None:
    """A right wire a hundred times as dense as a wrong one of its length: half is right."""
    truth = span(wire(0.0))
    right, wrong = on(truth, 0.0005), on(truth, 0.045) + np.array([0.0, 3.0, 0.0])
    assert score_points(np.concatenate([right, wrong]), truth).precision[0] == pytest.approx(0.5, abs=0.13)
    right, wrong = on(truth, 0.0005), on(truth, 0.01) + np.array([0.0, 3.0, 0.0])
    assert score_points(np.concatenate([right, wrong]), truth).precision[0] == pytest.approx(0.5, abs=0.03)


def test_far_clutter_lowers_precision_only() -> None:
    points = noisy(1)
    clutter = np.random.default_rng(0).uniform([-15, -30, 0], [15, -8, 20], (500, 3))
    before, after = score_points(points, TRUTH), score_points(np.concatenate([points, clutter]), TRUTH)
    assert after.recall == before.recall and after.wires == before.wires
    assert after.far == before.far + 500
    assert all(low < high for low, high in zip(after.precision, before.precision, strict=True))


def test_nothing_scores_zero_and_says_so() -> None:
    score = score_points(np.empty((0, 3)), TRUTH)
    assert score.recall == score.precision == score.f1 == (0, 0, 0)
    assert score.notes == ("The survey holds no points, so all scores are 0.",)
    for line in score.wires:
        assert line.covered_share == 0 and line.fragments == 0 and line.vertical_rmse_m is None
        assert line.longest_gap_m == pytest.approx(line.scored_m)


def test_twins_are_scored_each_for_itself() -> None:
    """Two conductors 0.4 m apart, and two of a bundle 0.2 m apart: one of them does not stand for both."""
    for apart_m in (0.4, 0.2):
        truth = span(wire(0.0, name="left"), wire(apart_m, name="right"))
        left, right = score_points(on(span(wire(0.0))), truth).wires
        assert left.recall == (1, 1, 1) and right.recall == (0, 0, 0)
        assert right.covered_share == 0 and right.vertical_rmse_m is None
        assert score_points(on(truth), truth).f1 == (1, 1, 1)


def test_what_is_not_seen_and_what_hangs_at_towers_counts_neither_way() -> None:
    line = seen(wire(0.0), (5.0, 15.0), (20.0, 30.0))
    truth = span(line)
    points = on(truth)
    s = line.base.local(points)[:, 0]
    shown = ((s >= 5) & (s <= 15)) | ((s >= 20) & (s <= 30))
    for kept in (points, points[shown]):
        score = score_points(kept, truth)
        (found,) = score.wires
        assert score.f1 == (1, 1, 1) and found.fragments == 1 and found.covered_share == 1
        assert 20 < found.scored_m < 20.2 and found.longest_gap_m < 0.05
    edge = np.abs(s[:, None] - np.array([5, 15, 20, 30])).min(1) < 0.02  # which are cells at the edge's
    astray = points + np.where((shown | edge)[:, None], 0.0, 0.8) * np.array([0.0, 1.0, 0.0])
    insulators = np.array([[-20.0, 0.0, 10.0 + h] for h in np.linspace(0.1, 0.95, 50)])
    body = np.array([[20.3, 0.2, h] for h in np.linspace(0.0, 13.5, 500)])
    score = score_points(np.concatenate([astray, insulators, body]), truth)
    assert score.f1 == (1, 1, 1) and score.neutral > 1000
    unseen = score_points(points, span(seen(line), wire(3.0)))
    assert "Not scored, being seen in too few images: y 0." in unseen.notes
    assert unseen.wires[0].scored_m == 0


def test_points_of_another_frame_are_told() -> None:
    notes = score_points(on(TRUTH) + np.array([4e5, 5.4e6, 0]), TRUTH).notes
    assert any("is the survey in the world frame" in note for note in notes)


def test_points_that_are_nearly_right_cover_but_are_not_found() -> None:
    """Within 25 cm a wire is covered, though no more than that tolerance finds it."""
    truth = span(wire(0.0))
    (line,) = score_points(on(truth) + np.array([0.0, CONFIG.cover_m - 0.01, 0.0]), truth).wires
    assert line.recall == (0, 0, 1) and line.covered_share == 1


def test_the_configuration_decides() -> None:
    """Other tolerances, other distances from towers; what makes no sense is refused."""
    truth = span(wire(0.0))
    points = on(truth) + np.array([0.0, 0.12, 0.0])
    score = score_points(points, truth, PointScoreConfig(tolerances_m=(0.11, 0.13), tower_m=3.0))
    assert score.recall == (0, 1) and score.wires[0].scored_m == pytest.approx(34.1, abs=0.1)
    for wrong in ({"tolerances_m": ()}, {"tolerances_m": (0.1, 0.05)}, {"cell_m": 0.0}):
        with pytest.raises(ConfigError):
            PointScoreConfig(**wrong)  # type: ignore[arg-type]
