"""NeRF 2020, Mip-NeRF: samples follow weight, a thin cone is a ray, normals are gradients."""

from dataclasses import replace
from typing import Literal

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from plnerf.errors import ConfigError
from plnerf.field.config import VanillaConfig
from plnerf.field.vanilla import VanillaField, density_normals
from plnerf.rays.rays import Rays
from plnerf.render.coarse_fine import CoarseFineNeRF, spread
from plnerf.render.config import CoarseFineConfig, SamplerConfig
from plnerf.render.system import RenderedRays
from plnerf.train.config import LossWeights
from plnerf.train.losses import loss_terms

IMAGES = 3
FIELD = VanillaConfig(octaves=4, depth=3, width=16, skip=2, colour_width=8, appearance=2, normals=True)
NERF = CoarseFineConfig(field=FIELD, sampler=SamplerConfig(proposals=(12,), final=9, near=0.1, far=50.0))
MIP = replace(NERF, field=replace(FIELD, encoding="ipe"), networks=1)
ONE_LOOK = replace(NERF, sampler=replace(NERF.sampler, proposals=()))
CONFIGS = {"nerf": NERF, "mip-nerf": MIP, "one look": ONE_LOOK}


def make(config: CoarseFineConfig, dtype: torch.dtype = torch.float32) -> CoarseFineNeRF:
    return CoarseFineNeRF(config, IMAGES, "torch", torch.Generator().manual_seed(0)).to(dtype)


def some_rays(n: int, radius: float = 1e-3, dtype: torch.dtype = torch.float32) -> Rays:
    generator = torch.Generator().manual_seed(2)
    origins, directions = torch.randn(2, n, 3, generator=generator, dtype=dtype)
    directions = torch.nn.functional.normalize(directions, dim=-1)
    return Rays(origins, directions, torch.full((n,), radius, dtype=dtype), torch.arange(n) % IMAGES)


def render(model: CoarseFineNeRF, rays: Rays, **options: object) -> RenderedRays:
    out: RenderedRays = model(rays, appearance=model.appearance[rays.camera], **options)
    return out


@pytest.mark.parametrize("name", CONFIGS)
def test_shapes_and_ranges(name: str) -> None:
    out = render(make(CONFIGS[name]), some_rays(7), normals=True, normal_rays=4)
    assert out.colour.shape == (7, 3) and (out.colour >= 0).all() and (out.colour <= 1).all()
    assert out.normals is not None and out.normals.shape == (7, 3)
    final = out.histograms[-1]
    assert (final.s.diff(dim=1) >= 0).all() and final.s.shape[1] == final.w.shape[1] + 1
    looks = 1 if name == "one look" else 2
    assert len(out.histograms) == looks and (out.coarse_colour is None) == (looks == 1)
    # NeRF 2020's fine look sees the coarse points again, Mip-NeRF's only its own intervals.
    assert final.w.shape[1] == {"nerf": 12 + 9, "mip-nerf": 9, "one look": 9}[name]


@pytest.mark.parametrize("name", CONFIGS)
def test_every_parameter_is_trained_but_for_the_poses(name: str) -> None:
    model, rays = make(CONFIGS[name]), some_rays(20)
    out = render(model, rays, generator=torch.Generator().manual_seed(3), normal_rays=5)
    terms = loss_terms(out, torch.rand(20, 3), torch.ones(20), LossWeights(interlevel=0.0, distortion=0.0))
    assert ("coarse" in terms) == (name != "one look") and "interlevel" not in terms
    torch.stack(list(terms.values())).sum().backward()
    for key, value in model.named_parameters():
        if not key.startswith("poses"):
            assert value.grad is not None and value.grad.abs().max() > 0, key


@pytest.mark.parametrize("name", CONFIGS)
def test_a_ray_is_rendered_the_same_in_any_company(name: str) -> None:
    model, rays = make(CONFIGS[name], torch.float64), some_rays(9, dtype=torch.float64)
    together = render(model, rays)
    for k in (0, 5):
        alone = render(model, rays[k : k + 1])
        torch.testing.assert_close(alone.colour[0], together.colour[k])


def test_two_networks_are_two_and_one_look_has_one() -> None:
    assert make(NERF).coarse is not None
    assert make(MIP).coarse is None and make(ONE_LOOK).coarse is None


@given(st.integers(0, 1000), st.sampled_from(["nerf", "mip-nerf"]))
@settings(max_examples=30, deadline=None)
def test_fine_samples_lie_where_the_weight_is(seed: int, name: str) -> None:
    """All weight in one interval: the fine samples lie there, or, spread, right beside it."""
    generator = torch.Generator().manual_seed(seed)
    model = make(replace(CONFIGS[name], sampler=replace(CONFIGS[name].sampler, padding=1e-6)))
    s = model._first_edges(some_rays(4), 12, generator)
    assert (s.diff(dim=1) >= 0).all() and s.min() >= 0 and s.max() <= 1
    k = 2 + seed % 8
    w = torch.zeros(4, 12)
    w[:, k] = 0.9
    fine = model._fine_edges(s, w, 1.0, generator)
    assert (fine.diff(dim=1) >= 0).all()
    if name == "nerf":
        new = torch.stack([row[~torch.isin(row, old)] for row, old in zip(fine, s, strict=True)])
        low, high = (s[:, k - 1] + s[:, k]) / 2, (s[:, k] + s[:, k + 1]) / 2
        assert torch.isin(s, fine).all() and new.shape == (4, 9)
    else:
        new, low, high = fine, s[:, k - 1], s[:, k + 2]
    assert (new >= low[:, None] - 1e-4).all() and (new <= high[:, None] + 1e-4).all()


def test_weights_are_spread_by_hand() -> None:
    torch.testing.assert_close(spread(torch.tensor([[0.0, 1.0, 0.0, 0.0]])), torch.tensor([[0.5, 1, 0.5, 0]]))
    torch.testing.assert_close(spread(torch.tensor([[0.2, 0.2, 0.2]])), torch.tensor([[0.2, 0.2, 0.2]]))


def test_mip_nerf_is_nerf_where_cones_are_infinitely_thin() -> None:
    """The same network on the same short intervals: the thinner the cone, the nearer the pictures."""
    nerf = make(replace(NERF, networks=1), torch.float64)
    mip = make(MIP, torch.float64)
    assert mip.load_state_dict(nerf.state_dict()) is not None
    s = torch.linspace(0.2, 0.6, 4001, dtype=torch.float64).expand(5, -1)
    apart = []
    for radius in (1e-1, 1e-2, 0.0):
        rays = some_rays(5, radius, torch.float64)
        zero = torch.zeros(5, FIELD.appearance, dtype=torch.float64)
        seen, thin = (model.evaluate(model.field, rays, s, zero)[0] for model in (nerf, mip))
        apart.append(float((seen.colour - thin.colour).abs().max()))
    assert apart[0] > 5 * apart[1] and apart[2] < 1e-4 and apart[1] < 1e-3


@pytest.mark.parametrize("encoding", ["pe", "ipe"])
@pytest.mark.parametrize("contraction", [False, True])
def test_normals_are_the_gradient_of_the_density(encoding: Literal["pe", "ipe"], contraction: bool) -> None:
    config = replace(FIELD, octaves=2, encoding=encoding, contraction=contraction)
    field = VanillaField(config, torch.Generator().manual_seed(1)).double()
    rays = some_rays(6, dtype=torch.float64)
    t = torch.linspace(0.5, 1.5, 5, dtype=torch.float64).expand(6, -1)
    normals = density_normals(field, rays, t)

    def density(move: Tensor) -> Tensor:
        with torch.no_grad():
            return field.density(field.encode(replace(rays, origins=rays.origins + move), t))[0]

    step = 1e-6 * torch.eye(3, dtype=torch.float64)
    slope = torch.stack([density(step[k]) - density(-step[k]) for k in range(3)], -1) / 2e-6
    wanted = -torch.nn.functional.normalize(slope, dim=-1)
    assert (normals * wanted).sum(-1).min() > 0.999


def test_an_empty_network_has_the_density_of_mip_nerf_and_no_place_too_empty_for_normals() -> None:
    field, rays = VanillaField(FIELD, torch.Generator()), some_rays(4)
    t = torch.tensor([[0.1, 0.5, 1.0]]).expand(4, -1)
    with torch.no_grad():
        for value in field.density_layer.parameters():
            value.zero_()
    density, _ = field.density(field.encode(rays, t))
    torch.testing.assert_close(density, torch.full((4, 2), 0.31326169))  # log(1 + 1/e)
    with torch.no_grad():
        field.density_layer[-1].bias.fill_(-300.0)
    assert density_normals(field, rays, t).isfinite().all()


def test_wrong_settings_are_told() -> None:
    for wrong in ({"networks": 3}, {"sampler": SamplerConfig(proposals=(8, 8))}):
        with pytest.raises(ConfigError, match="at most one proposal round"):
            replace(NERF, **wrong)
    with pytest.raises(ConfigError, match="3 intervals or more"):
        replace(NERF, sampler=SamplerConfig(proposals=(2,)))
    with pytest.raises(ConfigError, match="0 <= skip < depth"):
        replace(FIELD, skip=3)
