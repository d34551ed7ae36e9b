"""Windows cover a line's direction past all cameras; pieces of one wire become one again."""

import math
from dataclasses import replace

import numpy as np
import pytest
from tests.support.drawn import HALF, hanging, pinhole_cameras, two_passes, uncertain

from plnerf.detect.config import JoinConfig
from plnerf.detect.config_lines import ChainConfig
from plnerf.detect.config_windows import WindowConfig
from plnerf.detect.directions import Direction
from plnerf.detect.join import joined, with_onward
from plnerf.detect.views import project_point, views_of
from plnerf.detect.windows import Window, spacing_along, windows_along
from plnerf.line.base import Base

CONFIG = WindowConfig()


@pytest.mark.parametrize("azimuth_rad", [0.0, 0.7, 2.0])
def test_a_window_keeps_what_cameras_see(azimuth_rad: float) -> None:
    views = views_of(two_passes(4))
    origin = np.array([0.1, -0.2, 0.3])
    window = Window(origin, azimuth_rad, 0.7, np.full(2, -1.0), np.full(2, 1.0), np.array([1, 4, 6]), 96)
    mine = window.seen_by(views)
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (60, 3))
    np.testing.assert_allclose(window.to_scene(window.of_scene(points)), points, atol=1e-12)
    seen = 0
    for k, n in enumerate(window.views):
        for point in points:
            u, v, depth = project_point(views, n, *point)
            again = project_point(mine, k, *window.of_scene(point[None])[0])
            if depth > 0:
                seen += 1
                assert again[:2] == pytest.approx((u, v), abs=1e-8)
                assert again[2] * window.half == pytest.approx(depth)
    assert seen > 20
    assert mine.starts.tolist() == [0, 240 * 180, 2 * 240 * 180]


def long_track(count: int) -> np.ndarray:
    x = 2.0 * np.arange(count)
    return np.stack([x, np.full(count, -5.0), np.full(count, 10.0)], 1)


def test_windows_overlap_and_cover_the_track() -> None:
    centres = long_track(200)
    views = views_of(pinhole_cameras(centres, centres + np.array([0.0, 5.0, 0.0])))
    windows = list(windows_along(Direction(0.0, 0.0, 1.0), views, CONFIG))
    length = CONFIG.spacings * 2.0
    assert all(2 * window.half == pytest.approx(length) for window in windows)
    middles = np.array([window.origin[0] for window in windows])
    assert (np.diff(middles) <= (1 - CONFIG.overlap) * length + 1e-9).all() and len(windows) > 8
    assert middles[0] - length / 2 <= 0.0 and middles[-1] + length / 2 >= centres[-1, 0]
    more = round(CONFIG.follow * CONFIG.planes)
    assert [window.follow for window in windows] == [
        (more, 0), *[(0, 0)] * (len(windows) - 2), (0, more)
    ]  # fmt: skip
    for window in windows:  # cost per window does not grow with the line
        assert 10 < len(window.views) <= 3 * CONFIG.spacings + 2
        near = np.abs(centres[:, 0] - window.origin[0]) <= (0.5 + CONFIG.near) * length
        assert near[window.views].all() and len(window.views) < near.sum()  # the others show too little of it
        low, high = (
            window.half * window.low[1] + window.origin[2],
            window.half * window.high[1] + window.origin[2],
        )
        assert low == pytest.approx(10.0 - CONFIG.below * length)
        assert high == pytest.approx(10.0 + CONFIG.above * length)


def test_windows_that_no_view_shows_are_left_out() -> None:
    """Half of a long flight looks at the sky."""
    centres = long_track(200)
    targets = centres + np.where(np.arange(200)[:, None] < 100, [0.0, 5.0, 0.0], [0.0, 0.1, 5.0])
    views = views_of(pinhole_cameras(centres, targets))
    windows = list(windows_along(Direction(0.0, 0.0, 1.0), views, replace(CONFIG, above=0.01)))
    assert windows and all(len(window.views) for window in windows)
    assert max(window.origin[0] for window in windows) < centres[150, 0]


def test_a_flight_that_is_hardly_longer_than_a_window_is_one() -> None:
    for count, windows in ((33, 1), (60, 5)):
        centres = long_track(count)
        views = views_of(pinhole_cameras(centres, centres + np.array([0.0, 5.0, 0.0])))
        assert len(list(windows_along(Direction(0.0, 0.0, 1.0), views, CONFIG))) == windows


def test_a_film_is_searched_in_the_windows_of_photos_that_overlap() -> None:
    footprint = 2.0 / CONFIG.least_step
    lengths = []
    for step, direction in ((2.0, Direction(0.0, 0.0, 1.0)), (0.1, Direction(0.0, 0.0, 1.0, footprint))):
        x = np.arange(0.0, 160.0, step)
        centres = np.stack([x, np.full(len(x), -5.0), np.full(len(x), 10.0)], 1)
        views = views_of(pinhole_cameras(centres, centres + np.array([0.0, 5.0, 0.0])))
        lengths.append([2 * window.half for window in windows_along(direction, views, CONFIG)])
    assert lengths[1] == pytest.approx(lengths[0]) and len(lengths[0]) > 3


def test_planes_are_nearer_to_each_other_where_images_show_little_of_a_window() -> None:
    centres = long_track(33)
    views = views_of(pinhole_cameras(centres, centres + np.array([0.0, 5.0, 0.0])))
    (usual,) = windows_along(Direction(0.0, 0.0, 1.0, 20.0), views, CONFIG)
    (finer,) = windows_along(Direction(0.0, 0.0, 1.0, 5.0), views, CONFIG)
    assert usual.finer == 1.0 and 20.0 * usual.planes / (2 * usual.half) > CONFIG.shown
    assert 5.0 * finer.planes / (2 * finer.half) == pytest.approx(CONFIG.shown, rel=0.01)
    assert finer.planes == pytest.approx(finer.finer * usual.planes, abs=1)
    chains, much = ChainConfig(), ChainConfig().finer(2.0, 0.3)
    assert much.places == tuple(2 * count for count in chains.places)
    assert (much.least_length, much.spare) == (chains.least_length / 2, 0.3)


def test_views_that_show_little_of_a_window_are_used_where_none_shows_more() -> None:
    centres = long_track(200)
    views = views_of(pinhole_cameras(centres, centres + np.array([0.0, 5.0, 0.0])))
    narrow = views._replace(focal=4 * views.focal)
    most, few = (
        [
            len(window.views)
            for window in windows_along(Direction(0.0, 0.0, 1.0), narrow, replace(CONFIG, enough=count))
        ]
        for count in (CONFIG.enough, 10)
    )
    assert min(few) >= 10 and max(most) <= CONFIG.enough
    assert all(a > b for a, b in zip(most, few, strict=True))
    nothing = views._replace(focal=1e6 * views.focal)
    assert not list(windows_along(Direction(0.0, 0.0, 1.0), nothing, CONFIG))


def test_cameras_around_a_place_have_one_window_as_wide_as_their_orbit() -> None:
    angle = np.linspace(0, 2 * np.pi, 36, endpoint=False)
    centres = np.stack([20 * np.cos(angle), 20 * np.sin(angle), np.full(36, 15.0)], 1)
    views = views_of(pinhole_cameras(centres, np.zeros((36, 3))))
    (window,) = windows_along(Direction(0.4, 0.0, 1.0), views, CONFIG)
    assert window.half >= 20 and len(window.views) == 36


def test_a_climb_does_not_shorten_windows() -> None:
    flown = np.array([[2.0 * k, 0.1 * (-1) ** k, 20.0] for k in range(24)])
    climb = np.array([[24.0 + 0.2 * (-1) ** k, 8.0, 5.0 + 0.3 * k] for k in range(40)])
    across = np.array([[46.0, 3.0 * k, 20.0] for k in range(1, 9)])
    for centres in (flown, np.concatenate([flown, climb]), np.concatenate([flown, across, climb])):
        assert spacing_along(centres, np.array([1.0, 0.0])) == pytest.approx(2.0)
    assert spacing_along(climb * (0, 0, 1), np.array([1.0, 0.0])) == pytest.approx(0.3)


def test_pieces_of_one_wire_are_one_and_of_two_spans_two() -> None:
    whole = hanging(0.02, 0.1)
    shown = replace(whole.evidence, seen_m=((0.0, 2 * HALF),))
    known = replace(whole, covariance=np.diag([1e-6] * 6), evidence=shown)
    a, b = known.between(0.0, 1.2 * HALF), known.between(0.7 * HALF, 2 * HALF)
    (one,) = joined([[a], [b]], JoinConfig())
    assert one.base.length_m == pytest.approx(2 * HALF)
    s = np.linspace(0, 2 * HALF, 20)
    np.testing.assert_allclose(one.at(s), whole.at(s), atol=1e-9)
    assert one.worst_sigma() < a.worst_sigma() + b.worst_sigma()
    first, second = known.between(0.0, HALF), known.between(0.9 * HALF, 2 * HALF)
    assert len(joined([[first], [second]], JoinConfig())) == 2  # they overlap by the width of a support
    beside = replace(b, theta=b.theta + np.array([0.2, 0.2, 0, 0, 0, 0]))
    assert len(joined([[a], [beside]], JoinConfig())) == 2


def test_pieces_of_one_window_are_one_wire_only_where_no_view_could_tell_them_apart() -> None:
    whole = hanging(0.02, 0.1)
    known = replace(whole, covariance=np.diag([1e-6] * 6))
    a, b = known.between(0.0, 1.2 * HALF), known.between(HALF, 2 * HALF)
    (one,) = joined([[a, b]], JoinConfig())
    assert one.base.length_m == pytest.approx(2 * HALF)
    s = np.linspace(0, 2 * HALF, 20)
    np.testing.assert_allclose(one.at(s), whole.at(s), atol=1e-9)
    reach_m = whole.evidence.reach_m
    assert reach_m is not None
    vague = np.diag([reach_m**2] * 6)
    twin = replace(b, theta=b.theta + 0.3 * reach_m * np.array([0, 0, 1, 1, 0, 0]), covariance=vague)
    kinked = replace(b, theta=b.theta + 0.5 * reach_m * np.array([0, 0, 0, 1, 0, 0]))
    assert len(joined([[a, replace(kinked, covariance=vague)]], JoinConfig())) == 1
    apart = known.between(1.3 * HALF, 2 * HALF)
    angle, end = math.radians(30), a.base.b - 0.02 * HALF * a.base.u
    bent = replace(a, base=Base(end, end + HALF * np.array([math.cos(angle), math.sin(angle)])))
    for other in (twin, kinked, apart, bent):
        assert joined([[a, other]], JoinConfig()) == [a, other]


def test_a_piece_beyond_a_wires_end_is_more_of_it_if_it_lies_on_its_known_curve() -> None:
    whole = hanging(0.02, 0.1)
    shown = replace(whole.evidence, seen_m=((0.0, 2 * HALF),))
    known = replace(whole, covariance=np.diag([1e-6] * 6), evidence=shown)
    a, beyond = known.between(0.0, 1.3 * HALF), known.between(1.4 * HALF, 2 * HALF)
    other = replace(a, theta=a.theta + np.array([0.2, 0.2, 0, 0, 0, 0]))
    first, second = with_onward([other, a], [beyond])
    assert first is other and second.base.length_m == pytest.approx(2 * HALF)
    s = np.linspace(0, 2 * HALF, 20)
    np.testing.assert_allclose(second.at(s), whole.at(s), atol=1e-9)
    reach_m = whole.evidence.reach_m
    assert reach_m is not None
    kinked = replace(beyond, theta=beyond.theta + 1.1 * reach_m * np.eye(6)[3])
    vague = replace(a, covariance=np.diag([(0.2 * reach_m) ** 2] * 6))
    assert vague.sigma_at(np.array([2 * HALF])).max() > reach_m / 2
    for wire, piece in ((a, kinked), (vague, beyond), (uncertain(a), beyond)):
        assert with_onward([wire], [piece]) == [wire, piece]
    assert with_onward([], [beyond]) == [beyond] and with_onward([a], []) == [a]
