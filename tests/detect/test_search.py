"""What makes a line: its stretch, its shape beside the best one's, and what is left when others are known."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from plnerf.detect.candidate import (
    Candidate,
    common_ends,
    hang_alike,
    hangs,
    leaders,
    select_wires,
    without_gaps,
)
from plnerf.detect.config import DetectConfig, SearchConfig, SelectConfig
from plnerf.detect.detect import compile_kernels
from plnerf.detect.line_ridges import LineRidges
from plnerf.detect.parabola import curve_points
from plnerf.detect.search import Search, stretches
from plnerf.detect.together import followed, variants
from plnerf.detect.views import Views
from plnerf.detect.window_search import repeated, without_mixtures

LENGTH = 2.0
SEARCH, SELECT = SearchConfig(), SelectConfig()
PLANES = 96


def line(
    y: float = 0.0, rise: float = 0.1, sag: float = 0.04, odds: float = 900.0, planes: int = PLANES
) -> Candidate:
    theta, covariance = np.array([y, y, 0.1, 0.1 + rise, sag, 0.0]), np.eye(6) * 1e-8
    return Candidate(theta, covariance, 0.3, 12, odds, (0, planes))


@given(st.lists(st.integers(-9, 9), min_size=1, max_size=12))
@settings(max_examples=200, deadline=None)
def test_a_stretch_is_the_largest_of_all_sums(odds: list[int]) -> None:
    total, first, last = stretches(np.array([odds], float))[:, 0]
    sums = [sum(odds[a:b]) for a in range(len(odds)) for b in range(a + 1, len(odds) + 1)]
    assert total == max(0, *sums)
    if total > 0:
        assert sum(odds[int(first) : int(last) + 1]) == total


def test_alike_is_the_same_slope_and_about_the_same_sag() -> None:
    ratio, slope = SELECT.max_sag_ratio, SELECT.max_slope_difference

    def alike(a: Candidate, b: Candidate) -> bool:
        return hang_alike(a, b, LENGTH, SELECT)

    assert alike(line(), line(y=0.3))
    assert alike(line(), line(sag=0.04 * 0.99 * ratio))
    assert not alike(line(), line(sag=0.04 * 1.01 * ratio))
    assert not alike(line(), line(rise=0.1 + 1.01 * slope * LENGTH))
    assert not alike(line(), line(sag=-0.04))
    assert not alike(line(sag=-0.04), line(sag=-0.04))
    for a, b in ((line(), line(sag=0.06)), (line(), line(sag=0.07)), (line(), line(rise=0.14))):
        assert alike(a, b) == alike(b, a)


def test_what_sags_by_no_more_than_its_doubt_does_not_hang() -> None:
    assert hangs(line(sag=0.004), LENGTH, SELECT) and not hangs(line(sag=0.0019), LENGTH, SELECT)
    doubtful = line(sag=0.02)
    doubtful.covariance[4, 4] = (1.05 * 0.02 / SELECT.sag_sigmas) ** 2
    assert not hangs(doubtful, LENGTH, SELECT)
    assert hangs(doubtful, LENGTH, replace(SELECT, sag_sigmas=0.9 * SELECT.sag_sigmas))


def test_what_hangs_free_needs_less_sag_and_what_lies_on_something_never_hangs() -> None:
    doubtful = line(sag=0.02)
    doubtful.covariance[4, 4] = (0.02 / (SELECT.sag_sigmas_free + 0.5)) ** 2
    assert not hangs(doubtful, LENGTH, SELECT)
    assert hangs(replace(doubtful, likeness=SELECT.free), LENGTH, SELECT)
    assert not hangs(replace(doubtful, likeness=1.01 * SELECT.free), LENGTH, SELECT)
    best, lying = line(), replace(line(y=0.2), likeness=1.01 * SELECT.lies_alike)
    assert hangs(best, LENGTH, SELECT) and not hangs(lying, LENGTH, SELECT)
    assert select_wires([best, lying], LENGTH, SELECT) == [best]


def test_views_beside_a_clear_line_that_hangs_as_the_best_may_be_more_alike() -> None:
    best, beside = line(), replace(line(y=0.2), likeness=1.01 * SELECT.lies)
    assert select_wires([best, beside], LENGTH, SELECT) == [best, beside]
    assert select_wires([beside], LENGTH, SELECT) == []
    faint = replace(beside, odds=SELECT.min_odds - 1)
    unlike = replace(beside, theta=line(y=0.2, sag=0.1).theta)
    doubtful = replace(beside, covariance=(best.theta[4] / SELECT.sag_sigmas) ** 2 * 1.1 * np.eye(6))
    for other in (faint, unlike, doubtful):
        assert select_wires([best, other], LENGTH, SELECT) == [best]


def test_how_sharp_ridges_are_is_learnt_from_what_hangs() -> None:
    search = a_search()
    road = replace(line(sag=0.0, planes=3), rms_px=3.0)
    search.mask_ridges(road)
    wide = round(SEARCH.mask_rms * 3.0)
    assert search.sharpness is None and search.mask_px(road) == wide
    wire = line(planes=3)
    search.mask_ridges(wire)
    assert search.sharpness is not None and search.sharpness.mask_px == SEARCH.mask_px
    assert search.mask_px(road) == wide  # what was masked can be put back
    assert search.mask_px(line(y=0.5)) == SEARCH.mask_px
    ridges = LineRidges(search.responses, search.tangents)
    known = Search(search.views, ridges, search.x, search.config, search.sharpness)
    assert known.odds.sharp_px == search.sharpness.odds_px


def test_ridges_count_farther_away_while_they_are_blurred_and_not_after() -> None:
    search = a_search()
    search.mask_ridges(line(planes=3))
    sharp_px, wide_px = search.odds.sharp_px, search.config.odds.sharp_px
    assert search.sharpness is not None and sharp_px == search.sharpness.odds_px < wide_px
    with search.blurred():
        search.mask_ridges(line(y=0.2, planes=3))
        assert search.odds.sharp_px == search.claims.sharp_px == wide_px
    assert search.odds.sharp_px == search.claims.sharp_px == sharp_px


def test_wires_hang_like_the_best_or_have_much_evidence() -> None:
    best, twin, road = line(odds=900.0), line(y=0.1, odds=210.0, planes=60), line(sag=0.0, odds=2000.0)
    faint = line(y=-0.1, odds=SELECT.min_odds_similar - 1)
    other, beside = line(sag=0.1, odds=SELECT.min_odds + 1), line(y=0.1, sag=0.1, odds=SELECT.min_odds - 1)
    weak = line(sag=0.2, odds=SELECT.min_odds - 1)
    part = line(sag=0.2, odds=SELECT.min_odds + 1, planes=SELECT.min_planes - 1)
    point = replace(line(y=0.2), seen=(7, 7))  # no wire is as short as a plane
    lines = [road, best, twin, faint, other, beside, weak, part, point]
    found = select_wires(lines, LENGTH, SELECT)
    assert [id(one) for one in found] == [id(one) for one in (best, twin, other, beside)]
    for none in ([road], []):
        assert select_wires(none, LENGTH, SELECT) == []


def test_past_the_end_of_the_leaders_span_a_line_needs_as_much_as_the_first() -> None:
    """A lattice tower's members are seen on from the last wire's end, and some hang as the wires do."""
    best = replace(line(odds=900.0), seen=(30, 90))
    for seen, needed in (((22, 38), 200.0), ((22, 39), 200.0), ((21, 38), 250.0), ((5, 25), 250.0)):
        enough, less = (replace(line(y=0.1, odds=odds), seen=seen) for odds in (needed, needed - 1))
        assert select_wires([best, enough, less], LENGTH, SELECT) == [best, enough]
    beside = replace(line(y=0.1, odds=SELECT.min_odds_repeated), seen=(5, 25), repeats=True)
    assert select_wires([best, beside], LENGTH, SELECT) == [best]


def test_a_line_that_hangs_as_no_other_is_a_wire_only_where_it_is_known_to_hang_in_the_air() -> None:
    best, other = line(odds=900.0), line(sag=0.1, odds=SELECT.min_odds + 1)
    free = replace(other, likeness=SELECT.free)
    unclear = replace(other, likeness=(SELECT.free + SELECT.lies) / 2)
    beside = line(y=0.1, sag=0.1, odds=SELECT.min_odds_similar)
    for lines, wires in (
        ([best, other], [best]),
        ([best, unclear], [best]),
        ([best, free], [best, free]),
        ([best, other, beside], [best, other, beside]),
        ([other], [other]),  # it is the best
    ):
        assert [id(one) for one in select_wires(lines, LENGTH, SELECT)] == [id(one) for one in wires]


def test_pieces_of_the_next_span_bend_as_the_best_does() -> None:
    """Each in another place of its parabola; a leader of each span, the best first."""
    best, twin = line(odds=900.0, planes=45), line(y=0.1, odds=800.0, planes=45)
    piece, beside = line(rise=0.6, sag=0.045, odds=500.0, planes=40), line(0.1, 0.6, 0.045, 400.0, 40)
    short = line(rise=-0.6, sag=0.045, odds=500.0, planes=SELECT.min_planes - 1)
    lines = [beside, short, twin, piece, best]
    found = select_wires(lines, LENGTH, SELECT)
    assert [id(one) for one in found] == [id(one) for one in (beside, twin, piece, best)]
    first = leaders(lines, LENGTH, SELECT)
    assert [id(one) for one in first] == [id(one) for one in (best, piece)]
    assert leaders([line(sag=0.0)], LENGTH, SELECT) == []


def test_what_the_views_do_not_fix_leads_nothing_beside_what_they_fix() -> None:
    far, wire = line(sag=0.09, odds=2000.0), replace(line(odds=600.0), fixed=True)
    assert leaders([far, wire], LENGTH, SELECT) == [wire]
    assert select_wires([far, wire], LENGTH, SELECT) == [wire]
    assert leaders([far, line(odds=600.0)], LENGTH, SELECT)[0] is far


def test_the_background_between_twins_is_no_third() -> None:
    pixel, pair = 0.01, [line(y=0.0), line(y=0.08, odds=800.0)]
    gap, strong = line(y=0.042, odds=500.0), line(y=0.042, odds=850.0)
    assert without_gaps([*pair, gap], PLANES, pixel, SEARCH) == pair
    assert without_gaps([*pair, strong], PLANES, pixel, SEARCH) == [*pair, strong]
    for other in (line(y=0.06, odds=500.0), line(y=0.12, odds=500.0)):
        assert without_gaps([*pair, other], PLANES, pixel, SEARCH) == [*pair, other]
    assert without_gaps([*pair, gap], PLANES, pixel / 2, SEARCH) == [*pair, gap]  # 8 px to either side
    faint = replace(gap, odds=SEARCH.faint * 790.0)
    assert without_gaps([*pair, faint], PLANES, pixel / 2, SEARCH) == pair
    far = pixel / SEARCH.faint_gap_px * 3
    assert without_gaps([*pair, faint], PLANES, far, SEARCH) == [*pair, faint]


def test_wires_that_hang_alike_end_where_the_longest_does() -> None:
    a, b, other = (
        replace(one, seen=seen, fixed=True)
        for one, seen in ((line(), (5, 60)), (line(y=0.1), (10, 80)), (line(sag=0.1), (0, 90)))
    )
    ends = [common_ends(one, [a, b, other], LENGTH, SELECT) for one in (a, b, other)]
    assert ends == [(5, 80), (5, 80), (0, 90)]
    vague = replace(b, fixed=False)  # what is not fixed itself fixes no other's end
    assert common_ends(a, [a, vague, other], LENGTH, SELECT) == (5, 60)


def test_of_three_wires_the_second_outermost_end_counts() -> None:
    """Chance ridges beyond the end deceive one wire, hardly two."""
    stretches = {0.0: (2, 80), 0.1: (10, 93), 0.2: (12, 82)}
    three = [replace(line(y=y), seen=seen, fixed=True) for y, seen in stretches.items()]
    assert [common_ends(one, three, LENGTH, SELECT) for one in three] == [(10, 82)] * 3


def a_search() -> Search:
    """Of one view without a ridge."""
    views = Views(np.eye(3)[None], np.zeros((1, 3)), np.full((1, 2), 8.0), np.full((1, 2), 4.0),
                  np.zeros((1, 5)), np.full((1, 2), 8), np.zeros(1, np.int64))  # fmt: skip
    none = LineRidges(np.zeros(64, np.float32), np.zeros(64, np.uint8))
    return Search(views, none, np.linspace(-1, 1, 4), DetectConfig())


def rated_as(search: Search, rows: list[tuple[float, float, float]], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(search, "rated", lambda curves: np.array(rows).T[:, : len(curves)])


def test_of_curves_that_lie_near_each_other_where_they_show_the_best_is_kept(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    search, apart = a_search(), SEARCH.apart
    near = line(rise=0.1 + 1.9 * apart).theta  # within `apart` over the first half of it
    curves = np.array([line().theta, near, line(y=2 * apart).theta, line(y=9.0).theta])
    rated_as(search, [(500.0, 0, 0.5), (900.0, 0, 0.5), (300.0, 0, 1.0), (0.0, 0, 1.0)], monkeypatch)
    assert search.distinct(curves).tolist() == [near.tolist(), curves[2].tolist()]
    rated_as(search, [(500.0, 0, 0.5), (900.0, 0, 1.0), (300.0, 0, 1.0), (0.0, 0, 1.0)], monkeypatch)
    assert search.distinct(curves)[:1].tolist() == [near.tolist()]
    rated_as(search, [(900.0, 0.5, 1.0), (500.0, 0.5, 1.0), (300.0, 0, 1.0), (0.0, 0, 1.0)], monkeypatch)
    assert search.distinct(curves).tolist() == [curves[k].tolist() for k in (0, 1, 2)]
    assert search.ranked(curves)[-1].tolist() == curves[3].tolist()


def test_curves_alike_meet_a_curve_where_it_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    search, leader = a_search(), line(rise=0.2, sag=0.05)
    leader.theta[5] = 0.02  # swung by wind
    own = line(y=0.3, rise=0.1, sag=0.01).theta
    rated_as(search, [(500.0, 0.1, 0.5)], monkeypatch)
    of_shape, of_bend = search.alike(leader.theta, own[None])
    for curve in (of_shape, of_bend):
        assert curve_points(curve, 0.3) == pytest.approx(curve_points(own, 0.3))
        assert (curve[4:] == leader.theta[4:]).all()
    assert [of_shape[1] - of_shape[0], of_shape[3] - of_shape[2]] == pytest.approx([0.0, 0.2])
    step = 1e-6  # the second one touches it there
    for one, other in zip(curve_points(of_bend, 0.3 + step), curve_points(own, 0.3 + step), strict=True):
        assert one == pytest.approx(other, abs=1e-10)


def test_a_line_is_the_same_on_more_planes() -> None:
    search = a_search()
    step = search.x[1] - search.x[0]
    wire = replace(line(), seen=(1, 3))
    search.mask_ridges(wire)
    width = search.mask_px(wire)
    (longer,) = search.lengthen(2, 5, [wire])
    assert len(search.x) == 4 + 7 and search.x[2] == pytest.approx(-1) and np.ptp(np.diff(search.x)) < 1e-12
    assert longer.seen == (3, 5) and search.mask_px(longer) == width
    for plane in (0, 1.5, 3):
        there = curve_points(longer.theta, (plane + 2) / 10)
        assert there == pytest.approx(curve_points(wire.theta, plane / 3))
    assert search.length == pytest.approx(10 * step)
    search.free_ridges(longer)
    assert not search.claims.masks.any()


def test_what_is_followed_is_never_lost() -> None:
    search, wire = a_search(), line(planes=3)  # there is no ridge to fit it to
    search.mask_ridges(wire)
    before = search.claims.masks.copy()
    assert before.any() and followed(search, [wire]) == [wire]
    assert (search.claims.masks == before).all()


def test_a_line_takes_ridges_where_it_is_seen_only() -> None:
    whole, aside = a_search(), a_search()
    whole.mask_ridges(line(planes=3))
    aside.mask_ridges(line(planes=1))  # up to a third of the window, which is left of the image
    assert whole.claims.masks.any() and not aside.claims.masks.any()


def test_lines_are_repeated_by_what_lies_between_any_two() -> None:
    a, b, c = line(y=0.0), line(y=0.1), line(y=0.4)
    found = {round(float(theta[0]), 6) for theta in repeated([a, b, c], PLANES)}
    assert {0.5, 0.3, -0.1, -0.3, -0.4} <= found  # c + (b - a), c - (b - a), a - (b - a), ...
    assert not len(repeated([a], PLANES))
    assert all(theta[3] - theta[2] == pytest.approx(0.1) for theta in repeated([a, b, c], PLANES))


def test_a_line_that_repeats_needs_less_evidence() -> None:
    best, few = line(), line(y=0.1, odds=(SELECT.min_odds_repeated + SELECT.min_odds_similar) / 2)
    assert select_wires([best, few], LENGTH, SELECT) == [best]
    repeats = replace(few, repeats=True)
    assert select_wires([best, repeats], LENGTH, SELECT) == [best, repeats]


def test_variants_meet_the_line_in_three_places() -> None:
    own, other = line(rise=0.1, sag=0.04), line(y=0.2, rise=0.12, sag=0.05)
    found = variants(own, [own, other], PLANES + 1)
    assert len(found) == 4 and (found[0] == own.theta).all()
    for theta, s in zip(found[1:], (1 / 6, 1 / 2, 5 / 6), strict=True):
        assert curve_points(theta, s) == pytest.approx(curve_points(own.theta, s))
        assert theta[[1, 3]] - theta[[0, 2]] == pytest.approx(other.theta[[1, 3]] - other.theta[[0, 2]])
        assert theta[4] == other.theta[4]


def test_variants_meet_a_line_that_is_seen_in_part_where_it_is_seen() -> None:
    own, other = replace(line(planes=40), seen=(20, 40)), line(y=0.2, sag=0.05)
    found = variants(own, [own, other], 101)[1:]
    for theta, plane in zip(found, (20 + 20 / 6, 30, 40 - 20 / 6), strict=True):
        assert curve_points(theta, plane / 100) == pytest.approx(curve_points(own.theta, plane / 100))


def test_lines_in_the_air_that_do_not_hang_give_their_ridges_back() -> None:
    search = a_search()
    wire, lying = line(planes=3), line(sag=0.0, planes=3)
    wire, road, unknown = replace(wire, likeness=0.0), replace(lying, likeness=0.9), lying
    mixture = replace(lying, likeness=SELECT.free)
    lines = [wire, road, mixture, unknown]
    for one in lines:
        search.mask_ridges(one)
    before = search.claims.masks.copy()
    assert without_mixtures(search, lines) == [wire, road, unknown]
    assert (search.claims.masks <= before).all() and before.any() and (search.claims.masks < before).any()
    assert without_mixtures(search, [wire, road, unknown], hanging=False) == [road, unknown]


def test_compiling_needs_no_scene_and_warns_of_nothing(recwarn: pytest.WarningsRecorder) -> None:
    compile_kernels()
    assert not list(recwarn)
