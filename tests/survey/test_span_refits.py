"""Every span is refitted for itself; poses are as loose as most of the wire shows."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.support.drawn import scene_of, two_passes
from tests.survey.test_refine import WIRES, lit

from plnerf.line.base import Base
from plnerf.line.hang import hang
from plnerf.survey import span_refits
from plnerf.survey.posed_photos import Photos, photos_of
from plnerf.survey.refine.config import RefineConfig
from plnerf.survey.refine.refine import Refinement
from plnerf.survey.refine.unknowns import Light
from plnerf.survey.span_wires import SpanWires, span_of


@pytest.fixture
def photos(tmp_path: Path) -> Photos:
    cameras = two_passes(1)
    return photos_of(scene_of(tmp_path, cameras, lit(cameras, *WIRES)))


def spans(*lengths: float) -> list[SpanWires]:
    starts = [sum(lengths[:k], 0.0) for k in range(len(lengths))]
    return [
        span_of([hang((a, y, 20.0), (a + length, y, 20.0), 0.01 * length) for y in (-1.0, 1.0)])
        for a, length in zip(starts, lengths, strict=True)
    ]


@pytest.mark.parametrize(
    ("lengths", "residuals", "median"),
    [
        ((3.0, 44.0), (3.4, 0.07), 0.07),
        ((44.0, 3.0), (0.07, 3.4), 0.07),
        ((40.0, 44.0, 30.0), (0.5, 0.2, 0.1), 0.2),
        ((4.0, 4.5, 44.0, 30.0), (5.0, 4.0, 0.1, 0.3), 0.1),
    ],
)
def test_first_metres_of_next_spans_say_little_of_poses(
    lengths: tuple[float, ...], residuals: tuple[float, ...], median: float,
    monkeypatch: pytest.MonkeyPatch, photos: Photos,
) -> None:  # fmt: skip
    def refitted(
        full: Any, span: SpanWires, config: RefineConfig, light: Light | None, report: Any
    ) -> Refinement:
        length = round(span.base.length_m, 1)
        report(1, 1)
        return Refinement(span.wires, residuals[lengths.index(length)], (True, False))

    monkeypatch.setattr(span_refits, "_refitted", refitted)
    steps: list[tuple[int, int]] = []
    chain = tuple(spans(*lengths))
    found, residual_px, shown = span_refits.refine_spans(
        photos, [chain], RefineConfig(), lambda done, of: steps.append((done, of))
    )
    assert residual_px == pytest.approx(median)
    assert shown == (True, False) * len(lengths)
    assert [span.base.length_m for span in found[0]] == [span.base.length_m for span in chain]
    assert steps == [(k + 1, len(lengths)) for k in range(len(lengths))]


def test_no_spans_say_nothing(photos: Photos) -> None:
    assert span_refits.refine_spans(photos, [], RefineConfig(), lambda done, of: None) == ((), 0.0, ())


def test_the_longest_span_tells_the_others_the_light(monkeypatch: pytest.MonkeyPatch, photos: Photos) -> None:
    """In which photos show both: the short one comes last, wherever it lies in its line."""
    told: list[tuple[float, Light | None]] = []

    def refitted(
        full: Any, span: SpanWires, config: RefineConfig, light: Light | None, report: Any
    ) -> Refinement:
        told.append((round(span.base.length_m, 1), light))
        found = Light(np.array([10.0, 80.0]), np.array([3.0, 4.0]))
        return Refinement(span.wires, 0.1, (True, False), light=found)

    monkeypatch.setattr(span_refits, "_refitted", refitted)
    chain = tuple(spans(3.0, 44.0))
    span_refits.refine_spans(photos, [chain], RefineConfig(), lambda done, of: None)
    (first, none), (last, light) = told
    assert (first, last) == (44.0, 3.0) and none is None and light is not None
    own = RefineConfig().adjust
    np.testing.assert_allclose(light.shading, [10.0, 80.0])
    np.testing.assert_allclose(light.sigma, np.hypot([3.0, 4.0], own.own_shading * own.shading_grey))


def test_light_is_carried_around_a_bend() -> None:
    """What is across after a bend was along before, and unknown."""
    (before,), config = spans(44.0), RefineConfig().adjust
    turned = Base(np.zeros(2), 30.0 * np.array([np.cos(0.5), np.sin(0.5)]))
    after = SpanWires(turned, tuple(replace(wire, base=turned) for wire in before.wires))
    light = Light(np.array([10.0, 80.0]), np.array([3.0, 4.0]))
    refined = Refinement(before.wires, 0.1, (True, True), light=light)
    found = span_refits._carried(refined, after, config)
    assert found is not None
    np.testing.assert_allclose(found.shading, [10.0 * np.cos(0.5), 80.0])
    own = config.own_shading * config.shading_grey
    across = np.hypot(3.0 * np.cos(0.5), config.shading_grey * np.sin(0.5))
    np.testing.assert_allclose(found.sigma, np.hypot([across, 4.0], own))
    assert span_refits._carried(Refinement(before.wires, 0.1, (True, True)), after, config) is None
