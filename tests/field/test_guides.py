"""Where rays pass near curves: against looking everywhere; nothing is missed, nothing made up."""

import numpy as np
import pytest
import torch
from tests.support.drawn import hanging
from torch import Tensor

from plnerf.detect.curves import Curve
from plnerf.field.guides import MOST_OBLIQUE, Guides, closest_approach, guides_of, windows
from plnerf.rays.rays import Rays

CURVES = (hanging(0.05, 0.1, 0.05, askew=0.03, climb=0.1), hanging(-0.1, 0.0, 0.02), hanging(0.0, 0.3, 0.1))
NEAR = 0.03


def rays_from(origins: Tensor, directions: Tensor, radius: float = 0.002) -> Rays:
    directions = directions / directions.norm(dim=1, keepdim=True)
    n = len(origins)
    return Rays(origins, directions, torch.full((n,), radius), torch.zeros(n, dtype=torch.int64))


def rays_near(curve: Curve, n: int, seed: int, spread: float = 0.02) -> Rays:
    """Rays from anywhere around that pass some `spread` from a curve, or further."""
    generator = torch.Generator().manual_seed(seed)
    origins = (torch.rand(n, 3, generator=generator) - 0.5) * torch.tensor([2.0, 1.2, 0.9])
    x = np.random.default_rng(seed).uniform(*curve.ends, n)
    target = torch.from_numpy(curve.points(x)).float() + spread * torch.randn(n, 3, generator=generator)
    return rays_from(origins, target - origins)


def by_looking_everywhere(rays: Rays, curve: Curve) -> tuple[Tensor, Tensor]:
    """Distance along the rays and how close, from 4001 points of the curve."""
    points = torch.from_numpy(curve.points(np.linspace(*curve.ends, 4001))).float()
    found = []
    for first in range(0, len(rays), 100):
        some = rays[slice(first, first + 100)]
        apart = points[None] - some.origins[:, None]
        along = (apart * some.directions[:, None]).sum(-1)
        miss, where = (apart - along[..., None] * some.directions[:, None]).norm(dim=-1).min(1)
        found.append(torch.stack([along.gather(1, where[:, None])[:, 0], miss]))
    t, miss = torch.cat(found, 1)
    return t, miss


@pytest.mark.parametrize("which", range(len(CURVES)))
def test_closest_approach_is_what_looking_everywhere_finds(which: int) -> None:
    curve = CURVES[which]
    rays = rays_near(curve, 1000, seed=which)
    t, miss, sine = (value[:, which] for value in closest_approach(rays, guides_of(CURVES)))
    true_t, true_miss = by_looking_everywhere(rays, curve)
    assert (miss > true_miss - 2e-4).all()  # a distance to a point of the curve is never below the least
    across = (sine > MOST_OBLIQUE) & (true_miss < 0.1)
    assert across.sum() > 500
    torch.testing.assert_close(miss[across], true_miss[across], atol=2e-4, rtol=0)
    torch.testing.assert_close(t[across], true_t[across], atol=2e-2, rtol=0)
    tight = across & (sine > 0.5)
    torch.testing.assert_close(t[tight], true_t[tight], atol=1e-3, rtol=0)


@pytest.mark.parametrize("curve", CURVES)
@pytest.mark.parametrize("aside", [0.0, 1e-6, 1e-3, 0.1])
def test_rays_along_a_curve_stay_finite(curve: Curve, aside: float) -> None:
    """Along the chord, along the tangent at an end and in the middle, and where the ray ends or begins."""
    x = np.array([curve.ends[0], 0.0, curve.ends[1], -0.5])
    on = curve.points(x)
    chord = on[2] - on[0]
    tangent = np.stack([np.ones(4), np.full(4, curve.y[1]), curve.z[1] + 2 * curve.z[2] * x], 1)
    origins = torch.from_numpy(np.concatenate([on, on - chord])).float() + aside
    directions = torch.from_numpy(np.concatenate([tangent, np.tile(chord, (4, 1))])).float()
    rays = rays_from(origins, directions)
    t, miss, sine = closest_approach(rays, guides_of([curve]))
    assert t.isfinite().all() and miss.isfinite().all() and (miss >= 0).all()
    assert (sine > 0).all() and (sine <= 1 + 1e-6).all()
    found = windows(rays, guides_of([curve]), NEAR)
    assert found.low.isfinite().all() and found.high.isfinite().all()


def test_straight_curves_and_rays_across_have_a_formula() -> None:
    """A ray down from a height onto a straight level line: t is the height, the miss what it is beside."""
    line = Curve((0.2, 0.0), (-0.1, 0.0, 0.0), (-1.0, 1.0), 0.0, 0.01, True)
    x, aside, height = torch.tensor([-0.7, 0.0, 0.9]), torch.tensor([0.0, 0.05, -0.3]), 0.6
    origins = torch.stack([x, 0.2 + aside, torch.full((3,), height - 0.1)], 1)
    down = rays_from(origins, torch.tensor([[0.0, 0.0, -1.0]]).repeat(3, 1))
    t, miss, sine = closest_approach(down, guides_of([line]))
    torch.testing.assert_close(t[:, 0], torch.full((3,), height))
    torch.testing.assert_close(miss[:, 0], aside.abs(), atol=1e-6, rtol=0)
    torch.testing.assert_close(sine[:, 0], torch.ones(3))


def test_windows_hold_the_closest_approach_of_every_curve_in_reach() -> None:
    """And are there exactly for rays that have such a curve before them; at most the two closest."""
    rays = Rays(*(torch.cat(parts) for parts in zip(*(
        (r.origins, r.directions, r.radius, r.camera)
        for r in (rays_near(curve, 400, k, 0.03) for k, curve in enumerate(CURVES))
    ), strict=True)))  # fmt: skip
    found = windows(rays, guides_of(CURVES), NEAR)
    _, _, sine = closest_approach(rays, guides_of(CURVES))
    near = []
    for k, curve in enumerate(CURVES):
        t, miss = by_looking_everywhere(rays, curve)
        reach = curve.reach + rays.radius * t.clamp_min(0)
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
    return guides_of([
        Curve((0.0, 0.0), (-depth, 0.0, 0.0), (-1.0, 1.0), 0.0, reach, True) for depth in (first, second)
    ])


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
    found = windows(rays_near(CURVES[0], 50, seed=5), guides_of(CURVES[:1]), NEAR)
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
    rays = rays_near(CURVES[0], 20, seed=6)
    leaf = rays.origins.clone().requires_grad_()
    found = windows(Rays(leaf, rays.directions, rays.radius, rays.camera), guides_of(CURVES), NEAR)
    assert not found.low.requires_grad and not found.high.requires_grad
    assert leaf.grad is None


def test_each_ray_is_on_its_own() -> None:
    rays, guides = rays_near(CURVES[1], 60, seed=7), guides_of(CURVES)
    whole = windows(rays, guides, NEAR)
    for k in (0, 17, 59):
        alone = windows(rays[slice(k, k + 1)], guides, NEAR)
        torch.testing.assert_close(alone.low[0], whole.low[k])
        assert torch.equal(alone.curve[0], whole.curve[k]) and alone.hit[0] == whole.hit[k]
