"""What a report draws: the view in space, profiles, and wires over photos."""

import base64
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import surveys
from tests.support.read_html import Read

from plnerf.line.catenary import hang
from plnerf.report.data import Profile, Report
from plnerf.report.overlay import ASIDE, LEAST_ASIDE_PX, overlay
from plnerf.report.profile import profile
from plnerf.report.scene_view import MOST_POINTS, scene, thinned
from plnerf.report.side import below, fitting, runs, side_of, ticks
from plnerf.survey.model import CONDUCTOR, GROUND, HIGH_VEGETATION, Cloud


@cache
def report(name: str) -> Report:
    return {"short": surveys.short, "long": surveys.long}[name](0.1)


# The view in space


def positions(data: dict) -> np.ndarray:
    """What the page's script makes of the points: counted from the middle of the box."""
    steps = np.frombuffer(base64.b64decode(data["xyz"]), "<u2").reshape(-1, 3)
    return data["corner"] + steps * data["step"]


def test_points_come_out_where_they_are() -> None:
    told = report("short")  # far fewer than are drawn at most: none is left out
    data = scene(told)
    held = np.concatenate([one.fit.curve.points(np.linspace(0, 1, 9) * one.fit.curve.span_m)
                           for one in told.survey.conductors])  # fmt: skip
    assert data["count"] == len(told.survey.cloud.xyz) < MOST_POINTS
    shift = told.survey.cloud.xyz - positions(data)
    assert np.ptp(shift, axis=0).max() < 0.002  # of a box of 100 m
    wire = np.array(data["wires"][0]["points"]) + shift.mean(0)
    assert np.abs(wire[[0, -1]] - held[[0, 8]]).max() < 0.002
    mark, worst = data["marks"][0], told.worst()[0]
    apart = np.linalg.norm(np.subtract(*mark["points"]))
    assert apart == pytest.approx(worst.distance_m, abs=1e-4) and f"{worst.distance_m:.2f}" in mark["text"]


def test_a_grid_far_from_the_origin_keeps_its_millimetres() -> None:
    told, move = report("short"), np.array([5e5, 5.7e6, 300.0])
    cloud = replace(told.survey.cloud, xyz=told.survey.cloud.xyz + move)
    conductors = tuple(
        replace(one, fit=replace(one.fit, base=replace(one.fit.base, o=one.fit.base.o + move[:2]),
                                 q=one.fit.q + move[2] * np.array([0, 0, 1, 1, 0])))
        for one in told.survey.conductors
    )  # fmt: skip
    towers = tuple(replace(one, foot=one.foot + move) for one in told.survey.towers)
    near = scene(Report(replace(told.survey, towers=towers, conductors=conductors, cloud=cloud)))
    here = scene(Report(told.survey))
    assert np.abs(positions(near) - positions(here)).max() < 0.004
    for a, b in zip(near["wires"], here["wires"], strict=True):
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
    told = report("short")
    conductors = told.spans[0]
    under = below(side_of(conductors), conductors, list(told.profiles))
    assert (under.lowest <= under.highest + 1e-9)[np.isfinite(under.lowest)].all()
    every = np.concatenate([one.ground_m for one in told.profiles])
    assert np.nanmin(under.lowest) == pytest.approx(np.nanmin(every), abs=0.02)
    tops = np.concatenate([one.vegetation_m for one in told.profiles])
    assert np.nanmax(under.vegetation) == pytest.approx(np.nanmax(tops), abs=0.1)
    alone = below(side_of(conductors), conductors, [told.profiles[0]])
    assert ((under.lowest <= alone.lowest + 1e-9) | np.isnan(alone.lowest)).all()


def test_wires_fitted_from_either_end_share_an_axis() -> None:
    told = report("short")
    first, second = told.spans[0][:2]
    base = second.fit.base
    q = second.fit.q[[1, 0, 3, 2, 4]] * [-1, -1, 1, 1, 1]
    back = replace(base, o=base.o + base.length_m * base.u, u=-base.u)
    turned = replace(second, fit=replace(second.fit, base=back, q=q))
    assert np.abs(np.subtract(turned.fit.curve.a, second.fit.curve.b)).max() < 1e-9
    one, other = side_of([first, second]), side_of([first, turned])
    assert np.abs(one.u - other.u).max() < 1e-12 and one.length == pytest.approx(other.length)
    assert one.length == pytest.approx(40.0, abs=0.2)


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
    long = "".join(Read(profile(report("long"), 0)).texts)
    assert "heights exaggerated" in long and "no ground known" not in long
    told = report("short")
    unknown = tuple(replace(one, ground_m=np.full_like(one.ground_m, np.nan)) for one in told.profiles)
    text = "".join(Read(profile(replace(told, profiles=unknown), 0)).texts)
    assert "at the same scale" in text and "no ground known" in text
    worst = told.worst()[0]
    assert f"conductor {worst.conductor}" in text and worst.verdict in text


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


def test_the_helper_draws_the_wires_that_it_says() -> None:
    told = report("short")
    assert len(told.survey.conductors) == 5 and len(report("long").survey.conductors) == 12
    true = hang((-20.0, -3.1, 10.0), (20.0, -2.7, 10.9), 1.21)
    assert told.survey.conductors[0].fit.curve.sag_m == pytest.approx(true.sag_m, abs=0.02)
    assert (told.survey.cloud.label == HIGH_VEGETATION).any()
    assert isinstance(told.profiles[0], Profile)
