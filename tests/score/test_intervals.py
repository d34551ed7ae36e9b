"""Figures with intervals: each beside its true value, in the true wire's own shape."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.support.catenary_surveys import corridor

from plnerf.line.survey import Survey
from plnerf.score.intervals import LIMIT, Figure, figures_of
from plnerf.survey.clearance import measure_clearances
from plnerf.survey.config_ground import ClearanceConfig


def surveyed() -> Survey:
    survey = corridor(count=400)
    return replace(survey, clearances=measure_clearances(survey, ClearanceConfig())[0])


def truth_of(survey: Survey, folder: Path, bow_m: float = 0.0, off_m: float = 0.0) -> Path:
    """The survey's own wires, each bowed sideways in its middle; and its clearances, off by so much."""
    rows = []
    assert survey.clearances is not None
    for wire, one in zip(survey.wires, survey.clearances.wires, strict=True):
        line = wire.polyline(0.25)
        t = np.linspace(0, 1, len(line))
        line[:, :2] += bow_m * np.sin(2 * np.pi * t)[:, None] * wire.base.n
        world = survey.frame.to_world(line).tolist()
        vertical, plants = one.vertical, one.least("vegetation")
        assert vertical is not None and plants is not None
        true = {"ground": vertical.distance_m - off_m, "vegetation": plants.distance_m - off_m}
        rows.append({"name": f"wire {wire.id}", "kind": wire.kind, "polyline": world, "clearances": true})
    path = folder / "truth.json"
    path.write_text(json.dumps({"conductors": rows}))
    return path


def of(figures: tuple[Figure, ...], kind: str) -> list[Figure]:
    return [one for one in figures if one.kind == kind]


def test_an_exact_survey_has_every_figure_without_error(tmp_path: Path) -> None:
    survey = surveyed()
    found = figures_of(survey, truth_of(survey, tmp_path))
    held = sum(wire.open is None for wire in survey.wires)
    assert held == 3
    kinds = ("sag", "wire across", "wire up", "ground", "vegetation")
    counts = {kind: len(of(found, kind)) for kind in kinds}
    assert counts == dict.fromkeys(counts, held) and len(of(found, "attachment")) == 2 * held
    # Attachments are where the wires were hung, and these are fitted to noisy points.
    assert max(abs(one.error_m) for one in found if one.kind != "attachment") < 2e-3
    assert all(one.within_95 for one in found if one.sigma_m > 0)


def test_known_errors_are_found_in_stated_deviations(tmp_path: Path) -> None:
    survey = surveyed()
    found = figures_of(survey, truth_of(survey, tmp_path, bow_m=0.3, off_m=0.2))
    assert [one.error_m for one in of(found, "ground")] == pytest.approx([0.2] * 3)
    for one in (*of(found, "ground"), *of(found, "vegetation")):
        assert one.deviations == pytest.approx(one.error_m / one.sigma_m)
    # The catenary that is nearest to such a wire is straight: the error is off the wire itself.
    assert max(abs(one.error_m) for one in of(found, "wire across")) > 0.15
    assert max(abs(one.error_m) for one in of(found, "wire up")) < 2e-3


def test_without_a_deviation_any_error_is_outside() -> None:
    assert not Figure("sag", "A", 1.0, 1.1, 0.0).within_95
    assert Figure("sag", "A", 1.0, 1.1, 0.0).deviations == np.inf
    assert Figure("sag", "A", 1.0, 1.0, 0.0).within_95


def test_an_upper_limit_errs_only_where_more_is_true() -> None:
    assert Figure(LIMIT, "A", 3.0, 26.0, 0.5).within_95 and Figure(LIMIT, "A", 3.0, 26.0, 0.5).deviations == 0
    assert not Figure(LIMIT, "A", 3.0, 2.0, 0.5).within_95
    assert Figure(LIMIT, "A", 3.0, 2.0, 0.5).deviations == pytest.approx(-2.0)
