"""Wires drawn into small pictures are found where they are: each once, and nothing besides."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from tests.support.drawn import (
    FOCAL,
    HALF,
    at_x,
    draw,
    hanging,
    pinhole_cameras,
    polyline,
    resized,
    scene_of,
    two_passes,
)

from plnerf.detect import in_window
from plnerf.detect.candidate import Candidate
from plnerf.detect.claims import Claims, pixels_along
from plnerf.detect.config import DetectConfig, SearchConfig
from plnerf.detect.config_lines import DirectionConfig
from plnerf.detect.detect import detect_wires
from plnerf.detect.evidence import line_evidence
from plnerf.detect.line_ridges import LineRidges, joined_ridges, steps_of
from plnerf.detect.odds import odds_of
from plnerf.detect.parabola import curve_odds
from plnerf.detect.refit import likeliest, refit
from plnerf.detect.refit_sums import aside
from plnerf.detect.search import Search
from plnerf.detect.to_wire import usual_sigma
from plnerf.detect.views import project_point, views_of
from plnerf.line.ends import Open
from plnerf.line.frame import LineFrame
from plnerf.line.wire import Wire
from plnerf.scene.cameras import Cameras
from plnerf.scene.photos import Pictures
from plnerf.scene.scene import Scene
from plnerf.scene.transforms import Frames

TRUE = (hanging(-0.08, 0.05), hanging(0.06, 0.02, 0.03), hanging(0.0, 0.1, 0.05, askew=0.01, climb=0.02))
DEFAULT = DetectConfig()
X = np.array([1.0, 0.0, 0.0])
"""The direction of all wires that are drawn, but for their sag."""
PIXEL = 0.45 / FOCAL
"""Width of a pixel at the distance of the passes."""
CLOSE = 1.5 * PIXEL
"""Within this of a wire, everywhere: its swing, which may be as much as wind makes it, is the least sure."""


def drawn(
    folder: Path, cameras: Cameras, wires: tuple[Wire, ...] = TRUE, seed: int = 0, colour: int = 30
) -> Scene:
    pictures = draw(cameras, [polyline(wire) for wire in wires], seed=seed, colour=colour)
    return scene_of(folder, cameras, pictures)


def apart(a: Wire, b: Wire) -> float:
    """The largest distance between two wires over the middle 0.9 of the span."""
    return float(max(off(line, other) for line, other in ((a, b), (b, a))))


def off(a: Wire, b: Wire, low: float = -0.9 * HALF, high: float = 0.9 * HALF) -> float:
    """The largest distance of a wire from another one between two places x, whatever their bases are."""
    points = polyline(a, 100)
    there = b.base.local(points[(points[:, 0] >= low) & (points[:, 0] <= high)])
    return float(np.linalg.norm(there[:, 1:] - b.at(there[:, 0]), axis=1).max())


def theta_of(wire: Wire, x: np.ndarray) -> np.ndarray:
    """(y_A, y_B, z_A, z_B, b, d) of an upright wire between the first and the last plane."""
    first, middle, last = at_x(wire, np.array([x[0], (x[0] + x[-1]) / 2, x[-1]]))
    return np.array([first[1], last[1], first[2], last[2], (first[2] + last[2]) / 2 - middle[2], 0.0])


def extent(wire: Wire) -> tuple[float, float]:
    """First and last x."""
    first, last = sorted(polyline(wire, 2)[:, 0].tolist())
    return first, last


def sigma(wire: Wire) -> float:
    """Standard deviation across, at the least certain place."""
    return wire.worst_sigma()


def as_known(wire: Wire) -> float:
    """Three standard deviations.  The first of the wires lies 3 px beside the second in four views, in which
    the ridges of both seldom stand apart: what they show of it near its end is a pixel off."""
    return 3 * sigma(wire)


@pytest.fixture(scope="module")
def three(tmp_path_factory: pytest.TempPathFactory) -> tuple[Scene, tuple[Wire, ...]]:
    scene = drawn(tmp_path_factory.mktemp("three"), two_passes(8))
    return scene, detect_wires(scene, DEFAULT)


def assert_each_once(
    found: tuple[Wire, ...], true: tuple[Wire, ...] = TRUE, close: float = CLOSE
) -> None:
    distance = np.array([[apart(one, wire) for wire in true] for one in found])
    assert len(found) == len(true)
    assert sorted(distance.argmin(1)) == list(range(len(true)))
    assert (distance.min(1) < np.maximum(close, [as_known(one) for one in found])).all()
    for one in found:
        low, high = extent(one)
        assert one.evidence.certain and low < -0.9 * HALF and high > 0.9 * HALF


def test_each_wire_is_found_once_and_nothing_else(three: tuple[Scene, tuple[Wire, ...]]) -> None:
    assert_each_once(three[1])


def test_a_wire_is_within_its_reach_and_some_sigmas(three: tuple[Scene, tuple[Wire, ...]]) -> None:
    for one in three[1]:
        error = min(apart(one, wire) for wire in TRUE)
        assert one.evidence.reach_m is not None
        assert error < one.evidence.reach_m and error < 4 * sigma(one)
        assert sigma(one) < 2 * PIXEL  # twelve views fix it well


def test_a_wire_says_what_it_rests_on(three: tuple[Scene, tuple[Wire, ...]]) -> None:
    scene, found = three
    assert [one.id for one in found] == [1, 2, 3]
    for one in found:
        assert all(isinstance(end, Open) and "not searched beyond" in end.reason for end in one.ends)
        assert one.sag is None and one.kind == "unknown"
        assert one.swing_deg is not None and abs(one.swing_deg.value) < 2 * one.swing_deg.sigma  # no wind
        evidence = one.evidence
        assert evidence.source == f"{evidence.count} images" and 6 < evidence.count <= len(scene.train)
        assert evidence.seen_m is not None
        ((low, high),) = evidence.seen_m
        length = one.base.length_m
        assert 0 <= low < high <= length * (1 + 1e-12)
        assert evidence.coverage == pytest.approx((high - low) / length) and evidence.coverage > 0.8
        assert evidence.longest_gap_m == pytest.approx(max(low, length - high))


@pytest.mark.slow
def test_a_frame_of_another_unit_changes_units_alone(three: tuple[Scene, tuple[Wire, ...]]) -> None:
    """The same pictures and poses in a scene of which nothing is known but that a unit is 25 m."""
    scene, found = three
    frames = replace(scene.frames, scale=0.04)
    again = detect_wires(replace(scene, frames=frames), DEFAULT)
    unit = LineFrame.of_scene(frames).from_scene(np.ones(1))[0]
    assert unit == pytest.approx(25.0)
    for one, other in zip(found, again, strict=True):
        wanted = resized(one, unit)
        for name in ("theta", "covariance"):
            np.testing.assert_allclose(getattr(other, name), getattr(wanted, name), rtol=1e-9, atol=1e-15)
        assert extent(other) == pytest.approx(extent(wanted))
        assert other.evidence.reach_m == pytest.approx(wanted.evidence.reach_m)
        assert other.evidence.certain == one.evidence.certain


@pytest.mark.slow
def test_the_same_pictures_give_the_same_wires_and_progress_counts_up_to_its_total(
    three: tuple[Scene, tuple[Wire, ...]],
) -> None:
    scene, found = three
    steps: list[tuple[int, int]] = []
    again = detect_wires(scene, DEFAULT, lambda *step: steps.append(step))
    assert same(again, found)
    done, totals = zip(*steps, strict=True)
    assert list(done) == sorted(set(done)) and set(totals) == {done[-1]}
    # Most of the time goes into few steps, none of which may seem to be the whole.
    assert len(done) > len(scene.train) and max(np.diff([0, *done])) < 0.3 * done[-1]


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_noise_and_bright_wires_change_nothing(tmp_path: Path, seed: int) -> None:
    """Eight views of each side fix one wire in nine no better than to three pixels, at an end and in depth;
    so do its deviations say."""
    found = detect_wires(drawn(tmp_path, two_passes(8), seed=seed, colour=250), DEFAULT)
    assert_each_once(found, close=3 * PIXEL)
    errors = [(min(apart(one, wire) for wire in TRUE), sigma(one)) for one in found]
    assert all(error < 4 * own for error, own in errors)
    assert np.median([error for error, _ in errors]) < CLOSE


def same(some: tuple[Wire, ...], others: tuple[Wire, ...]) -> bool:
    """To the bit."""
    return [one.theta.tolist() + one.covariance.tolist() for one in some] == [
        one.theta.tolist() + one.covariance.tolist() for one in others
    ]


def test_the_order_of_the_pictures_does_not_count(
    three: tuple[Scene, tuple[Wire, ...]], tmp_path: Path
) -> None:
    scene, found = three
    order = np.random.default_rng(0).permutation(len(scene.names)).tolist()
    pictures = [scene.images.image(i) for i in order]
    again = detect_wires(scene_of(tmp_path, scene.cameras[order], pictures), DEFAULT)
    assert len(again) == len(found)
    for one, other in zip(found, again, strict=True):
        assert apart(one, other) < 0.02 * PIXEL and extent(one) == pytest.approx(extent(other), rel=1e-12)
        assert sigma(other) == pytest.approx(sigma(one), rel=0.02)


def test_a_better_line_that_is_not_wanted_hides_no_other(three: tuple[Scene, tuple[Wire, ...]]) -> None:
    scene, _ = three
    views, x = views_of(scene.cameras[list(scene.train)]), np.linspace(-0.98 * HALF, 0.98 * HALF, 48)
    ridges = joined_ridges(line_evidence(scene.images, scene.cameras, scene.train, X, DEFAULT.evidence))
    search = Search(views, ridges, x, DEFAULT)
    curves = np.array([theta_of(wire, x) for wire in TRUE])
    best, tried = search.best(curves, 100.0)
    assert best is not None and tried == 1

    def another(line: Candidate) -> bool:
        return float(np.abs(line.theta - best.theta).max()) > 10 * PIXEL

    other, tried = search.best(curves, 100.0, another)
    assert other is not None and another(other) and other.odds > 100.0 and tried == 2
    assert search.best(curves, 100.0, lambda line: False) == (None, len(curves))


@pytest.mark.parametrize("azimuth_deg", [23.0, 151.0])
def test_a_line_of_any_azimuth_is_found(three: tuple[Scene, tuple[Wire, ...]], azimuth_deg: float) -> None:
    """The same pictures in a scene that is turned about its z axis."""
    scene, _ = three
    turn = Frames(turned(azimuth_deg), 1.0, np.zeros(3), "m", None, "file")
    R, centre = (scene.cameras.R_scene_camera.double().numpy(), scene.cameras.centre.double().numpy())
    cameras = replace(
        scene.cameras,
        R_scene_camera=torch.from_numpy(turn.R_scene_world @ R).float(),
        centre=torch.from_numpy(turn.to_scene(centre)).float(),
    )
    again = detect_wires(replace(scene, cameras=cameras), DEFAULT)
    assert len(again) == len(TRUE)
    back = [turn.to_world(polyline(one, 4000)) for one in again]
    for wire in TRUE:
        middle = polyline(wire)[20:-20]
        apart = [np.linalg.norm(middle[:, None] - line[None], axis=2).min(1).max() for line in back]
        assert min(apart) < max(CLOSE, as_known(again[int(np.argmin(apart))]))


@pytest.mark.slow
def test_two_lines_that_cross_are_both_found(tmp_path: Path) -> None:
    """The second runs above the first, across it, and is filmed by the same passes.  They go on beyond."""
    R = turned(70.0)
    first, second = TRUE[:2], [hanging(y, 0.16) for y in (-0.05, 0.05)]

    def whole(wire: Wire) -> np.ndarray:
        return wire.points(np.linspace(-1, 2, 1200) * wire.base.length_m)

    centres = np.array([
        [*(0.9 * np.array([np.cos(a), np.sin(a)])), 0.1 + 0.12 * np.sin(3 * a)]
        for a in np.linspace(0, 2 * np.pi, 24, endpoint=False)
    ])
    cameras = pinhole_cameras(centres, np.tile([0.0, 0.0, 0.05], (24, 1)))
    pictures = draw(cameras, [*map(whole, first), *(whole(wire) @ R for wire in second)])
    found = detect_wires(scene_of(tmp_path, cameras, pictures), DEFAULT)
    certain = [polyline(wire) for wire in found if wire.evidence.certain]
    for line in [*map(polyline, first), *(polyline(wire) @ R for wire in second)]:
        middle = line[120:280]
        apart = [np.linalg.norm(middle[:, None] - one[None], axis=2).min(1).mean() for one in certain]
        assert min(apart) < 2 * PIXEL
    assert len(certain) == 4


@pytest.mark.slow
@pytest.mark.parametrize("turn_deg", [0.0, 30.0])
def test_an_azimuth_that_is_known_is_the_only_one_searched(
    three: tuple[Scene, tuple[Wire, ...]], turn_deg: float
) -> None:
    """Clockwise from the world's y.  The wires run along the scene's x, which the world has `turn_deg` from
    its own x towards its y."""
    frames = replace(three[0].frames, R_scene_world=turned(turn_deg).T)
    scene = replace(three[0], frames=frames)
    known = [
        replace(DEFAULT, directions=DirectionConfig(azimuth_deg=deg)) for deg in (93.0 - turn_deg, -turn_deg)
    ]
    assert_each_once(detect_wires(scene, known[0]))
    assert detect_wires(scene, known[1]) == ()


def turned(azimuth_deg: float) -> np.ndarray:
    """Rotation about z."""
    c, s = np.cos(np.radians(azimuth_deg)), np.sin(np.radians(azimuth_deg))
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


@pytest.mark.slow
def test_wires_that_wind_swings_are_found_and_say_how_far(tmp_path: Path) -> None:
    """Of 90 wires of 30 such scenes swings are 1.4 deviations off (root mean square), the worst 2.9."""
    turn = np.radians(12.0)
    swung = tuple(replace(wire, theta=np.append(wire.theta[:5], turn)) for wire in TRUE)
    found = detect_wires(drawn(tmp_path, two_passes(16), swung), DEFAULT)
    apart_from = np.array([[apart(one, wire) for wire in swung] for one in found])
    assert sorted(apart_from.argmin(1)) == [0, 1, 2]
    for one, error in zip(found, apart_from.min(1), strict=True):
        assert one.evidence.certain and one.evidence.reach_m is not None and error < one.evidence.reach_m
        # To the left of a base that may run either way.
        assert abs(abs(one.swing_rad) - turn) < 3 * one.covariance[5, 5] ** 0.5


@pytest.mark.parametrize("spread", [0.05, 0.4])
def test_how_far_poses_move_ridges_is_learnt_from_the_views(spread: float) -> None:
    rng, rows, views = np.random.default_rng(3), 30, 60
    Z = np.stack([np.ones(rows), np.linspace(-1, 1, rows)], 1)
    effects = spread * rng.normal(size=(views, 2))
    residuals = effects @ Z.T + 0.3 * rng.normal(size=(views, rows))
    information = np.repeat((Z.T @ Z / 0.3**2)[None], views, 0)
    assert likeliest(information, residuals @ Z / 0.3**2, DEFAULT.refit.view_px) == spread


def test_looking_from_aside_is_counted_in_deviations_of_the_views_of_one_place() -> None:
    """Not from place to place: along a straight track past a wire askew, each place is seen from one side."""
    rows = np.zeros((60, 6))
    rows[:, 0] = np.repeat(np.arange(15), 4)
    own = np.radians(np.repeat(np.linspace(-40, 40, 15), 4))
    for spread in (0.02, 0.2):
        angle = own + np.tile([-spread, spread], 30)
        rows[:, 3:5] = 7.0 * np.stack([np.cos(angle), np.sin(angle)], 1)
        found = aside(rows, 15) * np.sin(spread) / np.sin(np.tile([-spread, spread], 30))
        assert found == pytest.approx(found[0] * np.ones(60)) and abs(found[0]) == pytest.approx(1)
    rows[:, 3:5] = [3.0, 4.0]  # all from one place
    assert np.abs(aside(rows, 15)).max() < 1e-9


@pytest.mark.parametrize("wobble", [0.1, 0.03])
def test_light_from_one_side_costs_certainty_as_views_look_from_one_side(
    tmp_path: Path, wobble: float
) -> None:
    """By up to what it moves ridges by, over the spread of the directions."""
    wire, x = TRUE[0], np.linspace(-HALF, HALF, 96)
    one_pass = two_passes(8, wobble=wobble)[list(range(8))]
    scene = drawn(tmp_path, one_pass, (wire,))
    values = joined_ridges(line_evidence(scene.images, scene.cameras, scene.train, X, DEFAULT.evidence))
    fits = [
        refit(views_of(scene.cameras), values, theta_of(wire, x), x, DEFAULT.odds.min_response, config)
        for config in (DEFAULT.refit, replace(DEFAULT.refit, bias_px=1e-6))
    ]
    assert fits[0] is not None and fits[1] is not None
    light, dark = (usual_sigma(fit.covariance) for fit in fits)
    spread = one_pass.centre[:, 2].std().item() / 0.45
    most = DEFAULT.refit.bias_px * PIXEL / spread
    assert 0.4 * most < (light**2 - dark**2) ** 0.5 < most


@pytest.mark.slow
def test_a_wire_whose_ridges_lie_beside_it_is_found_beside_sharper_ones(
    three: tuple[Scene, tuple[Wire, ...]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """As those of a wire next to the camera do, which is many pixels wide."""
    scene, _ = three
    views, exact = views_of(scene.cameras[list(scene.train)]), in_window.line_evidence
    rng = np.random.default_rng(0)
    points = LineFrame.of_scene(scene.frames).to_scene(polyline(TRUE[0], 4000))

    def scattered(photos: Pictures, cameras: Cameras, images: Sequence[int], *rest: Any) -> list[LineRidges]:
        maps = exact(photos, cameras, images, *rest)
        for image, ridges in zip(images, maps, strict=True):
            view = scene.train.index(image)
            picture, tangent = (one.reshape(views.sizes[view][::-1]) for one in ridges)
            seen = np.array([project_point(views, view, *point) for point in points])
            columns, rows = seen[seen[:, 2] > 0, :2].astype(int).T
            bend = np.polyfit(columns, rows, 2)
            for column, row in zip(columns, rows, strict=True):
                picture[max(0, row - 3) : row + 4, column] = 0
            for column in np.unique(columns):
                row = int(np.median(rows[columns == column])) + int(rng.choice((-1, 1)))
                row = int(np.clip(row, 0, len(picture) - 1))
                slope = np.polyval(np.polyder(bend), column)
                picture[row, column], tangent[row, column] = 1, steps_of(np.array([np.arctan(slope)]))[0]
        return maps

    monkeypatch.setattr(in_window, "line_evidence", scattered)
    assert_each_once(detect_wires(scene, DEFAULT))


def test_without_wires_none_is_found(tmp_path: Path) -> None:
    cameras = two_passes(8)
    assert detect_wires(drawn(tmp_path, cameras, ()), DEFAULT) == ()
    rng = np.random.default_rng(4)
    noise = [rng.integers(0, 256, (180, 240, 3), dtype=np.uint8) for _ in range(len(cameras))]
    assert detect_wires(scene_of(tmp_path / "noise", cameras, noise), DEFAULT) == ()


def test_lines_across_the_span_are_none(tmp_path: Path) -> None:
    cameras = two_passes(8)
    across = [
        np.array([[x, y, 0.02] for y in np.linspace(-0.3, 0.3, 200)]) for x in (-0.5, 0.1, 0.6)
    ]  # fmt: skip
    upright = [
        np.array([[x, y, z] for z in np.linspace(-0.1, 0.13, 50)]) for x, y in ((-0.3, 0.05), (0.4, -0.1))
    ]
    assert detect_wires(scene_of(tmp_path, cameras, draw(cameras, across + upright)), DEFAULT) == ()


def test_along_a_straight_track_no_place_is_certain(tmp_path: Path) -> None:
    """All its views of a wire lie in one plane: nothing fixes where in that plane it is, nor which way it
    runs."""
    known = replace(DEFAULT, directions=DirectionConfig(azimuth_deg=90.0))
    for wobble in (0.0, 0.004):
        cameras = two_passes(8, wobble=wobble)
        scene = drawn(tmp_path / f"one-{wobble}", cameras[list(range(8))], TRUE[:1])
        for config in (DEFAULT, known):
            assert not any(wire.evidence.certain for wire in detect_wires(scene, config))
        assert_each_once(detect_wires(drawn(tmp_path / f"both-{wobble}", cameras, TRUE[:1])), TRUE[:1])


def test_a_wire_that_ends_is_not_drawn_out(tmp_path: Path) -> None:
    half = TRUE[0].between(0.0, HALF + 0.1)
    (found,) = detect_wires(drawn(tmp_path, two_passes(8), (half,)), DEFAULT)
    low, high = extent(found)
    assert low < -0.9 * HALF and abs(high - 0.1) < 0.1
    assert off(half, found, -0.8, 0.05) < PIXEL


@pytest.mark.slow
@pytest.mark.parametrize(
    "pair", [(hanging(0.0, 0.08), hanging(0.0, 0.0)), (hanging(-0.06, 0.05), hanging(0.06, 0.05))]
)
def test_a_pair_is_two_above_or_beside_each_other(tmp_path: Path, pair: tuple[Wire, ...]) -> None:
    assert_each_once(detect_wires(drawn(tmp_path, two_passes(8), pair), DEFAULT), pair)


def test_at_most_as_many_in_a_window_as_told(three: tuple[Scene, tuple[Wire, ...]]) -> None:
    few = replace(DEFAULT, search=SearchConfig(max_lines=2), directions=DirectionConfig(most=1))
    assert len(detect_wires(three[0], few)) == 2


# -- the parts


@pytest.mark.parametrize("wire", TRUE)
def test_a_fit_finds_the_curve_from_beside_it_and_masked_ridges_count_no_more(
    tmp_path: Path, wire: Wire
) -> None:
    scene = drawn(tmp_path, two_passes(8), (wire,))
    views = views_of(scene.cameras)
    values = joined_ridges(line_evidence(scene.images, scene.cameras, scene.train, X, DEFAULT.evidence))
    x, fine = np.linspace(-HALF, HALF, 96), np.linspace(-HALF, HALF, 4000)
    theta, least = theta_of(wire, x), DEFAULT.odds.min_response
    fit = refit(views, values, theta + 2 * PIXEL * np.array([1, -1, 1, 1, 0.5, 0.3]), x, least, DEFAULT.refit)
    assert fit is not None and np.abs(fit.theta - theta).max() < 1.5 * PIXEL and fit.rms_px < 1
    assert (np.linalg.eigvalsh(fit.covariance) > 0).all() and fit.images == len(scene.train)
    across = LineRidges(values.response, values.tangent + np.uint8(20))  # 14 degrees
    assert refit(views, across, theta, x, least, DEFAULT.refit) is None
    odds = odds_of(values.response, views, DEFAULT.odds)
    total, seen = curve_odds(views, odds, theta[None], x, 0.0)[0].T
    assert total.sum() > 0.5 * seen.sum()  # nats for each view and plane
    claims = Claims(views, values.response, odds, DEFAULT.odds)
    claims.take(pixels_along(views, theta, fine, 4))
    claims.update()
    masks, left = claims.masks, claims.odds
    beside = theta + 0.5 * PIXEL * np.array([1, 1, 1, 1, 0, 0])
    for one in (theta, beside):  # neither for it nor against
        assert np.abs(curve_odds(views, left, one[None], x, 0.0)[0, :, 0]).max() == 0
    on = [(n, project_point(views, n, *point)) for point in polyline(wire, 1000) for n in range(len(views.R))]
    near = np.zeros(len(values.response), bool)
    for n, (u, v, depth) in on:
        if depth > 0:
            picture = near[views.starts[n] : views.starts[n] + 240 * 180].reshape(180, 240)
            picture[max(0, int(v) - 6) : int(v) + 7, max(0, int(u) - 6) : int(u) + 7] = True
    assert masks.max() == 1 and not masks[~near].any()  # nothing else


def test_nothing_to_see_is_no_fit() -> None:
    cameras = two_passes(4)
    views = views_of(cameras)
    x = np.linspace(-HALF, HALF, 96)
    pixels = int(cameras.size_px.prod(1).sum())
    dark = LineRidges(np.zeros(pixels, np.float32), np.zeros(pixels, np.uint8))
    assert refit(views, dark, theta_of(TRUE[0], x), x, 0.25, DEFAULT.refit) is None


def test_the_kernels_see_what_the_cameras_see() -> None:
    """`project_point` against `project`, with a lens; -1 exactly for what is behind or beside the picture."""
    from plnerf.scene.cameras import project

    plain = two_passes(3)
    lens = torch.tensor([-0.05, 0.02, 0.001, -0.002, 0.003])
    cameras = Cameras(
        plain.R_scene_camera, plain.centre, plain.focal_px, plain.principal_px,
        lens.repeat(len(plain), 1), plain.size_px,
    )  # fmt: skip
    views = views_of(cameras)
    points = np.random.default_rng(0).uniform(-1, 1, (300, 3))
    pixels, depths = project(cameras, torch.from_numpy(points).float())
    seen = 0
    for n in range(len(cameras)):
        for p, point in enumerate(points):
            u, v, depth = project_point(views, n, *point)
            at, ahead = pixels[n, p].numpy(), float(depths[n, p])
            plane = (np.linalg.norm(points[p] - views.centre[n]) ** 2 - ahead**2) ** 0.5 / abs(ahead)
            if depth > 0:
                seen += 1
                assert depth == pytest.approx(ahead, abs=1e-5)
                np.testing.assert_allclose([u, v], at, atol=0.01)
                assert 0 <= u < 240 and 0 <= v < 180
            elif ahead > 0.01 and plane < 2:
                assert not ((at > 0.01).all() and (at < [239.99, 179.99]).all())
    assert seen > 100


@pytest.mark.slow
def test_a_line_that_does_not_hang_is_no_conductor(tmp_path: Path) -> None:
    """The edge of a road runs along the span, but straight."""
    straight = hanging(0.05, -0.06, 0.0)
    scene = drawn(tmp_path, two_passes(8), (straight, TRUE[0]))
    assert_each_once(detect_wires(scene, DEFAULT), TRUE[:1])


def test_twins_a_few_pixels_apart_are_two(tmp_path: Path) -> None:
    pair = (hanging(0.0, 0.062), hanging(0.0, 0.038))
    # Above each other: the passes look across.
    assert np.abs(pair[0].theta[2] - pair[1].theta[2]) < 8.1 * PIXEL
    assert_each_once(detect_wires(drawn(tmp_path, two_passes(6), pair), DEFAULT), pair)
