"""Where rays pass near curves: against looking everywhere; nothing is missed, nothing made up."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from tests.support.drawn import FRAME, FRAMES, HALF, hanging, resized
from torch import Tensor

from plnerf.field.guides import MOST_OBLIQUE, Guides, closest_approach, guides_of, scene_points, windows
from plnerf.line.base import Base
from plnerf.line.frame import LineFrame
from plnerf.line.hang import hang
from plnerf.line.wire import Wire
from plnerf.rays.rays import Rays

WIRES = (hanging(0.05, 0.1, 0.05, askew=0.03, climb=0.1), hanging(-0.1, 0.0, 0.02), hanging(0.0, 0.3, 0.1))
NEAR = 0.03


def guides(*wires: Wire) -> Guides:
    return guides_of(wires or WIRES, FRAME)


def on_parabola(wire: Wire, x: np.ndarray) -> np.ndarray:
    """Points at x of the parabola that stands for a wire from -HALF to HALF."""
    y_A, y_B, z_A, z_B, *_ = wire.theta
    b = wire.drop_between(0.0, wire.base.length_m)
    t = (x + HALF) / (2 * HALF)
    return np.stack([x, y_A + (y_B - y_A) * t, z_A + (z_B - z_A) * t - 4 * b * t * (1 - t)], 1)


def rays_from(origins: Tensor, directions: Tensor, radius: float = 0.002) -> Rays:
    directions = directions / directions.norm(dim=1, keepdim=True)
    n = len(origins)
    return Rays(origins, directions, torch.full((n,), radius), torch.zeros(n, dtype=torch.int64))


def rays_near(wire: Wire, n: int, seed: int, spread: float = 0.02) -> Rays:
    """Rays from anywhere around that pass some `spread` from a wire, or further."""
    generator = torch.Generator().manual_seed(seed)
    origins = (torch.rand(n, 3, generator=generator) - 0.5) * torch.tensor([2.0, 1.2, 0.9])
    x = np.random.default_rng(seed).uniform(-HALF, HALF, n)
    target = torch.from_numpy(on_parabola(wire, x)).float() + spread * torch.randn(n, 3, generator=generator)
    return rays_from(origins, target - origins)


def by_brute_force(rays: Rays, wire: Wire) -> tuple[Tensor, Tensor]:
    """Distance along the rays and how close, from 4001 points of the curve."""
    points = torch.from_numpy(on_parabola(wire, np.linspace(-HALF, HALF, 4001))).float()
    found = []
    for first in range(0, len(rays), 100):
        some = rays[slice(first, first + 100)]
        apart = points[None] - some.origins[:, None]
        along = (apart * some.directions[:, None]).sum(-1)
        miss, where = (apart - along[..., None] * some.directions[:, None]).norm(dim=-1).min(1)
        found.append(torch.stack([along.gather(1, where[:, None])[:, 0], miss]))
    t, miss = torch.cat(found, 1)
    return t, miss


@pytest.mark.parametrize("which", range(len(WIRES)))
def test_closest_approach_is_what_brute_force_finds(which: int) -> None:
    wire = WIRES[which]
    rays = rays_near(wire, 1000, seed=which)
    t, miss, sine = (value[:, which] for value in closest_approach(rays, guides()))
    true_t, true_miss = by_brute_force(rays, wire)
    assert (miss > true_miss - 2e-4).all()  # a distance to a point of the curve is never below the least
    across = (sine > MOST_OBLIQUE) & (true_miss < 0.1)
    assert across.sum() > 500
    torch.testing.assert_close(miss[across], true_miss[across], atol=2e-4, rtol=0)
    torch.testing.assert_close(t[across], true_t[across], atol=2e-2, rtol=0)
    tight = across & (sine > 0.5)
    torch.testing.assert_close(t[tight], true_t[tight], atol=1e-3, rtol=0)


@pytest.mark.parametrize("wire", WIRES)
@pytest.mark.parametrize("aside", [0.0, 1e-6, 1e-3, 0.1])
def test_rays_along_a_curve_stay_finite(wire: Wire, aside: float) -> None:
    """Along the chord, along the tangent at an end and in the middle, and where the ray ends or begins."""
    x = np.array([-HALF, 0.0, HALF, -0.5])
    on = on_parabola(wire, x)
    chord = on[2] - on[0]
    slope = chord / chord[0]
    bend = np.stack([0 * x, 0 * x, 2 * wire.drop_between(0.0, wire.base.length_m) * x / HALF**2], 1)
    tangent = slope + bend
    origins = torch.from_numpy(np.concatenate([on, on - chord])).float() + aside
    directions = torch.from_numpy(np.concatenate([tangent, np.tile(chord, (4, 1))])).float()
    rays = rays_from(origins, directions)
    t, miss, sine = closest_approach(rays, guides(wire))
    assert t.isfinite().all() and miss.isfinite().all() and (miss >= 0).all()
    assert (sine > 0).all() and (sine <= 1 + 1e-6).all()
    found = windows(rays, guides(wire), NEAR)
    assert found.low.isfinite().all() and found.high.isfinite().all()


def test_straight_curves_and_rays_across_have_a_formula() -> None:
    """A ray down from a height onto a straight level line: t is the height, the miss what it is beside."""
    line = hanging(0.2, -0.1, 0.0, reach=0.01)
    x, aside, height = torch.tensor([-0.7, 0.0, 0.89]), torch.tensor([0.0, 0.05, -0.3]), 0.6
    origins = torch.stack([x, 0.2 + aside, torch.full((3,), height - 0.1)], 1)
    down = rays_from(origins, torch.tensor([[0.0, 0.0, -1.0]]).repeat(3, 1))
    t, miss, sine = closest_approach(down, guides(line))
    torch.testing.assert_close(t[:, 0], torch.full((3,), height))
    torch.testing.assert_close(miss[:, 0], aside.abs(), atol=1e-6, rtol=0)
    torch.testing.assert_close(sine[:, 0], torch.ones(3))


def test_windows_hold_the_closest_approach_of_every_curve_in_reach() -> None:
    """And are there exactly for rays that have such a curve before them; at most the two closest."""
    rays = Rays(*(torch.cat(parts) for parts in zip(*(
        (r.origins, r.directions, r.radius, r.camera)
        for r in (rays_near(wire, 400, k, 0.03) for k, wire in enumerate(WIRES))
    ), strict=True)))  # fmt: skip
    found = windows(rays, guides(), NEAR)
    _, _, sine = closest_approach(rays, guides())
    near = []
    for k, wire in enumerate(WIRES):
        t, miss = by_brute_force(rays, wire)
        assert wire.evidence.reach_m is not None
        reach = wire.evidence.reach_m + rays.radius * t.clamp_min(0)
        half = reach / sine[:, k].clamp_min(MOST_OBLIQUE)
        inside, clearly = (miss < 0.98 * reach) & (t > half + NEAR + 0.01), sine[:, k] > MOST_OBLIQUE
        near.append(inside)
        held = ((found.curve == k) & (found.low < t[:, None]) & (t[:, None] < found.high)).any(1)
        wanted = inside & clearly & (torch.stack([found.curve == k]).any(0).any(1))
        assert wanted.sum() > 100
        assert (held | ~wanted).all()
        apart = (miss > 1.02 * reach) & clearly
        assert not (found.hit & (found.curve == k).all(1) & apart).any()
    assert (found.hit | ~(torch.stack(near).any(0) & (sine > MOST_OBLIQUE).all(1))).all()
    assert found.low.shape == found.high.shape == found.curve.shape == (len(rays), 2)
    assert (found.low < found.high)[found.hit].all() and (found.low > NEAR - 1e-6)[found.hit].all()


def two_lines(first: float, second: float, reach: float = 0.02) -> Guides:
    """Level straight lines under the x axis, at these depths."""
    return guides(*(hanging(0.0, -depth, 0.0, reach=reach) for depth in (first, second)))


DOWN = rays_from(torch.tensor([[0.1, 0.0, 0.0]]), torch.tensor([[0.0, 0.0, -1.0]]), radius=0.0)


def test_two_curves_on_one_ray_have_a_window_each_and_one_has_it_twice() -> None:
    both = windows(DOWN, two_lines(0.3, 0.6), NEAR)
    assert sorted(both.curve[0].tolist()) == [0, 1]
    middles = ((both.low + both.high) / 2)[0, both.curve[0].argsort()]
    torch.testing.assert_close(middles, torch.tensor([0.3, 0.6]))
    torch.testing.assert_close(both.high - both.low, torch.full((1, 2), 0.04))
    one = windows(DOWN, two_lines(0.3, -0.6), NEAR)  # the other one is behind
    assert one.curve.tolist() == [[0, 0]] and one.hit.tolist() == [True]
    assert torch.equal(one.low[:, 0], one.low[:, 1]) and torch.equal(one.high[:, 0], one.high[:, 1])


def test_one_curve_makes_one_window() -> None:
    found = windows(rays_near(WIRES[0], 50, seed=5), guides(WIRES[0]), NEAR)
    assert found.low.shape == found.high.shape == found.curve.shape == (50, 1) and found.hit.shape == (50,)
    assert found.hit.any() and (found.curve == 0).all()


def test_curves_behind_out_of_reach_or_too_close_are_not_hit() -> None:
    for first, second in ((-0.3, -0.6), (0.04, 0.01)):  # behind; a window that begins before NEAR
        assert not windows(DOWN, two_lines(first, second), NEAR).hit.any()
    aside = rays_from(DOWN.origins + torch.tensor([0.0, 0.03, 0.0]), DOWN.directions, radius=0.0)
    assert not windows(aside, two_lines(0.3, 0.6), NEAR).hit.any()
    assert windows(aside, two_lines(0.3, 0.6, reach=0.031), NEAR).hit.all()
    beyond = rays_from(DOWN.origins + torch.tensor([1.0, 0.0, 0.0]), DOWN.directions, radius=0.0)
    assert not windows(beyond, two_lines(0.3, 0.6), NEAR).hit.any()  # past the curve's end


def test_a_wide_pixel_reaches_further() -> None:
    aside = DOWN.origins + torch.tensor([0.0, 0.03, 0.0])
    hits = [
        windows(rays_from(aside, DOWN.directions, radius), two_lines(0.3, 0.6), NEAR).hit.item()
        for radius in (0.0, 0.01, 0.05)
    ]
    assert hits == [False, False, True]  # 0.02 + 0.6 * 0.05 = 0.05


def test_windows_have_no_gradient() -> None:
    rays = rays_near(WIRES[0], 20, seed=6)
    leaf = rays.origins.clone().requires_grad_()
    found = windows(Rays(leaf, rays.directions, rays.radius, rays.camera), guides(), NEAR)
    assert not found.low.requires_grad and not found.high.requires_grad
    assert leaf.grad is None


def test_each_ray_is_on_its_own() -> None:
    rays = rays_near(WIRES[1], 60, seed=7)
    whole = windows(rays, guides(), NEAR)
    for k in (0, 17, 59):
        alone = windows(rays[slice(k, k + 1)], guides(), NEAR)
        torch.testing.assert_close(alone.low[0], whole.low[k])
        assert torch.equal(alone.curve[0], whole.curve[k]) and alone.hit[0] == whole.hit[k]


# -- from wires to guides


def polynomials(found: Guides, share: np.ndarray) -> np.ndarray:
    """Points of the first guide at shares of its length, scene frame, in float64."""
    origin, u, y, z, ends = (
        value[0].double().numpy() for value in (found.origin, found.along, found.y, found.z, found.ends)
    )
    s = ends[0] + share * (ends[1] - ends[0])
    sideways, up = (row[0] + s * (row[1] + row[2] * s) for row in (y, z))
    level = origin + s[:, None] * u + sideways[:, None] * np.array([-u[1], u[0]])
    return np.concatenate([level, up[:, None]], 1)


@given(
    st.floats(-0.3, 0.3), st.floats(-0.2, 0.2), st.floats(1e-3, 0.1), st.floats(-0.1, 0.1), st.floats(0.01, 2)
)
@settings(deadline=None)
def test_guides_are_the_parabola_of_a_wire_in_scene_units(
    y: float, z: float, sag: float, climb: float, scale: float
) -> None:
    """In a frame of another unit too; the polynomials, the ends, the reach and the points."""
    wire = hanging(y, z, sag, askew=0.05, climb=climb)
    frame = LineFrame.of_scene(replace(FRAMES, scale=scale))
    found = guides_of([resized(wire, 1 / scale)], frame)
    x, share = np.linspace(-HALF, HALF, 30), np.linspace(0, 1, 30)
    np.testing.assert_allclose(polynomials(found, share), on_parabola(wire, x), atol=1e-6)
    np.testing.assert_allclose(
        scene_points(resized(wire, 1 / scale), frame, 30), on_parabola(wire, x), atol=1e-12
    )
    assert found.ends[0].tolist() == pytest.approx([-HALF, HALF])
    assert found.reach[0].item() == pytest.approx(0.02)


def test_a_wire_on_a_reversed_base_has_the_same_guide() -> None:
    """A base below the wire's ends, as `hang` makes it, and one that runs the other way."""
    a, b = (-0.7, 0.1, 0.2), (0.8, 0.25, 0.3)
    forward, backward = (
        replace(wire, evidence=hanging(0.0, 0.0).evidence) for wire in (hang(a, b, 0.05), hang(b, a, 0.05))
    )
    share = np.linspace(0, 1, 20)
    on = polynomials(guides(forward), share)
    np.testing.assert_allclose(polynomials(guides(backward), 1 - share), on, atol=1e-6)
    np.testing.assert_allclose(on[[0, -1]], [a, b], atol=1e-6)
    wire = forward.points(share * forward.base.length_m)
    assert np.abs(on - wire).max() < 0.01 * 0.05


def turned(angle: float, points: np.ndarray) -> np.ndarray:
    """Points turned about the z axis and moved."""
    return Rotation.from_euler("z", angle).apply(points) + MOVED


MOVED = np.array([0.2, -0.3, 0.1])


def turned_wire(wire: Wire, angle: float) -> Wire:
    """The wire turned about the z axis and moved."""
    flat = [turned(angle, np.append(end, 0.0)[None])[0, :2] for end in (wire.base.a, wire.base.b)]
    up = MOVED[2] * np.array([0, 0, 1, 1, 0, 0])
    return replace(wire, base=Base(*flat), theta=wire.theta + up)


@given(st.floats(-3.2, 3.2), st.integers(0, 2), st.floats(-0.6, 0.6))
@settings(deadline=None, max_examples=30)
def test_wires_of_any_azimuth_are_met_as_those_along_x(angle: float, which: int, swing: float) -> None:
    """Wire and rays turned together: the same distances, misses and angles."""
    wire = replace(WIRES[which], theta=np.append(WIRES[which].theta[:5], swing))
    rays = rays_near(wire, 200, seed=which)
    both = Rays(
        torch.from_numpy(turned(angle, rays.origins.double().numpy())).float(),
        torch.from_numpy(turned(angle, rays.directions.double().numpy()) - MOVED).float(),
        rays.radius,
        rays.camera,
    )
    found = closest_approach(both, guides(turned_wire(wire, angle)))
    t, miss, sine = closest_approach(rays, guides(wire))
    across = sine > MOST_OBLIQUE
    for ours, theirs in zip(found, (t, miss, sine), strict=True):
        torch.testing.assert_close(ours[across], theirs[across], atol=1e-4, rtol=1e-4)


@pytest.mark.parametrize("swing_deg", [-25.0, 3.0, 60.0])
def test_guides_of_swung_wires_lie_in_the_swung_plane(swing_deg: float) -> None:
    """Within a hundredth of the sag of the wire, at an azimuth of its own; upright ones have a linear y."""
    wire = hanging(0.05, 0.1, 0.08, askew=0.03, climb=0.1)
    wire = turned_wire(replace(wire, theta=np.append(wire.theta[:5], np.radians(swing_deg))), 0.7)
    found, share = guides(wire), np.linspace(0, 1, 101)
    on = wire.points(share * wire.base.length_m)
    assert np.abs(polynomials(found, share) - on).max() < 0.01 * 0.08
    np.testing.assert_allclose(scene_points(wire, FRAME, 101), polynomials(found, share), atol=1e-6)
    assert abs(found.y[0, 2].item()) > 1e-3 and guides(WIRES[0]).y[0, 2] == 0


def test_guides_are_within_millimetres_of_a_span_of_usual_size() -> None:
    """200 m, a sag of 4 m, and a chord that rises by 6 m: the catenary of the same b."""
    span = replace(hang((-100.0, 3.0, 10.0), (100.0, 4.0, 16.0), 4.0), evidence=hanging(0.0, 0.0).evidence)
    frame = LineFrame.of_scene(replace(FRAMES, scale=0.01))
    at = frame.from_scene(scene_points(span, frame, 200))
    apart = np.abs(at - span.points(np.linspace(0.0, span.base.length_m, 200))).max()
    assert apart < 0.01


def test_a_wire_without_reach_is_refused() -> None:
    with pytest.raises(ValueError, match="wire 1 was not detected in images"):
        guides(hang((-0.7, 0.1, 0.2), (0.8, 0.25, 0.3), 0.05))
