"""Tension strings drawn into pictures are found with their length; wires without one stay as they are."""

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
import pytest
import torch
from tests.support.drawn import InMemory, pinhole_cameras

from plnerf.errors import ConfigError
from plnerf.line.ends import TWO_SIDED_95, Attached
from plnerf.line.frame import LineFrame
from plnerf.line.hang import hang
from plnerf.line.line import Line, Span, Structure, StructureKind
from plnerf.line.wire import Kind, Wire
from plnerf.scene.cameras import Cameras, project
from plnerf.survey.config_spans import TensionStringConfig
from plnerf.survey.posed_photos import Photos
from plnerf.survey.string_profiles import Strings, _misfits, _spread, shown_strings
from plnerf.survey.tension_strings import (
    _held_alike,
    _of_one_length,
    with_possible_strings,
    with_tension_strings,
)

CONFIG = TensionStringConfig()
THICK_M, STRING_M = 0.03, 0.2
"""Diameters."""
PHASES = 2.0
"""Distance between wires."""


PAIR = ((-PHASES / 2, 10.0), (PHASES / 2, 10.0))
ONE_ABOVE = (*PAIR, (1.5 * PHASES, 10.0), (0.0, 11.2))
"""y and z of wires."""


def wires(kind: Kind = "phase", places: Sequence[tuple[float, float]] = PAIR) -> list[Wire]:
    """Side by side, whose first end structure 1 holds."""
    found = []
    for k, (y, z) in enumerate(places):
        wire = hang((0.0, y, z), (30.0, y, z), 0.6)
        a, b = wire.points(np.array([0.0, 30.0]))
        found.append(replace(wire, id=k + 1, kind=kind, ends=(Attached(1, a, 0.05), Attached(2, b, 0.05))))
    return found


def line_with(kind: StructureKind = "unknown", of: Kind = "phase") -> Line:
    both = [Structure(k, np.array([30.0 * (k - 1), 0.0, 0.0]), 12.0, 0.05, "test", kind) for k in (1, 2)]
    return Line(1, tuple(both), (Span(1, (1, 2), tuple(wires(of))),))


def filmed(count: int, held: Sequence[tuple[Wire, float]]) -> Photos:
    """The first five metres from both sides, over ground with some texture.  held: wires, each with its
    string's length."""
    random = np.random.default_rng(3)
    x = np.linspace(0.5, 4.0, count)
    centres = np.stack([x, np.where(np.arange(count) % 2, 3.5, -3.5), np.full(count, 11.5)], 1)
    frame = LineFrame(np.eye(3), 1.0, np.zeros(3), "m", None, scene_per_unit=1.0)
    cameras = frame.cameras(pinhole_cameras(centres, np.stack([x, 0 * x, np.full(count, 9.8)], 1)))
    pictures = []
    for i in range(count):
        w, h = (int(side) for side in cameras.size_px[i])
        picture = cv2.resize(random.uniform(110, 170, (h // 6, w // 6)).astype(np.float32), (w, h))
        for wire, own_m in held:
            for low, high, thick in ((own_m, 12.0, THICK_M), (0.0, own_m, STRING_M)):
                if high > low:
                    _bar(picture, cameras[[i]], wire.points(np.linspace(low, high, 100)), thick)
        noisy = np.clip(picture + random.normal(0, 2, picture.shape), 0, 255).astype(np.uint8)
        pictures.append(np.repeat(noisy[..., None], 3, -1))
    every, images = tuple(range(count)), InMemory(pictures)
    box = np.array([[-5.0, -5.0, 0.0], [35.0, 5.0, 15.0]])
    names = tuple(str(i) for i in every)
    return Photos(frame, cameras, images, images, cameras.size_px.numpy(), names, every, box)


def film_of_pair(string_m: float, count: int = 12) -> Photos:
    return filmed(count, [(wire, string_m) for wire in wires()])


def _bar(picture: np.ndarray, camera: Cameras, line: np.ndarray, thick_m: float) -> None:
    """Dark, eight times as fine as a pixel across."""
    pixels, depths = project(camera, torch.from_numpy(line))
    at, depth = pixels[0].numpy(), depths[0].numpy()
    if (depth < 0.3).any():
        at, depth = at[depth >= 0.3], depth[depth >= 0.3]
    fine = cv2.resize(picture, None, fx=8, fy=8, interpolation=cv2.INTER_NEAREST)
    for k in range(len(at) - 1):
        wide = max(1, round(thick_m * float(camera.focal_px[0, 0]) / depth[k] * 8))
        ends = [tuple(int(v) for v in np.clip(8 * one, -9000, 9000)) for one in at[k : k + 2]]
        cv2.line(fine, ends[0], ends[1], 40.0, wide)
    picture[:] = cv2.resize(fine, picture.shape[::-1], interpolation=cv2.INTER_AREA)


def first_ends(line: Line) -> list[Attached]:
    ends = [wire.ends[0] for wire in line.wires]
    assert all(isinstance(end, Attached) for end in ends)
    return ends  # type: ignore[return-value]


def test_wires_end_at_the_clamps_of_tension_strings_that_images_show() -> None:
    line, photos = line_with(), film_of_pair(0.9)
    goes_on = replace(line, spans=(Span(2, (3, 1), ()), *line.spans))
    # Where the next span is not seen, the arm may be turned: each wire is 1 m out.
    for one, turned in ((goes_on, 0.0), (line, np.tan(np.radians(CONFIG.half_turn_deg)))):
        (found,) = with_tension_strings([one], photos, CONFIG)
        for end in first_ends(found):
            assert end.sigma_m == pytest.approx(np.hypot(0.158, turned), abs=0.001)
    one, other = line.wires
    (span,) = line.spans
    shielded = replace(line, spans=(replace(span, wires=(one, replace(other, kind="shield"))),))
    (with_shield,) = with_tension_strings([shielded], photos, CONFIG)
    clamped = first_ends(with_shield)[1]  # to the same arm, without a string
    before = first_ends(line)[1].sigma_m
    assert clamped.sigma_m == pytest.approx(np.hypot(before, turned), abs=0.001)
    assert clamped.point == pytest.approx(first_ends(line)[1].point) and clamped.string_m is None
    for end, wire in zip(first_ends(found), found.wires, strict=True):
        assert end.point[0] == pytest.approx(0.9, abs=0.2)
        assert wire.points(np.zeros(1))[0] == pytest.approx(end.point)  # the curve ends there too
        assert wire.points(np.array([wire.base.length_m]))[0, 0] == pytest.approx(30.0)
        assert any("tension string of about" in text for text in wire.notes)
    assert [one.kind for one in found.structures] == ["strain", "unknown"]


@pytest.mark.parametrize(("string_m", "own_m", "known"), [
    (0.9, 0.0, True), (0.9, 0.9, False), (0.0, 0.9, True), (0.0, 0.0, True),
])  # fmt: skip
def test_a_wire_that_hangs_alone_above_the_others_may_be_a_shield(
    string_m: float, own_m: float, known: bool
) -> None:
    """It has no string where phases have none, or where its images show it up to the structure; else nothing
    is known of it."""
    every = wires(places=ONE_ABOVE)
    line = replace(line_with(), spans=(Span(1, (1, 2), tuple(every)),))
    photos = filmed(20, [(one, string_m) for one in every[:3]] + [(every[3], own_m)])
    (found,) = with_tension_strings([line], photos, CONFIG)
    *phases, top = first_ends(found)
    assert [end.point[0] for end in phases] == pytest.approx([string_m] * 3, abs=0.2)
    assert top.point[0] == pytest.approx(0.0)
    assert top.sigma_m == 0.05 if known else TWO_SIDED_95 * top.sigma_m > 1.2


def test_one_span_shows_which_wire_hangs_alone_though_of_another_a_phase_is_missing() -> None:
    every = wires(places=ONE_ABOVE)
    missed = [
        replace(wire, id=wire.id + 10, ends=wire.ends[::-1], base=hang((-30.0, y, z), (0.0, y, z), 0.6).base)
        for wire, (y, z) in list(zip(every, ONE_ABOVE, strict=True))[1:]
    ]
    spans = (Span(1, (3, 1), tuple(missed)), Span(2, (1, 2), tuple(every)))
    for found, alone in ((spans, 2), (spans[:1], 0)):
        held = [(wire, k) for span, k in zip(found, (1, 0), strict=False) for wire in span.wires]
        _, above = _held_alike(found, held, CONFIG)
        assert [wire.id for wire, _ in above] == [14, 4][:alone]


def test_so_they_do_where_their_last_end_is_held() -> None:
    held = []
    for wire in wires():
        a, b = wire.points(np.array([0.0, 30.0]))
        held.append(replace(wire, base=hang(tuple(b), tuple(a), 0.6).base, ends=wire.ends[::-1]))
    line = replace(line_with(), spans=(Span(1, (2, 1), tuple(held)),))
    (found,) = with_tension_strings([line], film_of_pair(0.9), CONFIG)
    for wire in found.wires:
        first, last = wire.points(np.array([0.0, wire.base.length_m]))
        end = wire.ends[1]
        assert isinstance(end, Attached) and end.point == pytest.approx(last)
        assert last[0] == pytest.approx(0.9, abs=0.2) and first[0] == pytest.approx(30.0)


def test_wires_that_are_thin_up_to_the_structure_end_there() -> None:
    (found,) = with_tension_strings([line_with()], film_of_pair(0.0), CONFIG)
    for end, wire in zip(first_ends(found), wires(), strict=True):
        held = wire.ends[0]
        assert isinstance(held, Attached) and end.sigma_m == held.sigma_m
        assert end.point == pytest.approx(held.point)


def test_where_images_do_not_show_it_the_interval_holds_a_tension_string() -> None:
    """Of the second structure there is no image."""
    (found,) = with_tension_strings([line_with()], film_of_pair(0.9), CONFIG)
    (other,) = with_tension_strings([line_with()], film_of_pair(0.9, 1), CONFIG)
    longest = CONFIG.spacing_share * PHASES
    for wire, k in [(wire, 1) for wire in found.wires] + [(wire, 0) for wire in other.wires]:
        end = wire.ends[k]
        assert isinstance(end, Attached) and end.point[0] == pytest.approx(30.0 * k)
        assert TWO_SIDED_95 * end.sigma_m >= longest
        assert any("may lie up to 1.6 m nearer" in text for text in wire.notes)
    for sag in [wire.sag for wire in found.wires]:  # its interval holds the string too
        assert sag is not None and sag.half_95 > 2 * sag.value / 30 * longest


def test_the_places_of_one_wire_in_one_image_count_once() -> None:
    """A tower's edge behind it is beside all of them."""
    random = np.random.default_rng(0)
    rows = np.exp(random.normal(0.0, 0.5, (400, 1)))
    at_places = np.repeat(rows, 8, 1) * np.exp(random.normal(0.0, 0.01, (400, 8)))
    of_median = np.sqrt(np.pi / 2) * 0.5
    assert _spread(at_places) == pytest.approx(of_median / 20, rel=0.15)
    few = np.concatenate([at_places[:25], np.full((3, 8), np.nan)])  # images that do not show it
    assert _spread(few) == pytest.approx(of_median / 5, rel=0.4)


@pytest.mark.parametrize(("ratio", "spread", "length_m"), [
    (1.5, 0.1, 0.0), (1.5, 3.0, None), (1.9, 0.1, 0.0), (1.2, 3.0, 0.0), (2.4, 3.0, None),
])  # fmt: skip
def test_a_wire_is_bare_where_no_string_fits(
    ratio: float, spread: float, length_m: float | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is beside it near the structure is less than twice what is there farther out, surely."""
    random = np.random.default_rng(2)
    rows = np.exp(spread * np.tile([-1.0, -0.5, 0.0, 0.5, 1.0], 20))

    def measured(*given: object) -> np.ndarray:
        s = np.asarray(given[5])
        beside = 0.5 * np.where(np.minimum(s, 30.0 - s) < 0.5, ratio, 1.0) * random.choice(rows)
        return np.stack([beside, np.ones_like(s)])

    monkeypatch.setattr("plnerf.survey.string_profiles._measure", measured)
    ends = [(wire, 0) for wire in wires()]
    shown = shown_strings(ends, film_of_pair(0.0, 60), 1.6, CONFIG)
    assert shown.length_m == length_m


@pytest.mark.parametrize(("ratio", "seen", "length_m"), [
    (1.5, 0.3, 1.0), (1.5, 0.55, 1.0), (1.5, 0.9, 0.0), (1.1, 0.3, None),
])  # fmt: skip
def test_where_no_wire_is_seen_there_is_a_string(
    ratio: float, seen: float, length_m: float | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Shells that reach as far as what is compared with them make little difference beside the axis."""

    def measured(*given: object) -> np.ndarray:
        s = np.asarray(given[5])
        held = np.minimum(s, 30.0 - s) < 0.95
        return np.stack([0.5 * np.where(held, ratio, 1.0), np.where(held, seen, 1.0)])

    monkeypatch.setattr("plnerf.survey.string_profiles._measure", measured)
    shown = shown_strings([(wire, 0) for wire in wires()], film_of_pair(0.0), 1.6, CONFIG)
    assert shown.length_m == (None if length_m is None else pytest.approx(length_m, abs=0.15))


def test_shields_and_suspension_structures_have_none() -> None:
    photos = film_of_pair(0.9)
    for line in (line_with("suspension"), line_with(of="shield")):
        (found,) = with_tension_strings([line], photos, CONFIG)
        assert [one.kind for one in found.structures] == [one.kind for one in line.structures]
        for wire, before in zip(found.wires, line.wires, strict=True):
            assert wire.ends == before.ends


def test_where_a_line_of_a_cloud_turns_the_interval_holds_a_tension_string() -> None:
    straight = line_with()
    one, other = straight.structures
    turns = (replace(one, line_angle_deg=20.0), replace(other, line_angle_deg=2.0))
    turning = replace(straight, structures=turns)
    (found,) = with_possible_strings([turning], CONFIG)
    for wire, before in zip(found.wires, turning.wires, strict=True):
        first, last = wire.ends
        assert isinstance(first, Attached) and TWO_SIDED_95 * first.sigma_m >= CONFIG.spacing_share * PHASES
        assert last == before.ends[1] and len(wire.notes) == 1
    (same,) = with_possible_strings([straight], CONFIG)
    assert [wire.ends for wire in same.wires] == [wire.ends for wire in straight.wires]


def test_a_string_ends_where_what_is_beside_the_axis_falls_and_not_where_it_rises() -> None:
    """Beyond the clamp the background may rise by a clearer step than that of a short string."""
    at = np.arange(0.0, 4.0, 0.1)
    q = np.where(at < 0.55, 0.6, np.where(at < 1.75, 0.25, 0.36))
    q[[2, 3, 5]] = 0.37, 0.31, 0.36  # a string's shells and the gaps between them
    length, _ = min(_misfits(at, q, 1.8, CONFIG), key=lambda one: one[1])
    assert length == pytest.approx(0.6, abs=0.15)
    assert _misfits(at, np.linspace(0.2, 0.4, len(at)), 1.8, CONFIG) == []


def test_of_two_lengths_that_describe_strings_as_well_the_lines_other_strings_tell_which() -> None:
    clear = Strings(1.0, 1.8, ((0.9, 7.1), (1.0, 6.5), (1.9, 25.7)))
    either = Strings(1.9, 1.8, ((0.9, 17.6), (1.0, 18.0), (1.9, 17.2)))
    bare, unknown = Strings(0.0, 1.8), Strings(None, 1.8)
    shown = {1: either, 2: clear, 3: bare, 4: unknown}
    assert _of_one_length(shown, {1, 2, 3, 4}, CONFIG) == {**shown, 1: replace(either, length_m=0.9)}
    assert _of_one_length(shown, {2, 3, 4}, CONFIG) == shown  # where 1 stands is not well known
    other = replace(either, misfits=((0.9, 27.6), (1.0, 28.0), (1.9, 17.2)))
    assert _of_one_length({1: other, 2: clear}, {1, 2}, CONFIG) == {1: other, 2: clear}


def test_settings_that_contradict_each_other_are_refused() -> None:
    with pytest.raises(ConfigError, match="rising"):
        TensionStringConfig(core_m=0.1)
    with pytest.raises(ConfigError, match="seen_to"):
        TensionStringConfig(seen_to=0.0)
    with pytest.raises(ConfigError, match="bare_ratio"):
        TensionStringConfig(bare_ratio=2.5)


def test_a_damper_beyond_the_clamp_is_no_part_of_the_string() -> None:
    """What is seen of a damper is less than of the string, and more than of the wire before and after it."""
    at = np.arange(0.0, 2.85, CONFIG.step_m)
    q = np.select([at < 0.75, at < 1.15, at < 1.85], [3.0, 0.2, 0.5], 0.06)

    def best(config: TensionStringConfig) -> float:
        return min(_misfits(at, q, 1.8, config), key=lambda one: one[1])[0]

    assert best(CONFIG) == pytest.approx(0.8)
    assert best(replace(CONFIG, damper_m=0.0)) == pytest.approx(1.9)
    # A string whose end is seen as well as its rest ends where it ends.
    whole = np.where(at < 1.45, 3.0, 0.2) * np.exp(np.random.default_rng(5).normal(0, 0.2, len(at)))
    assert min(_misfits(at, whole, 1.8, CONFIG), key=lambda one: one[1])[0] == pytest.approx(1.5)
