"""Lines that cross: how near their wires come to each other, and what is said of it."""

from dataclasses import replace

import numpy as np
import pytest
from tests.support.many_spans import bent, line_along, lines_of, swung

from plnerf.line.hang import hang
from plnerf.survey.crossings import crossing_of

LEVEL = hang((0.0, 0.0, 20.0), (100.0, 0.0, 20.0), 4.0, id=1)


def dense(wire: object) -> np.ndarray:
    return wire.points(np.linspace(0, wire.base.length_m, 4001))  # type: ignore[attr-defined]


@pytest.mark.parametrize("degrees", [0.0, 12.0])
@pytest.mark.parametrize("height", [8.0, 26.0])
def test_the_distance_of_two_wires_is_that_of_brute_force(degrees: float, height: float) -> None:
    one = swung(LEVEL, degrees)
    other = hang((30.0, -40.0, height), (70.0, 60.0, height + 5), 3.0, id=7)
    found = crossing_of(one, other)
    assert found is not None
    assert (found.upper, found.lower) == ((1, 7) if height < 20 else (7, 1))
    a, b = dense(one), dense(other)
    apart = np.linalg.norm(a[:, None, :] - b[None, ::8], axis=2).min()
    assert found.distance_m == pytest.approx(apart, abs=2e-3) and found.vertical_m > found.distance_m - 1e-6
    assert np.linalg.norm(found.on_upper - found.on_lower) == pytest.approx(found.distance_m)
    upper = one if found.upper == 1 else other
    assert np.abs(upper.points(np.array([found.s_upper_m]))[0] - found.on_upper).max() < 1e-9
    swapped = crossing_of(other, one)
    assert swapped is not None and swapped.distance_m == pytest.approx(found.distance_m, abs=1e-6)
    assert (swapped.upper, swapped.s_upper_m) == (found.upper, pytest.approx(found.s_upper_m, abs=1e-3))


def test_wires_that_do_not_cross_have_no_crossing() -> None:
    assert crossing_of(LEVEL, hang((0.0, 5.0, 20.0), (100.0, 5.0, 20.0), 4.0)) is None  # side by side
    assert crossing_of(LEVEL, hang((30.0, 2.0, 9.0), (50.0, 60.0, 9.0), 1.0)) is None  # ends before
    assert crossing_of(LEVEL, hang((130.0, -40.0, 9.0), (150.0, 60.0, 9.0), 1.0)) is None  # beyond


@pytest.mark.slow
def test_the_stated_deviation_is_that_of_draws() -> None:
    random = np.random.default_rng(3)
    one = swung(LEVEL, 5.0)
    other = swung(hang((30.0, -40.0, 8.0), (70.0, 60.0, 12.0), 3.0, id=7), 0.0)
    found = crossing_of(one, other)
    assert found is not None
    drawn = []
    for _ in range(300):
        pair = [
            replace(wire, theta=random.multivariate_normal(wire.theta, wire.covariance))
            for wire in (one, other)
        ]
        again = crossing_of(*pair)
        assert again is not None
        drawn.append(again.distance_m)
    assert np.std(drawn) == pytest.approx(found.sigma_m, rel=0.15)


def test_a_survey_states_its_crossings_and_no_verdict_on_them() -> None:
    survey = bent()
    found = survey.clearances
    assert found is not None
    main, low = survey.lines
    pairs = {(one.upper, one.lower) for one in found.crossings}
    assert pairs == {(a.id, b.id) for a in main.spans[1].wires for b in low.wires}
    distances = [one.distance_m for one in found.crossings]
    assert distances == sorted(distances) and 3 < distances[0] < 9
    (said,) = [one.what for one in survey.findings if one.kind == "crossing lines"]
    least = found.crossings[0]
    assert said == (
        f"Line 1 crosses over line 2, {least.distance_m:.2f} m from wire {least.upper} to wire {least.lower} "
        "at the nearest. No requirement is applied between lines."
    )
    assert any("required of the phase conductors of all 2 lines" in one.what for one in survey.findings)
    assert not {place.to for place in found.all_places()} - {"ground", "vegetation", "structures", "other"}
    alone = lines_of(survey, main)
    assert alone.clearances is not None and not alone.clearances.crossings
    assert not any("lines" in one.kind or "all 2 lines" in one.what for one in alone.findings)


@pytest.mark.slow
def test_wires_of_another_line_are_no_obstacles() -> None:
    """Neither as they are labelled, nor as points of no class on them."""
    survey = bent()
    labels = survey.cloud.label.copy()
    labels[survey.cloud.wire > 12] = 1
    for cloud in (
        survey.cloud,
        replace(survey.cloud, label=labels, wire=np.where(survey.cloud.wire > 12, 0, survey.cloud.wire)),
    ):
        found = lines_of(replace(survey, cloud=cloud), *survey.lines).clearances
        assert found is not None and not any(one.places["other"] for one in found.wires)


def test_what_stands_outside_of_a_bend_is_measured_in_clouds_of_images_too() -> None:
    """It is beside none of the spans' wires, but beyond the ends of both."""
    line = line_along(((0.0, 0.0), (60.0, 0.0), (90.0, 52.0)), [(0.0, 12.0, "phase")])
    survey = replace(bent(), lines=(line,))
    tree = np.array([[62.0, -7.5, 10.0]])
    local = [wire.base.local(tree)[0, 0] - wire.base.length_m * (k == 0) for k, wire in enumerate(line.wires)]
    assert local[0] > 0 > local[1]
    cloud = replace(
        survey.cloud,
        xyz=tree,
        label=np.array([5], np.uint8),
        wire=np.zeros(1, np.int64),
        sigma_m=np.full(1, 0.1),
    )
    found = lines_of(replace(survey, cloud=cloud), line).clearances
    assert found is not None
    distance = float(np.linalg.norm(tree[0] - line.spans[0].wires[0].points(np.array([60.0]))[0]))
    for one in found.wires:
        least = one.least("vegetation")
        assert least is not None and least.distance_m == pytest.approx(distance, abs=1e-3)
    alone = replace(line, spans=line.spans[:1])  # where the line ends it may be of what holds it
    single = lines_of(replace(survey, cloud=cloud), alone).clearances
    assert single is not None and single.wires[0].least("vegetation") is None
