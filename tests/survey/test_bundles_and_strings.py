"""Subconductors side by side are one phase; strings of insulators lead from clamps to the arms above."""

from dataclasses import replace

import numpy as np
import pytest
from tests.support import surveys

from plnerf.line.base import Base
from plnerf.line.cloud import CONNECTOR, TOWER, Cloud
from plnerf.line.ends import Attached
from plnerf.line.files import read_survey, write_survey_json
from plnerf.line.hang import hang
from plnerf.line.line import Line, Span, Structure
from plnerf.line.phases import phases_of
from plnerf.line.survey import Survey
from plnerf.line.wire import Wire
from plnerf.survey.bundles_of_wires import with_bundles
from plnerf.survey.config_wires import KindsConfig
from plnerf.survey.insulator_strings import with_strings

SPREAD = np.diag([0.02, 0.02, 0.02, 0.02, 0.01, 0.0]) ** 2


def wire(
    id: int, y: float, x: tuple[float, float] = (0.0, 100.0), z: float = 20.0, **changed: object
) -> Wire:
    held = tuple(Attached(k, np.array([at, y, z]), 0.05) for k, at in enumerate(x, 1))
    made = hang(held[0].point, held[1].point, 2.0, id=id, kind="phase")
    return replace(made, ends=held, covariance=SPREAD, **changed)  # type: ignore[arg-type]


def test_a_bundle_is_one_phase_with_its_spacing() -> None:
    wires = [wire(1, -5.2), wire(2, -4.8), wire(3, 0.0), wire(4, 4.8), wire(5, 5.2), wire(6, 5.2, z=19.6)]
    shields = [wire(k, y, z=26.0, kind="shield") for k, y in ((7, -0.2), (8, 0.2))]
    line = Line(1, (), (Span(1, (1, 2), (*wires, *shields)),))
    (found,) = with_bundles((line,), KindsConfig())
    assert [one.bundle for one in found.wires] == [1, 1, None, 2, 2, 2, None, None]
    phases = phases_of(found.spans[0])
    assert [one.wires for one in phases] == [(1, 2), (3,), (4, 5, 6), (7,), (8,)]
    spacing = phases[0].spacing
    assert spacing is not None and spacing.value == pytest.approx(0.4, abs=1e-6)
    assert 0.01 < spacing.sigma < 0.03 and phases[1].spacing is None


def test_wires_that_come_near_in_one_place_are_no_bundle() -> None:
    across = wire(2, 0.0)
    across = replace(across, base=Base(np.array([0.0, -3.0]), np.array([100.0, 3.0])))
    line = Line(1, (), (Span(1, (1, 2), (wire(1, 0.0), across)),))
    assert [one.bundle for one in with_bundles((line,), KindsConfig())[0].wires] == [None, None]


def structure(string_m: float) -> tuple[Survey, np.ndarray]:
    """A clamp at (100, 0, 20) in the middle of two spans, an arm of a lattice above, and a thin string."""
    random = np.random.default_rng(3)
    arm = np.array([100.0, 0, 20 + string_m]) + random.uniform([-0.6, -3, -0.1], [0.6, 3, 0.1], (120, 3))
    string = np.array([100.0, 0, 20]) + random.uniform([-0.1, -0.1, 0.0], [0.1, 0.1, string_m - 0.3], (12, 3))
    xyz = np.concatenate([arm, string])
    cloud = Cloud(xyz, np.full(len(xyz), TOWER, np.uint8), np.zeros(len(xyz), np.int64))
    first = replace(wire(1, 0.0), ends=(wire(1, 0.0).ends[0], Attached(2, np.array([100.0, 0, 20]), 0.05)))
    second = wire(2, 0.0, (100.0, 200.0))
    ends = (Attached(2, np.array([100.0, 0, 20]), 0.05), Attached(3, np.array([200.0, 0, 20]), 0.05))
    masts = tuple(Structure(k, np.array([100.0 * (k - 1), 0, 0]), 25.0, 0.1, "") for k in (1, 2, 3))
    spans = (Span(1, (1, 2), (first,)), Span(2, (2, 3), (replace(second, ends=ends),)))
    survey = replace(surveys.empty(), lines=(Line(1, masts, spans),), cloud=cloud)
    return survey, np.arange(len(arm), len(xyz))


def test_a_string_leads_from_the_clamp_to_the_arm_and_its_points_are_connectors(tmp_path) -> None:
    survey, thin = structure(1.6)
    found = with_strings(survey, KindsConfig())
    (one,) = found.strings
    assert (one.structure, one.wires, one.kind) == (2, (1, 2), "suspension")
    assert one.length_m == pytest.approx(1.6, abs=0.15)
    assert one.ends[1] == pytest.approx([100, 0, 20]) and one.points == len(thin)
    assert np.array_equal(np.flatnonzero(found.cloud.label == CONNECTOR), thin)
    write_survey_json(tmp_path / "survey.json", found)
    (back,) = read_survey(tmp_path / "survey.json").strings
    assert back.wires == one.wires and np.array_equal(back.ends, one.ends)


def test_a_clamp_right_below_its_arm_has_no_string() -> None:
    assert with_strings(structure(0.32)[0], KindsConfig()).strings == ()


def test_wires_that_end_apart_are_held_by_strain_strings() -> None:
    survey, _ = structure(1.6)
    (line,) = survey.lines
    moved = []
    for span, at, k in zip(line.spans, (98.0, 102.0), (1, 0), strict=True):
        (one,) = span.wires
        ends = list(one.ends)
        ends[k] = Attached(2, np.array([at, 0, 21.6]), 0.05)
        moved.append(replace(span, wires=(replace(one, ends=tuple(ends)),)))
    survey = replace(survey, lines=(replace(line, spans=tuple(moved)),))
    kinds = KindsConfig(same_m=5.0)
    found = with_strings(survey, kinds).strings
    assert [(one.kind, one.wires) for one in found] == [("strain", (1,)), ("strain", (2,))]
    assert [one.length_m for one in found] == pytest.approx([2.0, 2.0], abs=1e-6)
