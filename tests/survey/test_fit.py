"""Catenaries are fitted to points: exactly, against outliers, and as uncertain as they say."""

import numpy as np
import pytest

from plnerf.errors import SurveyError
from plnerf.line.catenary import Catenary, hang
from plnerf.survey.fit import base_of, fit_catenary

WIRES = {
    "level": hang((500_000.0, 5_700_000.0, 20.0), (500_040.0, 5_700_009.0, 20.4), 1.4),
    "steep": hang((0.0, 0.0, 60.0), (-80.0, 210.0, 110.0), 9.0),
    "taut": hang((5.0, 5.0, 30.0), (405.0, 5.0, 12.0), 0.02),
    "deep": hang((0.0, 0.0, 30.0), (30.0, 0.0, 30.0), 12.0),
}


def on(wire: Catenary, count: int, low: float = 0.0, high: float = 1.0) -> np.ndarray:
    return wire.points(np.linspace(low * wire.span_m, high * wire.span_m, count))


@pytest.mark.parametrize("name", WIRES)
def test_points_of_a_wire_give_it_back(name: str) -> None:
    wire = WIRES[name]
    fit = fit_catenary(on(wire, 60)[::-1])  # in whatever order
    assert fit.curve.sag_m == pytest.approx(wire.sag_m, abs=1e-5)
    assert fit.curve.p_m == pytest.approx(wire.p_m, rel=1e-3)
    assert fit.curve.length_m == pytest.approx(wire.length_m, abs=1e-5)
    assert fit.inlier.all() and fit.residual_up_m < 1e-5 and fit.residual_across_m < 1e-5
    ends = sorted([fit.curve.a, fit.curve.b])
    assert np.abs(np.array(ends) - sorted([wire.a, wire.b])).max() < 1e-4


@pytest.mark.parametrize("name", ["level", "steep", "deep"])
def test_a_third_of_gross_outliers_is_told_apart(name: str) -> None:
    wire, random = WIRES[name], np.random.default_rng(1)
    points = on(wire, 200) + 0.02 * random.normal(size=(200, 3))
    wrong = random.random(200) < 0.33
    points[wrong] += random.uniform(0.5, 6.0, (wrong.sum(), 3))
    fit = fit_catenary(points, base_of(on(wire, 2)))
    assert not fit.inlier[wrong].any() and fit.inlier[~wrong].mean() > 0.97
    assert fit.curve.sag_m == pytest.approx(wire.sag_m, abs=0.02)


def test_half_a_wire_says_that_the_other_half_is_less_certain() -> None:
    wire, random = WIRES["level"], np.random.default_rng(2)
    points = on(wire, 80, 0.0, 0.5) + 0.02 * random.normal(size=(80, 3))
    fit = fit_catenary(points, base_of(on(wire, 2)))
    seen, unseen = fit.sigma_at(np.array([0.25, 1.0]) * fit.base.length_m)
    assert (unseen > 5 * seen).all()


def test_the_stated_deviations_are_the_true_ones() -> None:
    """Over many draws: heights, offsets and the sag scatter as the covariance says."""
    wire, random = WIRES["level"], np.random.default_rng(3)
    exact, base = on(wire, 60), base_of(on(wire, 2))
    middle = np.array([base.length_m / 2])
    sags, places, said = [], [], []
    for _ in range(80):
        fit = fit_catenary(exact + 0.05 * random.normal(size=exact.shape), base)
        sags.append(fit.curve.sag_m - wire.sag_m)
        places.append(base.at(fit.q, middle)[0])
        said.append([fit.sag_sigma_m, *fit.sigma_at(middle)[0]])
    truth = [np.std(sags), *np.std(places, axis=0)]
    assert truth == pytest.approx(np.mean(said, axis=0), rel=0.25)
    assert abs(np.mean(sags)) < 3 * np.std(sags) / np.sqrt(80)


def test_what_is_no_wire_is_told() -> None:
    with pytest.raises(SurveyError, match="6 points or more, but 5 are given"):
        fit_catenary(on(WIRES["level"], 5))
    with pytest.raises(SurveyError, match="points along a span, but all 9 lie within"):
        fit_catenary(np.zeros((9, 3)))
    straight = np.linspace([0, 0, 5.0], [30, 2, 5.0], 40)
    assert fit_catenary(straight).curve.sag_m < 1e-4  # nothing hangs here
