"""Wires drawn into small pictures are found where they are: each once, and nothing besides."""

from pathlib import Path

import numpy as np
import pytest
from tests.support.drawn import (
    BOX,
    FOCAL,
    HALF,
    draw,
    hanging,
    pinhole_cameras,
    polyline,
    scene_of,
    two_passes,
)

from plnerf.detect.curves import Curve
from plnerf.detect.detect import PLANES, FindConfig, find_curves, search_box
from plnerf.detect.evidence import line_evidence
from plnerf.detect.narrow import curve_odds
from plnerf.detect.odds import odds_of, without
from plnerf.detect.refit import claim, refit
from plnerf.detect.search import Line, Search
from plnerf.detect.views import look_at, views_of
from plnerf.scene.cameras import Cameras
from plnerf.scene.scene import Scene

TRUE = (hanging(-0.08, 0.05), hanging(0.06, 0.02, 0.03), hanging(0.0, 0.1, 0.05, askew=0.01, climb=0.02))
COARSE = FindConfig(cell=0.008)
PIXEL = 0.45 / FOCAL
"""Width of a pixel at the distance of the passes."""


def drawn(
    folder: Path, cameras: Cameras, curves: tuple[Curve, ...] = TRUE, seed: int = 0, colour: int = 30
) -> Scene:
    pictures = draw(cameras, [polyline(curve) for curve in curves], seed=seed, colour=colour)
    return scene_of(folder, cameras, pictures)


def apart(a: Curve, b: Curve) -> float:
    """The largest distance between two curves over the middle 0.9 of the span."""
    x = np.linspace(-0.9 * HALF, 0.9 * HALF, 40)
    return float(np.linalg.norm(a.points(x) - b.points(x), axis=1).max())


def fit_of(curve: Curve, x: np.ndarray) -> np.ndarray:
    """The letters (y0, y1, z0, z1, b) of a curve between the first and the last plane."""
    first, middle, last = curve.points(np.array([x[0], (x[0] + x[-1]) / 2, x[-1]]))
    return np.array([first[1], last[1], first[2], last[2], (first[2] + last[2]) / 2 - middle[2]])


@pytest.fixture(scope="module")
def three(tmp_path_factory: pytest.TempPathFactory) -> tuple[Scene, tuple[Curve, ...]]:
    scene = drawn(tmp_path_factory.mktemp("three"), two_passes(6))
    return scene, find_curves(scene, COARSE)


def assert_each_once(found: tuple[Curve, ...], true: tuple[Curve, ...] = TRUE) -> None:
    distance = np.array([[apart(one, curve) for curve in true] for one in found])
    assert len(found) == len(true)
    assert sorted(distance.argmin(1)) == list(range(len(true)))
    assert distance.min(1).max() < PIXEL
    for one in found:
        assert one.certain and one.ends[0] < -0.9 * HALF and one.ends[1] > 0.9 * HALF


def test_each_wire_is_found_once_and_nothing_else(three: tuple[Scene, tuple[Curve, ...]]) -> None:
    assert_each_once(three[1])


def test_a_wire_is_within_its_reach_and_some_sigmas(three: tuple[Scene, tuple[Curve, ...]]) -> None:
    for one in three[1]:
        error = min(apart(one, curve) for curve in TRUE)
        assert error < one.reach and error < 4 * one.sigma
        assert one.sigma < 2 * PIXEL  # twelve views fix it well


@pytest.mark.parametrize("seed", [1, 2])
def test_noise_and_bright_wires_change_nothing(tmp_path: Path, seed: int) -> None:
    assert_each_once(find_curves(drawn(tmp_path, two_passes(6), seed=seed, colour=250), COARSE))


def test_the_same_pictures_give_the_same_curves(three: tuple[Scene, tuple[Curve, ...]]) -> None:
    scene, found = three
    assert find_curves(scene, COARSE) == found


def test_the_order_of_the_pictures_does_not_count(
    three: tuple[Scene, tuple[Curve, ...]], tmp_path: Path
) -> None:
    scene, found = three
    order = np.random.default_rng(0).permutation(len(scene.names)).tolist()
    pictures = [scene.images.image(i) for i in order]
    again = find_curves(scene_of(tmp_path, scene.cameras[order], pictures), COARSE)
    assert len(again) == len(found)
    for one, other in zip(found, again, strict=True):
        assert apart(one, other) < 0.02 * PIXEL and one.ends == other.ends
        assert other.sigma == pytest.approx(one.sigma, rel=0.02)


def test_a_better_line_that_is_not_wanted_hides_no_other(three: tuple[Scene, tuple[Curve, ...]]) -> None:
    scene, _ = three
    views, box = views_of(scene.cameras[list(scene.train)]), search_box(scene, COARSE.cell)
    x = np.linspace(box.x[0], box.x[-1], PLANES)
    search = Search(views, line_evidence(scene.images, scene.cameras, scene.train), x, COARSE.cell)
    curves = np.array([fit_of(curve, x) for curve in TRUE])
    best = search.best(curves, 100.0)
    assert best is not None

    def another(line: Line) -> bool:
        return float(np.abs(line.fit.q - best.fit.q).max()) > 10 * PIXEL

    other = search.best(curves, 100.0, another)
    assert other is not None and another(other) and other.odds > 100.0
    assert search.best(curves, 100.0, lambda line: False) is None


def test_without_wires_none_is_found(tmp_path: Path) -> None:
    cameras = two_passes(6)
    assert find_curves(drawn(tmp_path, cameras, ()), COARSE) == ()
    rng = np.random.default_rng(4)
    noise = [rng.integers(0, 256, (180, 240, 3), dtype=np.uint8) for _ in range(len(cameras))]
    assert find_curves(scene_of(tmp_path / "noise", cameras, noise), COARSE) == ()


def test_lines_across_the_span_are_none(tmp_path: Path) -> None:
    cameras = two_passes(6)
    across = [
        np.array([[x, y, 0.02] for y in np.linspace(-0.3, 0.3, 200)]) for x in (-0.5, 0.1, 0.6)
    ]  # fmt: skip
    upright = [
        np.array([[x, y, z] for z in np.linspace(-0.1, 0.13, 50)]) for x, y in ((-0.3, 0.05), (0.4, -0.1))
    ]
    assert find_curves(scene_of(tmp_path, cameras, draw(cameras, across + upright)), COARSE) == ()


def test_a_straight_track_along_the_wires_is_told_as_uncertain(tmp_path: Path) -> None:
    """All its views of a wire lie in one plane: nothing fixes where in that plane it is."""
    cameras = two_passes(8, wobble=0.0)[list(range(8))]
    one = find_curves(drawn(tmp_path / "one", cameras, TRUE[:1]), COARSE)
    assert len(one) >= 1 and not any(curve.certain for curve in one)
    assert all(curve.sigma > 3 * PIXEL for curve in one)
    both = find_curves(drawn(tmp_path / "both", two_passes(8), TRUE[:1]), COARSE)
    assert_each_once(both, TRUE[:1])
    assert both[0].sigma < 0.2 * min(curve.sigma for curve in one)


def test_a_wire_that_ends_is_not_drawn_out(tmp_path: Path) -> None:
    half = Curve(TRUE[0].y, TRUE[0].z, (-HALF, 0.1), 0.0, 0.02, True)
    (found,) = find_curves(drawn(tmp_path, two_passes(6), (half,)), COARSE)
    assert found.ends[0] < -0.9 * HALF and abs(found.ends[1] - 0.1) < 0.1
    x = np.linspace(-0.8, 0.05, 30)
    assert np.abs(found.points(x) - half.points(x)).max() < PIXEL


@pytest.mark.parametrize(
    "pair", [(hanging(0.0, 0.08), hanging(0.0, 0.0)), (hanging(-0.06, 0.05), hanging(0.06, 0.05))]
)
def test_a_pair_is_two_above_or_beside_each_other(tmp_path: Path, pair: tuple[Curve, ...]) -> None:
    assert_each_once(find_curves(drawn(tmp_path, two_passes(6), pair), COARSE), pair)


def test_at_most_as_many_as_told(three: tuple[Scene, tuple[Curve, ...]]) -> None:
    assert len(find_curves(three[0], FindConfig(cell=0.008, most=2))) == 2


# -- the parts


@pytest.mark.parametrize("curve", TRUE)
def test_a_fit_finds_the_curve_from_beside_it_and_claimed_ridges_count_no_more(
    tmp_path: Path, curve: Curve
) -> None:
    scene = drawn(tmp_path, two_passes(6), (curve,))
    views = views_of(scene.cameras)
    values = line_evidence(scene.images, scene.cameras, scene.train)
    x, fine = np.linspace(-HALF, HALF, 96), np.linspace(-HALF, HALF, 4000)
    q = fit_of(curve, x)
    fit = refit(views, values, q + 2 * PIXEL * np.array([1, -1, 1, 1, 0.5]), x)
    assert fit is not None and np.abs(fit.q - q).max() < 1.5 * PIXEL and fit.rms_px < 1
    assert (np.linalg.eigvalsh(fit.covariance) > 0).all()
    odds = odds_of(values, views)
    total, seen = curve_odds(views, odds, q[None], x, 0.0)[0].T
    assert total.sum() > 0.5 * seen.sum()  # nats for each view and plane
    claims = np.zeros(len(values), np.uint8)
    claim(views, q, fine, 4, claims)
    left = without(odds, values, claims > 0, views)
    beside = q + 0.5 * PIXEL * np.array([1, 1, 1, 1, 0])
    for one in (q, beside):  # neither for it nor against
        assert np.abs(curve_odds(views, left, one[None], x, 0.0)[0, :, 0]).max() == 0
    on = [
        (n, look_at(views, n, *point))
        for point in polyline(Curve(curve.y, curve.z, (-HALF, HALF), 0.0, 0.0, True), 1000)
        for n in range(len(views.R))
    ]
    near = np.zeros(len(values), bool)
    for n, (u, v, depth) in on:
        if depth > 0:
            picture = near[views.starts[n] : views.starts[n] + 240 * 180].reshape(180, 240)
            picture[max(0, int(v) - 6) : int(v) + 7, max(0, int(u) - 6) : int(u) + 7] = True
    assert claims.max() == 1 and not claims[~near].any()  # nothing else


def test_nothing_to_see_is_no_fit() -> None:
    cameras = two_passes(4)
    views = views_of(cameras)
    x = np.linspace(-HALF, HALF, 96)
    dark = np.zeros(int(cameras.size_px.prod(1).sum()))
    assert refit(views, dark, fit_of(TRUE[0], x), x) is None


def test_the_kernels_see_what_the_cameras_see() -> None:
    """`look_at` against `project`, with a lens; -1 exactly for what is behind or beside the picture."""
    import torch

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
            u, v, depth = look_at(views, n, *point)
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


def test_the_search_box_covers_the_span(tmp_path: Path) -> None:
    scene = drawn(tmp_path, pinhole_cameras(np.array([[0.0, -0.5, 0.0]]), np.zeros((1, 3))), ())
    for cell in (0.004, 0.03):
        box = search_box(scene, cell)
        assert len(box.x) == PLANES and (np.diff(box.x) > 0).all()
        assert BOX[0, 0] < box.x[0] and box.x[-1] < BOX[1, 0]
        assert box.low == (BOX[0, 1], BOX[0, 2])
        last = np.array(box.low) + cell * (np.array(box.shape) - 1)
        assert (last >= BOX[1, 1:] - 1e-9).all() and (last < BOX[1, 1:] + cell).all()


def test_a_line_that_does_not_hang_is_no_conductor(tmp_path: Path) -> None:
    """The edge of a road runs along the span, but straight."""
    straight = Curve((0.05, 0.0), (-0.06, 0.0, 0.0), (-HALF, HALF), 0.0, 0.0, True)
    scene = drawn(tmp_path, two_passes(6), (straight, TRUE[0]))
    assert_each_once(find_curves(scene, COARSE), TRUE[:1])


def test_twins_a_few_pixels_apart_are_two(tmp_path: Path) -> None:
    pair = (hanging(0.0, 0.062), hanging(0.0, 0.038))
    assert np.abs(pair[0].z[0] - pair[1].z[0]) < 8.1 * PIXEL  # above each other: the passes look across
    assert_each_once(find_curves(drawn(tmp_path, two_passes(6), pair), COARSE), pair)
