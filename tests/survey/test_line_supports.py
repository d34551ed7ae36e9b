"""Structures of lines of several spans: by kinks, by what stands there, and by both."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch
from tests.support.drawn import pinhole_cameras
from tests.support.hung_lines import (
    attachments,
    detected,
    ground,
    rotated,
    surface,
    tower,
    true_spans,
    turned_by,
)

from plnerf.line.ends import Attached, Open
from plnerf.line.frame import LineFrame
from plnerf.line.line import Line
from plnerf.line.wire import Wire
from plnerf.scene.photos import PhotoFiles
from plnerf.survey.attach import hung_between, lines_of, numbered, trimmed
from plnerf.survey.chains import find_chains, wires_of
from plnerf.survey.config_spans import ChainConfig, StructureKindConfig
from plnerf.survey.config_wires import SupportConfig
from plnerf.survey.posed_photos import Photos
from plnerf.survey.structure_kinds import _pull, with_structure_kinds
from plnerf.survey.support import Support, Supports
from plnerf.survey.supports import find_supports, scenery_of
from plnerf.survey.surface import Surface

TURN = np.radians(20.0)
FEET = np.array([[0.0, 0.0], [40.0, 0.0], [85.0, 0.0], [85 + 40 * np.cos(TURN), 40 * np.sin(TURN)]])
"""Three spans; the line turns by 20 degrees at its third structure."""
NOTHING = surface()


def known(
    spans: list[list[Wire]], seed: int | None = 0, beyond: float = 4.0, at_ends: float = -1.0
) -> list[Wire]:
    """Wires that go on beyond inner structures, and are seen up to so far from the line's ends."""
    random, last = None if seed is None else np.random.default_rng(seed), len(spans) - 1
    return [
        detected(wire, random, (beyond if k else at_ends, beyond if k < last else at_ends))
        for k, span in enumerate(spans)
        for wire in span
    ]


def surveyed(
    wires: list[Wire], shown: Surface = NOTHING, field: Surface | None = None, photos: Photos | None = None
) -> tuple[tuple[Line, ...], Supports]:
    """As a survey does it, without the refit."""
    chains, config = find_chains(wires, ChainConfig()), SupportConfig()
    scenery = scenery_of(shown, field, chains, config)
    supports = find_supports(scenery, chains, config, ChainConfig())
    extents = trimmed(chains, supports)
    supports = find_supports(scenery, chains, config, ChainConfig())
    if photos is not None:
        supports = with_structure_kinds(supports, photos, StructureKindConfig())
    hung, _ = numbered(hung_between(chains, extents, supports), chains)
    return lines_of(hung, supports, supports.seen), supports


def filmed(centres: np.ndarray, targets: np.ndarray) -> Photos:
    """Cameras without pictures."""
    frame = LineFrame(np.eye(3), 1.0, np.zeros(3), "m", None, scene_per_unit=1.0)
    cameras = frame.cameras(pinhole_cameras(centres, targets))
    names = tuple(str(k) for k in range(len(cameras)))
    images = PhotoFiles(())  # no picture is read
    return Photos(
        frame,
        cameras,
        images,
        images,
        cameras.size_px.numpy(),
        names,
        tuple(range(len(names))),
        np.array([[-50.0] * 3, [200.0] * 3]),
    )


def test_kinks_show_the_structures_between_spans() -> None:
    """Wires that go on beyond both towers have the middle span's sag, which no tower is seen to bound."""
    held = attachments(FEET)
    spans = true_spans(held)
    (line,), supports = surveyed(known(spans))
    assert [span.structures for span in line.spans] == [(None, 1), (1, 2), (2, None)]
    assert [span.id for span in line.spans] == [1, 2, 3] and [one.id for one in line.structures] == [1, 2]
    assert [wire.id for wire in line.wires] == list(range(1, 13))
    for structure, foot in zip(line.structures, FEET[1:3], strict=True):
        assert np.linalg.norm(structure.foot[:2] - foot) < 0.1
        assert structure.sigma_m < 0.1 and "kinks of 4 wires" in structure.evidence
    for wire in line.spans[1].wires:
        nearest = min(
            spans[1], key=lambda one: np.linalg.norm(one.points(np.zeros(1)) - wire.points(np.zeros(1)))
        )
        assert wire.sag is not None and nearest.sag is not None and wire.span_m is not None
        assert abs(wire.sag.value - nearest.sag.value) < 0.015
        assert abs(wire.sag.value - nearest.sag.value) < 1.2 * wire.sag.half_95
    for span, end in ((line.spans[0], 0), (line.spans[2], 1)):
        assert all(isinstance(wire.ends[end], Open) and wire.sag is None for wire in span.wires)
    # Wires of one conductor end at one point, as near as their curves allow.
    ends = [[wire.ends for wire in span.wires] for span in line.spans]
    for one, other in ((ends[0], ends[1]), (ends[1], ends[2])):
        points = [end[1].point for end in one if isinstance(end[1], Attached)]
        others = [end[0].point for end in other if isinstance(end[0], Attached)]
        assert all(min(np.linalg.norm(p - q) for q in others) < 0.05 for p in points) and len(points) == 4
    assert supports.points.shape == (0,)


def test_a_terminal_ends_the_line_and_an_angle_is_stated() -> None:
    random, held = np.random.default_rng(1), attachments(FEET)
    floor = ground(random, (-20, -25), (140, 40))
    shown = surface(floor, tower(random, held[2]), tower(random, held[3]))
    x = np.linspace(-10, 150, 60)
    track = np.stack([x, np.full(60, -30.0), np.full(60, 25.0)], 1)
    photos = filmed(track, np.stack([x, 0.2 * np.maximum(x - 85, 0), np.full(60, 15.0)], 1))
    (line,), supports = surveyed(known(true_spans(held)), shown, None, photos)
    first, angle, last = line.structures
    assert [span.structures for span in line.spans] == [(None, 1), (1, 2), (2, 3)]
    assert (first.kind, angle.kind, last.kind) == ("strain", "strain", "terminal")  # longer spans are tighter
    assert angle.line_angle_deg == pytest.approx(20.0, abs=0.1) and last.line_angle_deg is None
    assert "kinks" in angle.evidence and "seen by stereo" in angle.evidence
    assert last.foot == pytest.approx([*FEET[3], 0.0], abs=0.4)
    assert all(wire.sag is not None for wire in line.spans[2].wires)
    assert supports.points[:8000].sum() == 0 and supports.points[8000:].mean() > 0.3
    near = replace(photos, train=tuple(k for k in photos.train if x[k] < 95))
    (line,), _ = surveyed(known(true_spans(held)), shown, None, near)
    assert line.structures[-1].kind == "unknown"  # what is beyond is not filmed
    # Nor is a structure that is small in all photos terminal: wires beyond it would be missed.
    chain = supports.chains[0]
    afar = replace(supports, chains=((*chain[:-1], replace(chain[-1], afar=True)),))
    (*_, found) = with_structure_kinds(afar, photos, StructureKindConfig()).chains[0]
    assert found.structure is not None and found.structure.kind == "unknown"


def test_wires_of_a_span_share_their_errors() -> None:
    """Four are known no better than one; where they differ more than they state, they are known worse."""
    _, supports = surveyed(known(true_spans(attachments(FEET[:3]))))
    support = next(one for one in supports.chains[0] if len(one.kinks) == 4)

    def unsure(wire: Wire) -> Wire:
        covariance = wire.covariance.copy()
        covariance[4, 4] = (0.05 * wire.theta[4]) ** 2 / 2
        return replace(wire, covariance=covariance)

    def with_spans(of: Support, k: int, change: Callable[[Wire], Wire]) -> Support:
        ends = [
            span if span is None else replace(span, wires=(*map(change, span.wires[:k]), *span.wires[k:]))
            for span in (of.junction.before, of.junction.after)
        ]
        return replace(of, junction=replace(of.junction, before=ends[0], after=ends[1]))

    alike = with_spans(support, 4, unsure)
    ratio, sigma = _pull(alike) or (0.0, 0.0)
    assert sigma == pytest.approx(0.05, rel=1e-6) and ratio != 0
    exact = with_spans(support, 4, lambda wire: replace(wire, covariance=1e-6 * wire.covariance))
    _, least = _pull(exact) or (0.0, 0.0)
    assert least > 1e-3 * 0.05  # by how they scatter


def test_a_structure_is_of_strain_where_it_is_pulled_to_one_side() -> None:
    held, random = attachments(FEET[:3]), np.random.default_rng(2)
    even = true_spans(held)
    p = even[0][0].plane[2]
    shares = [40.0 / (8 * p), 45.0 / (8 * p), 45.0 / (8 * 0.8 * p)]
    alike, tighter = (
        [true_spans(held[:2], shares[0])[0], true_spans(held[1:], shares[k])[0]] for k in (1, 2)
    )
    photos = filmed(np.array([[40.0, -30.0, 20.0]]), np.array([[40.0, 0.0, 18.0]]))
    shown = surface(ground(random, (-20, -20), (100, 20)), tower(random, held[1]))
    for spans, kinds in ((alike, {"suspension"}), (tighter, {"strain"})):
        (line,), _ = surveyed([detected(w, None, (3.0, 3.0)) for s in spans for w in s], shown, None, photos)
        middle = [one for one in line.structures if one.line_angle_deg is not None]
        assert {one.kind for one in middle} == kinds
    (line,), _ = surveyed([detected(w, None, (3.0, 3.0)) for s in alike for w in s], NOTHING, None, photos)
    assert [one.kind for one in line.structures] == ["unknown"]  # no strings are seen


def test_a_crossing_line_has_its_own_structures_and_no_sag_without() -> None:
    low = attachments(np.array([[55.0, -40.0], [70.0, 40.0]]), [(-1.0, 12.0), (1.0, 12.0)])
    random, held = np.random.default_rng(3), attachments(FEET)
    shown = surface(ground(random, (-20, -60), (140, 60)), tower(random, low[1]))
    wires = [*known(true_spans(held)), *known(true_spans(low))]
    lines, _ = surveyed(wires, shown)
    assert [len(line.spans) for line in lines] == [3, 1] and [line.id for line in lines] == [1, 2]
    assert [one.id for one in lines[1].structures] == [3]
    assert lines[1].spans[0].id == 4 and lines[1].spans[0].structures == (None, 3)
    assert all(wire.sag is None for wire in lines[1].wires)
    assert lines[0].spans[1].structures == (1, 2)


def test_a_tee_ends_at_a_structure_of_the_other_line() -> None:
    held = attachments(FEET)
    tee = attachments(np.array([[40.0, -45.0], [40.0, -1.5]]), [(-2.0, 17.0), (2.0, 17.0)])
    lines, supports = surveyed([*known(true_spans(held)), *known(true_spans(tee))])
    assert [len(line.spans) for line in lines] == [3, 1]
    assert lines[1].structures == () and lines[1].spans[0].structures == (None, 1)
    for wire in lines[1].wires:
        end = wire.ends[1]
        assert isinstance(end, Attached) and end.structure == 1 and end.sigma_m == SupportConfig().by_tee_m
    assert len(supports.seen) == 2


@pytest.mark.parametrize("degrees", [37.0, 70.0])
def test_lines_of_any_azimuth_are_the_same(degrees: float) -> None:
    R, held, random = turned_by(degrees), attachments(FEET), np.random.default_rng(4)
    wires = known(true_spans(held))
    shown = np.concatenate([ground(random, (-20, -25), (140, 40)), *(tower(random, p) for p in held)])
    (line,), here = surveyed(wires, surface(shown))
    (turned_line,), there = surveyed([rotated(wire, R) for wire in wires], surface(shown @ R.T))
    assert [one.evidence for one in turned_line.structures] == [one.evidence for one in line.structures]
    for one, other in zip(line.structures, turned_line.structures, strict=True):
        np.testing.assert_allclose(other.foot, R @ one.foot, atol=1e-6)
        assert other.height_m == pytest.approx(one.height_m, abs=1e-6)
        assert other.sigma_m == pytest.approx(one.sigma_m, abs=1e-6)
    for one, other in zip(line.wires, turned_line.wires, strict=True):
        assert one.sag is not None and other.sag is not None
        assert (other.sag.value, other.sag.sigma) == pytest.approx((one.sag.value, one.sag.sigma), abs=1e-6)
    np.testing.assert_array_equal(here.points, there.points)


def test_a_single_span_of_any_azimuth_is_the_same() -> None:
    R, held, random = turned_by(37.0), attachments(FEET[:2]), np.random.default_rng(5)
    wires = known(true_spans(held), at_ends=2.0)
    shown = np.concatenate([ground(random, (-20, -25), (60, 25)), *(tower(random, p) for p in held)])
    (line,), _ = surveyed(wires, surface(shown))
    (other_line,), _ = surveyed([rotated(wire, R) for wire in wires], surface(shown @ R.T))
    assert line.spans[0].structures == other_line.spans[0].structures == (1, 2)
    for one, other in zip(line.wires, other_line.wires, strict=True):
        assert one.sag is not None and other.sag is not None
        assert other.sag.value == pytest.approx(one.sag.value, abs=1e-6)
        assert one.sag.value == pytest.approx(0.03 * 40, abs=0.02)


def test_a_body_that_a_kink_contradicts_is_none() -> None:
    """Noise of a young field, 2.7 m from the structure, that stereo even seems to confirm."""
    random, held = np.random.default_rng(6), attachments(FEET[:3])
    floor = ground(random, (-20, -20), (100, 20))
    phantom = tower(random, held[1] - [2.7, 0.0, 0.0])
    phantom = phantom[np.abs(phantom[:, 0] - 37.3) < 0.8]
    phantom = phantom[phantom[:, 2] < 16]
    top = np.column_stack([37.3 + random.normal(0, 0.1, 40), np.zeros(40), random.uniform(16, 24, 40)])
    (line,), _ = surveyed(known(true_spans(held)), surface(floor, phantom, top), surface(floor, phantom, top))
    (one,) = line.structures
    assert abs(one.foot[0] - 40.0) < 0.1 and "kinks of 4 wires" in one.evidence


def test_spans_that_meet_without_a_kink_are_open_and_say_so() -> None:
    whole = true_spans(attachments(np.array([[0.0, 0.0], [80.0, 0.0]])))[0]
    random = np.random.default_rng(7)
    halves = [detected(w, random).between(*part) for part in ((0.0, 41.0), (39.0, 80.0)) for w in whole]
    (line,), _ = surveyed(halves)
    assert [span.structures for span in line.spans] == [(None, None), (None, None)]
    assert all(wire.sag is None for wire in line.wires)
    assert {wire.ends[1].reason for wire in line.spans[0].wires if isinstance(wire.ends[1], Open)} == {
        "the next span's wires meet it without a clear kink, and no structure is seen there"
    }


def test_photos_near_a_span_are_those_that_show_it() -> None:
    photos = filmed(
        np.array([[0.0, -30.0, 20.0], [0.0, 30.0, 20.0]]), np.array([[0.0, 0.0, 20.0], [0.0, 60.0, 20.0]])
    )
    points = np.array([[0.0, 0.0, 20.0], [0.0, 500.0, 20.0]])
    apart = photos.distances(points)
    np.testing.assert_allclose(apart, [[30.0, 530.0], [np.inf, 470.0]], rtol=1e-6)
    assert photos.of(points[:1]).train == (0,) and photos.of(points).train == (0, 1)
    assert wires_of(()) == [] and torch.is_tensor(photos.cameras.centre)
