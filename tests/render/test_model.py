"""The whole model: a function of each ray alone, normals that are gradients, no parameter left out."""

import dataclasses
from typing import Any

import pytest
import torch
from torch import Tensor

from plnerf.errors import ConfigError
from plnerf.field.config import DensityConfig, RadianceConfig
from plnerf.ops.backends import Backend
from plnerf.ops.grid import GridShape
from plnerf.rays.contraction import clamp_frustums, contract_frustums
from plnerf.rays.frustums import Frustums, ray_frustums
from plnerf.rays.rays import Rays
from plnerf.render.config import ModelConfig, SamplerConfig
from plnerf.render.model import PLNeRF
from plnerf.render.proposals import s_to_t
from plnerf.render.ray_ops import frustum_features
from plnerf.render.system import RenderedRays
from plnerf.train.config import LossWeights
from plnerf.train.losses import loss_terms

IMAGES = 4
CONFIG = ModelConfig(
    field=RadianceConfig(GridShape(4, 4, 64, 4, 10, "cubic"), hidden=16, feature=7, appearance=5),
    proposals=(DensityConfig(GridShape(2, 4, 16, 2, 9, "cubic"), 8),) * 2,
    sampler=SamplerConfig(proposals=(12, 10), final=8, near=0.05, far=100.0),
    stretch=(0.5, 1.0, 2.0),
)


def make_model(
    config: ModelConfig = CONFIG, backend: Backend = "numba", dtype: torch.dtype = torch.float32
) -> PLNeRF:
    """A model whose tables are large enough for space not to be uniform."""
    model = PLNeRF(config, IMAGES, backend, torch.Generator().manual_seed(0))
    with torch.no_grad():
        for grid in (model.field.grid, *(proposal.grid for proposal in model.proposals)):
            grid.table *= 5e3
        model.appearance += torch.randn(model.appearance.shape, generator=torch.Generator().manual_seed(1))
    return model.to(dtype)


def make_rays(n: int, dtype: torch.dtype = torch.float32) -> Rays:
    generator = torch.Generator().manual_seed(2)
    origins, directions = torch.randn(2, n, 3, generator=generator, dtype=dtype)
    directions = torch.nn.functional.normalize(directions, dim=-1)
    camera = torch.arange(n) % IMAGES
    return Rays(origins, directions, torch.full((n,), 1e-3, dtype=dtype), camera)


def render(model: PLNeRF, rays: Rays, **options: Any) -> RenderedRays:
    out: RenderedRays = model(rays, appearance=model.appearance[rays.camera], **options)
    return out


def test_shapes_and_ranges() -> None:
    out = render(make_model(), make_rays(6), normals=True, normal_rays=4)
    assert out.colour.shape == (6, 3)
    assert out.normals is not None
    assert out.normals.shape == (6, 3)
    assert out.accumulation.shape == out.depth.shape == out.depth_median.shape == (6,)
    assert [h.w.shape for h in out.histograms] == [(6, 12), (6, 10), (6, 8)]
    assert [h.s.shape for h in out.histograms] == [(6, 13), (6, 11), (6, 9)]
    samples = out.normal_samples
    assert samples is not None
    assert samples.from_density.shape == samples.predicted.shape == (4, 8, 3)
    assert samples.weights.shape == (4, 8)
    assert bool(((out.colour > 0) & (out.colour < 1)).all())
    assert bool(((out.accumulation > 0) & (out.accumulation <= 1 + 1e-6)).all())
    for depth in (out.depth, out.depth_median):
        assert bool(((depth >= 0.05) & (depth <= 100 * (1 + 1e-5))).all())
    plain = render(make_model(), make_rays(6))
    assert plain.normals is None
    assert plain.normal_samples is None


@pytest.mark.parametrize("backend", ["torch", "numba"])
def test_a_batch_in_two_halves_is_the_whole(backend: Backend) -> None:
    model, rays = make_model(backend=backend), make_rays(9)
    whole = render(model, rays, normals=True)
    halves = [render(model, rays[part], normals=True) for part in (slice(0, 4), slice(4, 9))]
    for name in ("colour", "accumulation", "depth", "depth_median", "normals"):
        joined = torch.cat([getattr(half, name) for half in halves])
        torch.testing.assert_close(joined, getattr(whole, name), rtol=1e-4, atol=1e-5)


def test_backends_render_the_same() -> None:
    rays = make_rays(9)
    a, b = (render(make_model(backend=backend), rays) for backend in ("torch", "numba"))
    torch.testing.assert_close(a.colour, b.colour, rtol=1e-4, atol=1e-5)


def test_rendering_is_a_function_of_its_generator() -> None:
    model, rays = make_model(), make_rays(5)
    seeds = [render(model, rays, generator=torch.Generator().manual_seed(seed)).colour for seed in (0, 0, 1)]
    assert torch.equal(seeds[0], seeds[1])
    assert not torch.equal(seeds[0], seeds[2])
    assert torch.equal(render(model, rays).colour, render(model, rays).colour)


def test_a_gradient_reaches_every_parameter() -> None:
    """Tables, networks, appearance and poses, from the sum of all losses."""
    model, rays = make_model(), make_rays(64)
    out = render(model, model.poses(rays), normal_rays=32)
    terms = loss_terms(out, torch.rand(64, 3), torch.ones(64), LossWeights())
    torch.stack(list(terms.values())).sum().backward()
    for name, parameter in model.named_parameters():
        assert parameter.grad is not None, name
        assert bool(parameter.grad.isfinite().all()), name
        assert bool(parameter.grad.any()), name


def test_only_the_interlevel_loss_trains_the_proposals() -> None:
    model, rays = make_model(), make_rays(16)
    out = render(model, rays)
    terms = loss_terms(out, torch.rand(16, 3), torch.ones(16), LossWeights())
    proposals = list(model.proposals.parameters())
    field = list(model.field.parameters())
    others = terms["colour"] + terms["distortion"]
    assert all(
        g is None for g in torch.autograd.grad(others, proposals, retain_graph=True, allow_unused=True)
    )
    assert all(g is None for g in torch.autograd.grad(terms["interlevel"], field, allow_unused=True))


@pytest.mark.parametrize("backend", ["torch", "numba"])
@pytest.mark.parametrize("contraction", [True, False], ids=["contracted", "clamped"])
@pytest.mark.parametrize("damping", [False, True], ids=["points", "damped"])
def test_density_normals_are_finite_differences_in_the_scene(
    contraction: bool, backend: Backend, damping: bool
) -> None:
    """n = -grad sigma/|grad sigma| by moving the frustums' means in scene space, their sizes the same.

    Through stretch, contraction and the cubic grid, inside the cube and far outside of it.
    """
    config = dataclasses.replace(
        CONFIG, contraction=contraction, field=dataclasses.replace(CONFIG.field, damping=damping)
    )
    if backend == "torch":  # linear weights too, whose slope does not vanish at the cube's faces
        grid = dataclasses.replace(CONFIG.field.grid, interpolation="linear")
        config = dataclasses.replace(config, field=dataclasses.replace(config.field, grid=grid))
    model, rays = make_model(config, backend, torch.float64), make_rays(12, torch.float64)
    out = render(model, rays, normal_rays=12)
    samples = out.normal_samples
    assert samples is not None
    t = s_to_t(out.histograms[-1].s, CONFIG.sampler)
    frustums = ray_frustums(rays, t)
    bound = contract_frustums if contraction else clamp_frustums
    size = model.frustum_sizes(rays, t, (bound(frustums, CONFIG.stretch)[0] + 2) / 4)
    assert (size is not None) == damping

    def density(move: Tensor) -> Tensor:
        moved = Frustums(frustums.mean + move, frustums.direction, frustums.var_t, frustums.var_r)
        return model.field.density((bound(moved, CONFIG.stretch)[0] + 2) / 4, size)[0]

    steps = 1e-6 * torch.eye(3, dtype=torch.float64)
    gradient = torch.stack([(density(step).log() - density(-step).log()) / 2e-6 for step in steps], -1)
    expected = -gradient / (gradient.square().sum(-1, keepdim=True) + 1e-6).sqrt()
    torch.testing.assert_close(samples.from_density, expected, atol=1e-5, rtol=0)
    outside = (frustums.mean.abs() * torch.tensor(CONFIG.stretch)).amax(-1) > 1
    assert 0.2 < outside.double().mean().item() < 0.95
    assert bool((samples.from_density.norm(dim=-1) <= 1).all())
    rise = torch.stack([density(step) - density(-step) for step in steps], -1)
    assert bool(((samples.from_density * rise).sum(-1) <= 0).all())  # normals point to where it is emptier
    if contraction:
        assert float(samples.from_density.detach().norm(dim=-1).median()) > 0.99


@pytest.mark.parametrize("backend", ["torch", "numba"])
def test_losses_on_the_normals_train_the_density(backend: Backend) -> None:
    """The gradient of a function of the density's normals, by differences of a table and of a weight."""
    model, rays = make_model(backend=backend, dtype=torch.float64), make_rays(4, torch.float64)
    pull = torch.randn(4, 8, 3, generator=torch.Generator().manual_seed(3), dtype=torch.float64)

    def loss() -> Tensor:
        samples = render(model, rays, normal_rays=4).normal_samples
        assert samples is not None
        return (pull * samples.from_density).sum()

    for parameter in (model.field.grid.table, model.field.density_network[0].weight):
        (gradient,) = torch.autograd.grad(loss(), parameter)
        place = divmod(int(gradient.abs().argmax()), parameter.shape[1])
        sides = []
        for step in (1e-6, -1e-6):
            with torch.no_grad():
                parameter[place] += step
            sides.append(loss().item())
            with torch.no_grad():
                parameter[place] -= step
        assert gradient[place].item() == pytest.approx((sides[0] - sides[1]) / 2e-6, rel=1e-4)


@pytest.mark.parametrize("shape", [False, True])
def test_losses_on_normals_reach_the_field_only_when_asked_to(shape: bool) -> None:
    model, weights = make_model(), LossWeights(normals_shape_density=shape)
    out = render(model, make_rays(6), normal_rays=6, normals_shape_density=shape)
    terms = loss_terms(out, torch.rand(6, 3), torch.ones(6), weights)
    (terms["normals"] + terms["orientation"]).backward()
    assert model.field.normal_network is not None
    moved = {
        name
        for name, value in model.named_parameters()
        if value.grad is not None and bool(value.grad.abs().max() > 0)
    }
    normals = {name for name in moved if name.startswith("field.normal_network")}
    assert normals and (moved > normals if shape else moved == normals)


def test_predicted_normals_are_unit_vectors() -> None:
    samples = render(make_model(), make_rays(6), normal_rays=6).normal_samples
    assert samples is not None
    torch.testing.assert_close(samples.predicted.norm(dim=-1), torch.ones(6, 8))


def test_normal_samples_are_those_of_the_first_rays_and_train_without_a_graph_around() -> None:
    model, rays = make_model(), make_rays(6)
    out = render(model, rays, normal_rays=2)
    with torch.no_grad():
        quiet = render(model, rays[:2], normal_rays=2)
    assert out.normal_samples is not None
    assert quiet.normal_samples is not None
    torch.testing.assert_close(out.normal_samples.directions, rays.directions[:2])
    torch.testing.assert_close(out.normal_samples.weights, out.histograms[-1].w[:2])
    torch.testing.assert_close(
        quiet.normal_samples.from_density, out.normal_samples.from_density, rtol=1e-3, atol=1e-4
    )


def test_what_the_ray_does_not_hit_has_the_colour_of_its_last_sample() -> None:
    """colour = sum w c + (1 - sum w) c_last: in empty space, the last sample's colour alone."""
    model, rays = make_model(), make_rays(5)
    with torch.no_grad():
        model.field.density_network[-1].bias[0] = -50
    out = render(model, rays)
    assert float(out.accumulation.detach().max()) < 1e-9
    t = s_to_t(out.histograms[-1].s, CONFIG.sampler)
    unit, ipe = frustum_features(rays, t, CONFIG.stretch, True, model.field.octaves)
    _, feature = model.field.density(unit)
    colours = model.field.colour(feature, ipe, rays.directions, model.appearance[rays.camera])
    torch.testing.assert_close(out.colour, colours[:, -1])


@pytest.mark.parametrize("backend", ["torch", "numba"])
def test_damping_changes_nothing_of_cones_without_width(backend: Backend) -> None:
    """And of others what a level's factor says: the wider, the less of the finest levels is left."""
    config = dataclasses.replace(CONFIG, field=dataclasses.replace(CONFIG.field, damping=True))
    damped, plain = (make_model(which, backend) for which in (config, CONFIG))
    rays = make_rays(7)
    colours = []
    for radius in (0.0, 1e-2, 5e-2):
        rays = dataclasses.replace(rays, radius=torch.full((7,), radius))
        a, b = (render(model, rays).colour.detach() for model in (damped, plain))
        assert torch.equal(a, b) == (radius == 0)
        colours.append(float((a - b).abs().mean()))
    assert colours[0] == 0 < colours[1] < colours[2]
    t = torch.linspace(0.1, 9, 9).expand(7, -1)
    unit, _ = frustum_features(rays, t, CONFIG.stretch, True, 0)
    narrow, wide = (
        damped.frustum_sizes(dataclasses.replace(rays, radius=rays.radius * factor), t, unit)
        for factor in (1, 8)
    )
    assert narrow is not None and wide is not None
    torch.testing.assert_close(wide, 4 * narrow, rtol=1e-4, atol=0)  # two axes of three


@pytest.mark.parametrize("encoding", ["ipe", "sh", "both"])
@pytest.mark.parametrize(("appearance", "normals"), [(5, True), (0, False)])
def test_every_variant_of_the_field_runs(encoding: str, appearance: int, normals: bool) -> None:
    field = dataclasses.replace(
        CONFIG.field, direction_encoding=encoding, appearance=appearance, normals=normals
    )
    model = make_model(dataclasses.replace(CONFIG, field=field))
    out = render(model, make_rays(6), normals=normals, normal_rays=3 if normals else 0)
    out.colour.sum().backward()
    assert model.field.grid.table.grad is not None
    assert bool(model.field.grid.table.grad.any())


def test_normals_of_a_model_without_them_are_refused() -> None:
    model = make_model(dataclasses.replace(CONFIG, field=dataclasses.replace(CONFIG.field, normals=False)))
    with pytest.raises(ConfigError, match="normals=False"):
        render(model, make_rays(2), normals=True)


def test_a_model_without_proposals_runs() -> None:
    sampler = SamplerConfig(proposals=(), final=8, far=100.0)
    out = render(make_model(dataclasses.replace(CONFIG, proposals=(), sampler=sampler)), make_rays(3))
    assert len(out.histograms) == 1


def test_rounds_without_fields_are_refused() -> None:
    with pytest.raises(ConfigError, match=r"sampler\.proposals has 2 rounds and proposals 1 fields"):
        dataclasses.replace(CONFIG, proposals=CONFIG.proposals[:1])


def test_a_stretch_of_nothing_is_refused() -> None:
    with pytest.raises(
        ConfigError, match=r"stretch of every axis must be above 0, but got \(1.0, 0.0, 1.0\)"
    ):
        dataclasses.replace(CONFIG, stretch=(1.0, 0.0, 1.0))


def test_the_mean_appearance_is_that_of_the_chosen_images() -> None:
    model = make_model()
    found = model.mean_appearance(3, torch.tensor([0, 2]))
    torch.testing.assert_close(found, ((model.appearance[0] + model.appearance[2]) / 2).expand(3, -1))
    # A new model has nothing learnt: the mean is every image's own.
    fresh = PLNeRF(CONFIG, IMAGES, "torch", torch.Generator().manual_seed(0))
    assert not fresh.appearance.any()


def test_a_model_is_a_function_of_its_generator() -> None:
    a, b, c = (
        PLNeRF(CONFIG, IMAGES, "torch", torch.Generator().manual_seed(seed)).state_dict()
        for seed in (0, 0, 1)
    )
    assert all(torch.equal(a[name], b[name]) for name in a)
    assert any(not torch.equal(a[name], c[name]) for name in a)
