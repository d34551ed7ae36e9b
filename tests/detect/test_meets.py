"""Ridges of images become chains, and chains of two views meet in the wire that both show."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
import torch
from tests.support.drawn import HALF, at_x, hanging, pinhole_cameras, polyline, two_passes

from plnerf.detect.chains import Chains, chains_of
from plnerf.detect.config_lines import ChainConfig
from plnerf.detect.meets import curves_where_chains_meet, partners
from plnerf.detect.parabola import curve_points
from plnerf.detect.views import Views, project_point, seen_places, views_of
from plnerf.line.wire import Wire
from plnerf.scene.cameras import Cameras

CONFIG = ChainConfig()
LOW, HIGH = np.array([-0.3, -0.3]), np.array([0.3, 0.3])
X = np.linspace(-HALF, HALF, 25)
PIXEL = 0.45 / 150
LENS = torch.tensor([-0.05, 0.02, 0.001, -0.002, 0.003])


def with_lens(cameras: Cameras) -> Cameras:
    return replace(cameras, distortion=LENS.repeat(len(cameras), 1))


def ridges(views: Views, wires: tuple[Wire, ...]) -> np.ndarray:
    """Responses of 1 along the wires, a pixel wide."""
    out = np.zeros(int(views.sizes.prod(1).sum()), np.float32)
    for n, ((w, h), start) in enumerate(zip(views.sizes, views.starts, strict=True)):
        picture = out[start : start + w * h].reshape(h, w)
        for wire in wires:
            seen = [project_point(views, n, *point) for point in polyline(wire, 400)]
            at = np.array([(int(u), int(v)) for u, v, depth in seen if depth > 0])
            cv2.polylines(picture, [at.reshape(-1, 1, 2)], False, 1.0)
    return out


def chains_seen(views: Views, *wires: Wire) -> Chains:
    return chains_of(ridges(views, wires), views, 0.5, CONFIG)


@pytest.mark.parametrize("lens", [False, True])
def test_a_chain_runs_where_the_wire_is_seen(lens: bool) -> None:
    plain = two_passes(4)
    wire, views = hanging(0.0, 0.05, askew=0.02), views_of(with_lens(plain) if lens else plain)
    chains = chains_seen(views, wire)
    assert chains.owner.tolist() == list(range(8)) and chains.first.tolist() == list(range(9))
    without = views_of(plain)
    for n in range(8):
        u, v = chains.along[n]
        assert np.hypot(u, v) == pytest.approx(1.0)
        seen = [(point, project_point(views, n, *point)) for point in polyline(wire, 100)]
        for point, (_, _, depth) in seen:
            if depth <= 0:
                continue
            x, y = (views.R[n] @ (point - views.centre[n]))[:2] / depth
            t, across = x * u + y * v, y * u - x * v
            assert chains.ends[n, 0] - 0.02 < t < chains.ends[n, 1] + 0.02
            assert np.polynomial.Polynomial(chains.bend[n])(t) == pytest.approx(
                across, abs=1.5 / without.focal[n, 0]
            )


def test_short_ones_and_those_that_are_no_curve_are_left_out() -> None:
    views = views_of(two_passes(1))
    w, h = views.sizes[0]
    pictures = np.zeros((len(views.R), h, w), np.float32)
    pictures[0, 20, 10:30] = 1  # 20 px
    pictures[0, 40, 10:90] = 1
    pictures[0, 60:140, 50] = pictures[0, 100, 10:90] = 1  # a cross
    chains = chains_of(pictures.ravel(), views, 0.5, CONFIG)
    assert len(chains.owner) == 1 and chains.first.tolist() == [0, 1, 1]
    assert np.ptp(chains.ends[0]) * views.focal[0, 0] == pytest.approx(79)
    assert len(chains_of(pictures.ravel(), views, 0.5, replace(CONFIG, most=1)).owner) == 0
    none = chains_of(0 * pictures.ravel(), views, 0.5, CONFIG)
    assert len(none.owner) == 0 and none.first.tolist() == [0, 0, 0]
    assert len(curves_where_chains_meet(none, views, X, LOW, HIGH, CONFIG)) == 0


@pytest.mark.parametrize("lens", [False, True])
@pytest.mark.parametrize(
    "wire", [hanging(0.0, 0.05), hanging(0.06, 0.02, 0.03), hanging(0.0, 0.1, 0.05, askew=0.01, climb=0.1)]
)
def test_chains_of_one_wire_meet_in_it(wire: Wire, lens: bool) -> None:
    cameras = two_passes(4)
    views = views_of(with_lens(cameras) if lens else cameras)
    curves = curves_where_chains_meet(chains_seen(views, wire), views, X, LOW, HIGH, CONFIG)
    middle = np.array([curve_points(curve, 0.5) for curve in curves])
    true = at_x(wire, np.zeros(1))[0, 1:]
    assert len(curves) >= 6 and np.hypot(*(middle - true).T).min() < 0.5 * PIXEL
    s = np.linspace(0, 1, 7)
    there = at_x(wire, X[0] + s * (X[-1] - X[0]))[:, 1:].T
    assert min(np.hypot(*(curve_points(curve, s) - there)).max() for curve in curves) < 2 * PIXEL


def test_where_chains_meet_outside_the_volume_there_is_nothing() -> None:
    wire, views = hanging(0.0, 0.05), views_of(two_passes(4))
    chains = chains_seen(views, wire)
    assert len(curves_where_chains_meet(chains, views, X, LOW, np.array([0.3, -0.1]), CONFIG)) == 0
    steep = replace(CONFIG, max_sag=0.001)
    assert len(curves_where_chains_meet(chains, views, X, LOW, HIGH, steep)) == 0


def test_a_chain_that_clutter_cuts_short_meets_what_others_show() -> None:
    """Each of two chains is a half of the wire: they meet if they may be longer by as much again."""
    wire, views = hanging(0.0, 0.05), views_of(two_passes(1))
    chains = chains_seen(views, wire)
    assert chains.first.tolist() == [0, 1, 2]
    cut = np.zeros((2, 2))
    for n, shown in ((0, [-0.9 * HALF, -0.05 * HALF]), (1, [0.05 * HALF, 0.9 * HALF])):
        points = at_x(wire, np.array(shown))
        seen = (points - views.centre[n]) @ views.R[n].T
        cut[n] = np.sort(seen[:, :2] / seen[:, 2:] @ chains.along[n])
    halves = chains._replace(ends=cut)

    def met(one: Chains, spare: float) -> int:
        return len(curves_where_chains_meet(one, views, X, LOW, HIGH, replace(CONFIG, spare=spare)))

    assert met(chains, 0.1) > 0 and met(halves, 0.1) == 0 and met(halves, CONFIG.spare_alike) > 0


def test_partners_see_the_same_places_from_aside() -> None:
    """Two tracks at one height and one above: in a line between two, only the third shows where it is."""
    x = np.linspace(-0.5, 0.5, 5)
    centres = np.concatenate([[(at, y, z) for at in x] for y, z in ((-0.5, 0.0), (0.5, 0.0), (-0.3, 0.4))])
    views = views_of(pinhole_cameras(centres, np.tile([0.0, 0.0, 0.0], (15, 1)) + centres * (1, 0, 0)))
    found = partners(views, (-1.0, *LOW), (1.0, *HIGH), CONFIG)
    places = np.random.default_rng(0).uniform(-0.5, 0.5, (5000, 3))
    seen = seen_places(views, places)
    for n, row in enumerate(found):
        others = row[row >= 0]
        assert n not in others and len(set(others)) == len(others) > 0
        assert not set(others) & set(range(n // 5 * 5, n // 5 * 5 + 5))  # its own track shows the same planes
        assert {other // 5 for other in others} == {0, 1, 2} - {n // 5}
        assert all((seen[n] & seen[other]).any() for other in others)


def test_a_view_that_sees_what_no_other_does_has_no_partner() -> None:
    centres = np.array([[0.0, -0.5, 0.2], [0.0, 0.5, 0.0], [0.0, 0.0, 0.31]])
    targets = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.1, 9.0]])
    found = partners(views_of(pinhole_cameras(centres, targets)), (-1.0, *LOW), (1.0, *HIGH), CONFIG)
    assert found[:, 0].tolist() == [1, 0, -1] and (found[:, 1:] == -1).all()


def test_partners_are_of_all_parts_of_a_flight() -> None:
    """A long track far away comes first: those beside the wire have others beside it among their partners."""
    far = [(at, y, 0.6) for y in (-1.2, 1.2) for at in np.linspace(-0.8, 0.8, 20)]
    near = [(at, y, 0.1) for y in (-0.3, 0.3) for at in np.linspace(-0.5, 0.5, 8)]
    centres = np.array(far + near)
    views = views_of(pinhole_cameras(centres, centres * (1, 0, 0)))
    found = partners(views, (-1.0, *LOW), (1.0, *HIGH), CONFIG)
    beside = np.arange(len(far), len(centres))
    assert set(found[found >= 0].tolist()) == set(range(len(centres)))
    assert np.isin(found[beside], beside).any(1).mean() > 0.8
