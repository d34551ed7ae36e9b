"""Kernels around curves against their references in torch: the same windows, edges and samples in tubes."""

from dataclasses import replace

import pytest
import torch
from tests.field.test_guides import NEAR, guides, rays_from
from tests.field.test_tubes import WIRES, a_field, some_samples
from tests.render.test_guided import WARP, a_generator, some_edges, some_windows
from torch import Tensor

from plnerf.field.guides import Guides, Windows, windows
from plnerf.field.tubes import InTubes, TubeField
from plnerf.rays.rays import Rays
from plnerf.render.guided import guide_edges


def by_kernels(field: TubeField) -> TubeField:
    field.grid.backend = "numba"
    return field


def in_double(rays: Rays) -> Rays:
    return Rays(rays.origins.double(), rays.directions.double(), rays.radius.double(), rays.camera)


def swung_and_turned() -> Guides:
    """Curves along any azimuth that bow sideways too, as wires in wind do."""
    curves, turn = guides(), torch.tensor([0.5, -1.1, 2.4])
    return replace(
        curves,
        along=torch.stack([turn.cos(), turn.sin()], 1),
        y=curves.y + torch.tensor([0.0, 0.0, 0.08]) * torch.tensor([[1.0], [-1.0], [0.5]]),
    )


def rays_past(curves: Guides, each: int, seed: int) -> Rays:
    """Rays from around that pass each curve some hundredths away."""
    generator, parts = torch.Generator().manual_seed(seed), []
    for c in range(len(curves)):
        low, high = curves.ends[c]
        s = low + (high - low) * torch.rand(each, generator=generator)
        y, z = (torch.stack([s**0, s, s**2], 1) @ of[c] for of in (curves.y, curves.z))
        ux, uy = curves.along[c]
        on = torch.stack([ux * s - uy * y, uy * s + ux * y, z], 1)
        on = on + torch.cat([curves.origin[c], torch.zeros(1)])
        on = on + 0.02 * torch.randn(each, 3, generator=generator)
        origins = on + torch.nn.functional.normalize(torch.randn(each, 3, generator=generator), dim=1)
        parts.append((origins, on - origins))
    return rays_from(*(torch.cat(values) for values in zip(*parts, strict=True)))


def assert_same_windows(rays: Rays, curves: Guides | None = None) -> Windows:
    """In double precision to rounding; in single precision the reference itself loses digits."""
    curves = curves or guides()
    exact = Guides(*(value.double() for value in curves.tensors))
    truth = windows(in_double(rays), exact, NEAR)
    for found, off in (
        (windows(in_double(rays), exact, NEAR, "numba"), 1e-12),
        (windows(rays, curves, NEAR, "numba"), 1e-6),
    ):
        assert torch.equal(found.hit, truth.hit)
        hit = truth.hit
        assert torch.equal(found.curve[hit], truth.curve[hit])
        torch.testing.assert_close(found.low[hit].double(), truth.low[hit], atol=off, rtol=0)
        torch.testing.assert_close(found.high[hit].double(), truth.high[hit], atol=off, rtol=0)
        assert found.low.isfinite().all() and found.high.isfinite().all()
        assert ((found.curve >= 0) & (found.curve < len(curves))).all()
    return found


@pytest.mark.parametrize("seed", range(3))
def test_windows_are_those_of_the_reference(seed: int) -> None:
    rays, _ = some_samples(seed)
    assert assert_same_windows(rays).hit.float().mean() > 0.5
    assert_same_windows(rays, guides(WIRES[0]))


def test_windows_along_swung_wires_of_any_azimuth_are_those_of_the_reference() -> None:
    curves = swung_and_turned()
    assert assert_same_windows(rays_past(curves, 100, 0), curves).hit.float().mean() > 0.5


def test_rays_that_meet_nothing_have_no_windows() -> None:
    away = rays_from(torch.full((7, 3), 50.0), torch.eye(3)[torch.arange(7) % 3])
    assert not assert_same_windows(away).hit.any()


def test_curves_behind_a_camera_have_no_windows() -> None:
    rays, _ = some_samples()
    turned = replace(rays, directions=-rays.directions)
    assert assert_same_windows(turned).hit.float().mean() < 0.1


@pytest.mark.parametrize("count", [1, 2, 7, 13, 16])
@pytest.mark.parametrize("seed", [None, 0])
@pytest.mark.parametrize("k", [1, 2])
def test_edges_are_those_of_the_reference(count: int, seed: int | None, k: int) -> None:
    s, found = some_edges(60, 33, 5), some_windows(60, k, 6)
    truth = guide_edges(s, found, count, WARP, a_generator(seed))
    laid = guide_edges(s, found, count, WARP, a_generator(seed), "numba")
    torch.testing.assert_close(laid, truth, atol=3e-7, rtol=0)
    assert torch.equal(laid[~found.hit], s[~found.hit])


def assert_same_tubes(rays: Rays, t: Tensor, found: Windows, curves: Guides | None = None) -> InTubes:
    field = a_field()
    field.guides = curves or field.guides
    truth, at = field.locate(rays, t, found), by_kernels(field).locate(rays, t, found)
    assert torch.equal(at.index, truth.index) and torch.equal(at.curve, truth.curve)
    torch.testing.assert_close(at.unit, truth.unit, atol=2e-6, rtol=0)
    return at


def test_samples_in_tubes_are_those_of_the_reference() -> None:
    rays, t = some_samples()
    assert len(assert_same_tubes(rays, t, windows(rays, guides(), NEAR)).index) > 200
    every = torch.arange(len(WIRES)).expand(len(rays), -1)
    everywhere = Windows(every.float(), every.float(), every, torch.ones(len(rays), dtype=torch.bool))
    assert len(assert_same_tubes(rays, t, everywhere).index) > 200
    curves = swung_and_turned()
    past = rays_past(curves, 60, 1)
    assert len(assert_same_tubes(past, t, windows(past, curves, NEAR), curves).index) > 200
    nowhere = replace(everywhere, hit=torch.zeros(len(rays), dtype=torch.bool))
    assert len(assert_same_tubes(rays, t, nowhere).index) == 0


def test_rays_are_shared_between_threads() -> None:
    """Enough of them that more than one thread computes, to the same bits as alone."""
    rays, t = some_samples()
    many = Rays(*(
        torch.cat([getattr(rays, name)] * 20) for name in ("origins", "directions", "radius", "camera")
    ))  # fmt: skip
    alone, found = windows(rays, guides(), NEAR, "numba"), windows(many, guides(), NEAR, "numba")
    for name in ("low", "high", "curve", "hit"):
        assert torch.equal(getattr(found, name), torch.cat([getattr(alone, name)] * 20)), name
    field, n = by_kernels(a_field()), t.shape[0] * (t.shape[1] - 1)
    one, all_of_them = field.locate(rays, t, alone), field.locate(many, torch.cat([t] * 20), found)
    assert torch.equal(all_of_them.index, torch.cat([one.index + k * n for k in range(20)]))
    assert torch.equal(all_of_them.unit, torch.cat([one.unit] * 20))
