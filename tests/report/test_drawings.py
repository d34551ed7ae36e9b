"""What a report draws: the view in space, profiles, and wires over photos."""

import base64
import re
from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from tests.support import many_spans, surveys
from tests.support.read_html import Read

from plnerf.line.clearances import Clearances
from plnerf.line.cloud import CONDUCTOR, GROUND, HIGH_VEGETATION, Cloud
from plnerf.line.stations import chains
from plnerf.line.survey import Picture, Survey
from plnerf.report.nearest import by_need, worst
from plnerf.report.overlay import ASIDE, LEAST_ASIDE_PX, overlay, shown_picture
from plnerf.report.plan import plan
from plnerf.report.profile import UNSEEN, Drawing, profile, profiles
from plnerf.report.scene_view import MOST_POINTS, scene, thinned
from plnerf.report.side import below, fitting, runs, sheets, ticks


@cache
def report(name: str) -> Survey:
    return getattr(surveys, name)(0.1)


@cache
def many(name: str) -> Survey:
    return getattr(many_spans, name)()


def clearances(survey: Survey) -> Clearances:
    assert survey.clearances is not None
    return survey.clearances


def drawing(survey: Survey, span: int = 0) -> Drawing:
    """Of one span of the first line alone."""
    (chain,) = chains(survey.lines[0])
    return profile(survey, survey.lines[0], chain[span : span + 1], by_need(survey))


# The view in space


def positions(data: dict) -> np.ndarray:
    """What the page's script makes of the points: counted from the middle of the box."""
    steps = np.frombuffer(base64.b64decode(data["xyz"]), "<u2").reshape(-1, 3)
    return data["corner"] + steps * data["step"]


def test_points_come_out_where_they_are_in_the_world() -> None:
    survey = report("short")  # far fewer than are drawn at most: none is left out
    data, world = scene(survey, by_need(survey)), survey.frame.to_world(survey.cloud.xyz)
    assert data["count"] == len(survey.cloud.xyz) < MOST_POINTS
    shift = world - positions(data)
    assert np.ptp(shift, axis=0).max() < 0.002  # of a box of 100 m
    first = survey.wires[0]
    ends = survey.frame.to_world(first.points(np.array([0.0, first.base.length_m])))
    assert np.abs(np.array(data["wires"][0]["points"])[[0, -1]] + shift.mean(0) - ends).max() < 0.002
    mark, least = data["marks"][0], worst(by_need(survey))[0]
    apart = np.linalg.norm(np.subtract(*mark["points"]))
    assert apart == pytest.approx(least.place.distance_m, abs=1e-4)
    assert f"{least.place.distance_m:.2f}" in mark["text"] and data["axes"] == ["E", "N", "up"]


def test_unscaled_points_come_out_where_they_are_in_the_line_frame() -> None:
    survey = report("unscaled")
    data = scene(survey, [])
    shift = survey.cloud.xyz - positions(data)
    assert np.ptp(shift, axis=0).max() < 0.002
    assert data["axes"] == ["x", "y", "z"] and data["unit"] == "units"


def test_a_world_far_from_the_origin_keeps_its_millimetres() -> None:
    survey = report("short")
    move = np.array([5e5, 5.7e6, 300.0])
    far = replace(survey.frame, origin_world=survey.frame.origin_world + move)
    there, here = scene(replace(survey, frame=far), []), scene(survey, [])
    assert np.abs(positions(there) - positions(here)).max() < 0.004
    for a, b in zip(there["wires"], here["wires"], strict=True):
        assert np.abs(np.subtract(a["points"], b["points"])).max() < 1e-5


def test_points_are_thinned_evenly_and_every_class_stays() -> None:
    random = np.random.default_rng(0)
    n = 3 * MOST_POINTS
    xyz = random.uniform([0, 0, 0], [200, 60, 0.1], (n, 3))
    xyz[: n // 2, 0] /= 10  # a dense end
    label = np.full(n, GROUND, np.uint8)
    label[:40] = CONDUCTOR
    xyz[40:50] += 1e5
    cloud = Cloud(xyz, label, np.zeros(n, np.int64))
    wire = np.column_stack([np.linspace(0, 200, 41), np.full(41, 30.0), np.full(41, 20.0)])
    kept, edge = thinned(cloud, wire, 50.0)
    assert MOST_POINTS / 2 < len(kept) <= MOST_POINTS and len(set(kept.tolist())) == len(kept)
    assert not set(range(40, 50)) & set(kept.tolist())  # far from everything
    assert (label[kept] == CONDUCTOR).sum() > 20
    ground = xyz[kept][label[kept] == GROUND]
    counts = [((ground[:, 0] >= x) & (ground[:, 0] < x + 10)).sum() for x in (0, 10)]
    apart = np.abs(xyz[kept][:, None, :2] - wire[None, :, :2])
    assert np.hypot(*np.moveaxis(apart, 2, 0)).min(1).max() <= 50.0
    most = 600 / edge**2  # cubes in 10 m x 60 m
    assert all(0.6 * most < count <= 2.2 * most for count in counts)


# Profiles


def test_profiles_of_a_span_are_put_together() -> None:
    survey = report("short")
    ((side,),) = chains(survey.lines[0])
    profiles = [one.profile for one in clearances(survey).wires]
    under = below(side, profiles)
    assert (under.lowest <= under.highest + 1e-9)[np.isfinite(under.lowest)].all()
    every = np.concatenate([one.ground_z for one in profiles])
    assert np.nanmin(under.lowest) == pytest.approx(np.nanmin(every), abs=0.02)
    tops = np.concatenate([one.vegetation_z for one in profiles])
    assert np.nanmax(under.vegetation) == pytest.approx(np.nanmax(tops), abs=0.1)
    alone = below(side, profiles[:1])
    assert ((under.lowest <= alone.lowest + 1e-9) | np.isnan(alone.lowest)).all()


@pytest.mark.parametrize("corners", [(0.0, 40.0, -1.0, 16.0), (-5.0, 320.0, 0.0, 50.0), (0.0, 9e2, 3.0, 4.0)])
def test_a_drawing_fits_and_says_how_it_is_stretched(corners: tuple[float, float, float, float]) -> None:
    first, last, low, high = corners
    scale = fitting(first, last, low, high)
    assert scale.x(last) <= 1100 and scale.height <= 440.001
    assert scale.bottom <= low and scale.top >= high
    up = (scale.y(low) - scale.y(high)) / (high - low)
    along = (scale.x(last) - scale.x(first)) / (last - first)
    assert up / along == pytest.approx(scale.exaggeration)


@pytest.mark.parametrize(("low", "high"), [(0.0, 1.0), (-3.2, 17.0), (1e-3, 4e-3), (0.0, 812.0)])
def test_ticks_are_round_and_inside(low: float, high: float) -> None:
    found = ticks(low, high, 6.0)
    step = np.diff(found)
    assert 3 <= len(found) <= 13 and found[0] >= low - 1e-9 and found[-1] <= high + 1e-9
    assert f"{step[0]:.12e}"[0] in "125" and np.allclose(step, step[0])


def test_runs_are_the_stretches_that_are_true() -> None:
    good = np.array([1, 1, 0, 1, 0, 0, 1, 1, 1], bool)
    assert runs(good) == [slice(0, 2), slice(6, 9)]
    assert runs(np.zeros(4, bool)) == [] and runs(np.ones(4, bool)) == [slice(0, 4)]


def test_a_profile_states_its_stretch_and_what_is_not_known() -> None:
    long, survey = drawing(report("long")), report("short")
    assert "Heights exaggerated" in long.about and "no ground known" not in long.svg
    unknown = tuple(
        replace(one, profile=replace(one.profile, ground_z=np.full_like(one.profile.ground_z, np.nan)))
        for one in clearances(survey).wires
    )
    found = drawing(replace(survey, clearances=replace(clearances(survey), wires=unknown)))
    assert "at the same scale" in found.about and "no ground known" in found.svg
    letter, text = found.marks[0]
    least = worst(by_need(survey))[0]
    assert letter == "A" and f"wire {least.place.wire}" in text and least.words in text
    unmeasured = drawing(replace(survey, clearances=None))
    assert "the ground was not measured" in unmeasured.svg and not unmeasured.marks


def ticks_of_heights(svg: str) -> list[float]:
    """The numbers beside the drawing's grid."""
    grid = svg.split('class="grid"/>')[1:]
    return [float(part.split(">")[1].split("<")[0].replace("−", "-")) for part in grid]


def test_heights_of_a_profile_are_those_of_the_world() -> None:
    survey = report("short")
    tall = ticks_of_heights(drawing(survey).svg)
    wires = np.concatenate([survey.frame.to_world(wire.polyline(1.0)) for wire in survey.wires])
    assert min(tall) < wires[:, 2].min() - 5 < wires[:, 2].max() < max(tall) + 2
    leaning = replace(survey.frame, R_line_world=survey.frame.R_line_world @ lean(2.0))
    assert max(ticks_of_heights(drawing(replace(survey, frame=leaning)).svg)) < 20  # the LineFrame's


def lean(degrees: float) -> np.ndarray:
    """A rotation about x."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def test_open_ends_and_what_was_not_seen_are_drawn_so() -> None:
    whole, cut = drawing(report("short")), drawing(report("open_ended"))
    assert whole.svg.count('fill="white" stroke="#d55e00"') == 0 and "open end" not in whole.about
    assert cut.svg.count('r="3.6" fill="white"') == 5 and "a ring an open end" in cut.about
    pale = f'stroke-opacity="{UNSEEN:g}"'
    assert pale not in whole.svg and cut.svg.count(pale) == 1 and "not seen are pale" in cut.about
    assert "structure 1" in cut.svg and "structure 2" not in cut.svg


def test_every_span_is_drawn_under_its_number() -> None:
    two = report("two_lines")
    assert [one.title for one in profiles(two, by_need(two))] == ["Line 1, span 1", "Line 2, span 1"]
    long = report("long")
    assert [one.title for one in profiles(long, by_need(long))] == ["Spans 1 and 2"]
    assert [drawing(long, k).title for k in (0, 1)] == ["Span 1", "Span 2"]
    Read(drawing(two).svg)  # whose tags match


@pytest.mark.slow
def test_a_long_line_is_drawn_on_several_sheets_one_after_the_other() -> None:
    survey = many("eight")
    found = profiles(survey, by_need(survey))
    assert [one.title for one in found] == ["Spans 1 to 4", "Spans 5 to 8"]
    ends = [feet_of(one.svg) for one in found]
    assert [sorted(one) for one in ends] == [[1, 2, 3, 4, 5], [5, 6, 7, 8, 9]]
    for one, other in pairwise(ends[0].values()):
        assert one < other
    (chain,) = chains(survey.lines[0])
    assert [len(sheet) for sheet in sheets(chain * 1)] == [4, 4]
    assert [len(sheet) for sheet in sheets(chain[:5])] in ([2, 3], [3, 2])
    assert "span 2: 310.0\u00a0m, 36.1°" in found[0].svg and "4: strain, turns 24.0°" in found[0].svg
    assert "station along the line" in found[0].svg and "along the span" in drawing(report("short")).svg


def feet_of(svg: str) -> dict[int, float]:
    """x of the masts by their numbers."""
    found = re.findall(r'M([\d.]+),[\d.]+ L[^"]*" [^>]*><title>structure (\d+)<', svg)
    return {int(number): float(x) for x, number in found}


def test_wires_meet_at_their_structures_along_the_line() -> None:
    """In a line with a bend, drawn by stations: the wires between the arms' axis end at the masts."""
    survey = many("bent")
    first, second = profiles(survey, by_need(survey))
    assert (first.title, second.title) == ("Line 1, spans 1 to 3", "Line 2, span 4")
    middle = survey.lines[0].spans[0].wires[1]
    drawn = first.svg.split(f"<title>wire {middle.id}, phase</title>")[0].rsplit('points="', 1)[1]
    x = [float(pair.split(",")[0]) for pair in drawn.split('"')[0].split()]
    masts = feet_of(first.svg)
    assert x[0] - 7 == pytest.approx(masts[1], abs=0.3) and x[-1] - 7 == pytest.approx(masts[2], abs=0.3)
    crosses = re.findall(r"<title>wire (\d+)</title></path>", first.svg)
    assert set(map(int, crosses)) == {wire.id for wire in survey.lines[1].wires} and len(crosses) == 12
    assert "a cross a wire of a line that crosses" in first.about and "a ring an open end" in first.about
    assert not re.search("nan", first.svg + second.svg)


# The plan


def test_the_plan_shows_every_span_structure_and_open_end() -> None:
    survey = many("bent")
    drawn = plan(survey)
    assert drawn is not None
    Read(drawn.svg)
    for text in ("1 / 1: 80.6", "1 / 2: 91.8", "2 / 4: 114.0", ">3 (27.1°)<", ">5<", ">50 m<", ">N<"):
        assert text in drawn.svg, text
    assert drawn.svg.count('r="3.4"') == 4 and drawn.svg.count("<rect ") == 4
    assert "rings: open ends" in drawn.about and "crosses: where wires" in drawn.about
    short = plan(report("short"))
    assert short is not None and "turns" not in short.about and "rings" not in short.about
    assert "span 1: 40.8" in short.svg and plan(report("empty")) is None


@pytest.mark.slow
def test_the_plan_keeps_lengths_and_directions() -> None:
    survey = many("eight")
    drawn = plan(survey)
    assert drawn is not None
    at = np.array(re.findall(r'<(?:rect x|circle cx)="([\d.]+)" c?y="([\d.]+)"', drawn.svg), float)
    squares = np.array([one.kind in {"strain", "terminal"} for one in survey.structures])
    at[squares] += 5  # of a square, the corner
    feet = np.array([survey.frame.to_world(one.foot)[:2] for one in survey.structures])
    apart, true = (np.linalg.norm(np.diff(points, axis=0), axis=1) for points in (at, feet))
    assert apart / true == pytest.approx(np.full(8, (apart / true).mean()), rel=0.01)
    assert abs(at[0, 1] - at[-1, 1]) < 1 and at[0, 0] < at[-1, 0]  # from left to right
    turns = np.degrees(np.diff(np.unwrap(np.arctan2(*np.diff(at * [1, -1], axis=0).T[::-1]))))
    assert turns == pytest.approx([0, 0, 24, 0, 1, -38, 0], abs=0.5)  # to the left where positive


def test_texts_of_spans_keep_clear_of_crossings() -> None:
    drawn = plan(many("bent"))
    assert drawn is not None
    texts = np.array(re.findall(r'translate\(([\d.]+) ([\d.]+)\) rotate\([-\d.]+\)" text', drawn.svg), float)
    crosses = np.array(re.findall(r"M([\d.]+),([\d.]+) l7,7 m0", drawn.svg), float)
    assert len(texts) == 4 and len(crosses) == 12
    assert np.linalg.norm(texts[:, None] - crosses, axis=2).min() > 50


# Wires over photos


def test_lines_lie_beside_the_wire_and_leave_it_free() -> None:
    grey, x = np.full((300, 640, 3), 90, np.uint8), np.linspace(-30, 700, 80)
    line = np.column_stack([x, 80.5 + 0.002 * (x - 320) ** 2 / 4])
    drawn = overlay(grey, [line], [(255, 0, 0)])
    assert (grey == 90).all()
    aside = max(LEAST_ASIDE_PX, 640 * ASIDE)
    for column in (5, 320, 600):
        rows = np.flatnonzero(drawn[:, column, 0] > 150)
        slope = np.interp(column + 0.5, x, np.gradient(line[:, 1], x))
        middle = np.interp(column + 0.5, x, line[:, 1])
        weight = drawn[:, column, 0].astype(float) - 90
        assert np.average(np.arange(300) + 0.5, weights=weight) == pytest.approx(middle, abs=0.3)
        assert np.ptp(rows) == pytest.approx(2 * aside * np.hypot(1, slope), abs=2.0)
        around = slice(round(middle - 0.5) - 1, round(middle - 0.5) + 2)
        assert (drawn[around, column] == 90).all()
    assert (drawn[..., 2] <= 90).all()


@pytest.mark.parametrize("degrees", [0, 35, 90, 125, 200])
def test_lines_keep_their_distance_whichever_way_the_wire_runs(degrees: int) -> None:
    u = np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])
    line = [150.0, 150.0] + np.linspace(-100, 100, 30)[:, None] * u
    drawn = overlay(np.zeros((300, 300, 3), np.uint8), [line], [(255, 255, 255)])
    row, column = np.nonzero(drawn[..., 0] > 100)
    across = (np.column_stack([column, row]) + 0.5 - 150) @ [-u[1], u[0]]
    assert np.abs(np.abs(across) - LEAST_ASIDE_PX).max() < 0.8
    assert abs((across > 0).mean() - 0.5) < 0.05


def test_what_cannot_be_seen_is_not_drawn() -> None:
    grey = np.full((200, 300, 3), 90, np.uint8)
    line = np.column_stack([np.linspace(0, 300, 61), np.full(61, 100.0)])
    line[20:41] = np.nan
    line[-1] = [1e12, -1e12]
    drawn = overlay(grey, [line], [(0, 0, 255)])
    painted = (drawn != 90).any((0, 2))
    assert painted[5:90].all() and not painted[105:198].any() and painted[210:285].all()
    assert (overlay(grey, [np.zeros((0, 2))], [(1, 2, 3)]) == grey).all()


def test_pictures_show_every_wire_in_the_colour_of_its_kind() -> None:
    survey = report("short")
    grey = np.full((300, 640, 3), 90, np.uint8)
    lines = tuple(np.column_stack([np.linspace(0, 640, 9), np.full(9, 40.0 + 50 * k)]) for k in range(5))
    outside = (*lines[:3], lines[3] + [0, 900], np.full((4, 2), np.nan))
    found = shown_picture(Picture("a.jpg", grey, outside), survey.wires)
    assert found.caption == "a.jpg: wires 1 to 3" and (found.width, found.height) == (640, 300)
    with pytest.raises(ValueError, match="zip"):
        shown_picture(Picture("a.jpg", grey, lines[:2]), survey.wires)
    assert (
        shown_picture(Picture("a.jpg", np.zeros((90, 2560, 3), np.uint8), lines), survey.wires).width == 1280
    )


def test_the_helper_draws_the_wires_that_it_says() -> None:
    survey = report("short")
    assert len(survey.wires) == 5 and len(report("long").wires) == 12
    sag = survey.wires[0].sag
    assert sag is not None and sag.value == pytest.approx(1.21, abs=1e-9)
    assert (survey.cloud.label == HIGH_VEGETATION).any()
    assert clearances(survey).wires[0].profile.wire == 1
