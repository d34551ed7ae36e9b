"""Pruned rendering: exact where nothing is left out, off by what differs within groups where something is."""

from dataclasses import replace
from pathlib import Path

import numba
import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from tests.support.oracle import one_camera

from plnerf.errors import ConfigError
from plnerf.field.config import DensityConfig, RadianceConfig, TubeConfig
from plnerf.field.guides import Guides
from plnerf.field.radiance import FIRST_COLOURS
from plnerf.ops.backends import Backend
from plnerf.ops.grid import GridShape
from plnerf.rays.rays import Rays
from plnerf.render import field_samples, field_samples_cpu
from plnerf.render.config import ModelConfig, SamplerConfig
from plnerf.render.field_samples import heaviest
from plnerf.render.model import PLNeRF
from plnerf.render.pruning import Pruning, can_prune, is_fused, render_pruned
from plnerf.render.ray_ops import ray_ops
from plnerf.render.views import RenderedView, default_chunk, render_view
from plnerf.scene.scene import Scene, load_scene
from plnerf.train.config import TrainConfig
from plnerf.train.loop import set_learning_rates
from plnerf.train.optimizer import build_optimizer
from plnerf.train.pixels import PixelSampler
from plnerf.train.step import NonFiniteMonitor, Training

COLUMNS = ("rgb", "accumulation", "depth", "depth_median", "z_depth", "normals")

BASE = ModelConfig(
    field=RadianceConfig(GridShape(5, 4, 48, 4, 10), hidden=32, appearance=3),
    proposals=(
        DensityConfig(GridShape(3, 4, 16, 2, 9), hidden=16),
        DensityConfig(GridShape(3, 4, 32, 2, 9), hidden=8),
    ),
    sampler=SamplerConfig(proposals=(40, 24), final=24),
    stretch=(0.5, 1.0, 2.0),
)
# Sizes that leave remainders in every loop, and every switch of the field turned.
ODD = ModelConfig(
    field=RadianceConfig(
        GridShape(3, 3, 20, 4, 8, "cubic"), hidden=13, feature=6, colour_layers=3, direction_encoding="both",
        ipe_octaves=5, appearance=0,
    ),
    proposals=(DensityConfig(GridShape(2, 4, 16, 2, 9, "cubic"), hidden=5),),
    sampler=SamplerConfig(proposals=(11,), final=7),
    contraction=False,
)  # fmt: skip
DAMPED = replace(BASE, field=replace(BASE.field, damping=True))
BARE = replace(
    ODD, field=replace(ODD.field, colour_layers=1, direction_encoding="sh", feature=1, normals=False)
)


def make_model(config: ModelConfig = BASE, backend: Backend = "numba") -> PLNeRF:
    """Fog of all densities and colours: tables and last layers so large that space is not uniform."""
    model = PLNeRF(config, 2, backend, torch.Generator().manual_seed(5)).eval()
    with torch.no_grad():
        for grid in (model.field.grid, *(proposal.grid for proposal in model.proposals)):
            grid.table *= 1e4
        for network in (model.field.density_network, *(field.network for field in model.proposals)):
            network[-1].weight[0] *= 2
        model.field.colour_network[-1].weight /= FIRST_COLOURS
    return model


def make_rays(count: int, dtype: torch.dtype) -> Rays:
    generator = torch.Generator().manual_seed(2)
    origins, directions = torch.randn(2, count, 3, generator=generator, dtype=dtype)
    directions = torch.nn.functional.normalize(directions, dim=-1)
    radius = torch.full((count,), 2e-3, dtype=dtype)
    return Rays(origins, directions, radius, torch.zeros(count, dtype=torch.int64))


def see(model: PLNeRF, pruning: Pruning | None, **options: int) -> RenderedView:
    vector = torch.tensor([0.3, -0.2, 0.1])[: model.config.field.appearance]
    camera = one_camera(centre=(0.1, 0.2, -0.4), size=(41, 23), focal=30.0)
    normals = model.config.field.normals
    return render_view(model, camera, vector, normals=normals, pruning=pruning, **options)


def agreement_db(a: RenderedView, b: RenderedView) -> float:
    return float(-10 * np.log10(np.square(a.rgb.astype(float) - b.rgb).mean() + 1e-20))


weights = st.lists(
    st.one_of(st.just(0.0), st.floats(1e-6, 1.0), st.floats(1e-3, 0.05)), min_size=1, max_size=30
)
budgets = st.one_of(st.floats(0.01, 0.9), st.just(1 / 24))


@given(weights, budgets)
def test_groups_are_neighbours_led_by_the_heaviest(found: list[float], budget: float) -> None:
    """By brute force over the definition."""
    w = torch.tensor([found], dtype=torch.float64)
    w = w / max(1.0, float(w.sum()) * 1.0001)
    leaders = heaviest(w, budget)[0]
    own = w[0].clone()
    own[-1] += 1 - own.sum()
    middles = own.cumsum(0) - own / 2
    slots = [int(np.floor(float(m) / budget + 1e-12)) for m in middles]
    sure = all(abs(float(m) / budget - round(float(m) / budget)) > 1e-9 for m in middles)
    if sure:  # rounding decides nothing
        for i, slot in enumerate(slots):
            group = [j for j, other in enumerate(slots) if other == slot]
            assert int(leaders[i]) == max(group, key=lambda j: (float(own[j]), -j))
    assert bool((leaders.diff() >= 0).all())
    assert torch.equal(leaders[leaders], leaders)
    assert len(leaders.unique()) <= 1 / budget + 1.001
    assert torch.equal(heaviest(w, 0.0)[0], torch.arange(len(found)))


@pytest.mark.slow
@pytest.mark.parametrize("config", [BASE, ODD, BARE], ids=["base", "odd", "bare"])
@pytest.mark.parametrize("budget", [0.0, 0.05, 0.3])
def test_the_fused_kernels_are_the_equations(config: ModelConfig, budget: float) -> None:
    model, rays = make_model(config).double(), make_rays(61, torch.float64)
    t = 0.05 + torch.rand(
        61, config.sampler.final + 1, generator=torch.Generator().manual_seed(7), dtype=torch.float64
    ).cumsum(-1).mul(0.15)
    vectors = torch.randn(61, config.field.appearance, dtype=torch.float64)
    normals = config.field.normals
    with torch.no_grad():
        for field in model.proposals:
            a, b = (module.densities(model, field, rays, t) for module in (field_samples, field_samples_cpu))
            torch.testing.assert_close(a, b, rtol=1e-9, atol=0)
        a, b = (
            module.sample_field(model, rays, t, vectors, None, weight_budget=budget, normals=normals)
            for module in (field_samples, field_samples_cpu)
        )
    torch.testing.assert_close(b.density, a.density, rtol=1e-9, atol=0)
    torch.testing.assert_close(b.colours, a.colours, rtol=0, atol=1e-9)
    assert a.computed == b.computed
    assert (a.computed == a.density.numel()) == (budget == 0)
    assert (a.normals is None) == (b.normals is None) == (not normals)
    if normals:
        assert a.normals is not None and b.normals is not None
        torch.testing.assert_close(b.normals, a.normals, rtol=0, atol=1e-9)


@pytest.mark.parametrize("backend", ["torch", "numba"])
def test_all_intervals_of_a_group_have_the_colour_of_its_heaviest(backend: Backend) -> None:
    model, rays = make_model(backend=backend), make_rays(50, torch.float32)
    options = {"appearance": torch.randn(50, 3), "normals": True}
    module = field_samples_cpu if backend == "numba" else field_samples
    with torch.no_grad():
        t = torch.linspace(0.05, 3, 25).expand(50, -1).contiguous()
        whole, pruned = (
            module.sample_field(
                model, rays, t, options["appearance"], None, weight_budget=budget, normals=True
            )
            for budget in (0.0, 0.1)
        )
        w = ray_ops(backend).weights_from_density(whole.density, t)
    leaders = heaviest(w, 0.1)[..., None].expand(-1, -1, 3)
    same = (whole.colours.gather(1, leaders) - pruned.colours).abs().amax(-1)
    assert whole.colours.std() > 0.02
    # The last bit of a sum may put an interval into the next group.
    assert float((same > 1e-6).float().mean()) < 0.01
    assert torch.equal(whole.density, pruned.density)


@pytest.mark.parametrize("config", [BASE, ODD, BARE, DAMPED], ids=["base", "odd", "bare", "damped"])
@pytest.mark.parametrize("backend", ["torch", "numba"])
def test_leaving_nothing_out_is_the_exact_view(config: ModelConfig, backend: Backend) -> None:
    model = make_model(config, backend)
    exact, pruned = see(model, None), see(model, Pruning(0.0))
    assert exact.rgb.std() > 0.02
    assert exact.coloured == pruned.coloured == 1.0
    for name in COLUMNS[: 6 if config.field.normals else 5]:
        a, b = (getattr(view, name) for view in (exact, pruned))
        np.testing.assert_allclose(a, b, rtol=2e-3, atol=2e-4, err_msg=name)
    assert agreement_db(exact, pruned) > 80


@pytest.mark.parametrize("backend", ["torch", "numba"])
def test_pruning_skips_most_colours_and_shows_the_same(backend: Backend) -> None:
    model = make_model(replace(BASE, sampler=replace(BASE.sampler, final=64)), backend)
    exact, pruned = see(model, None), see(model, Pruning())
    assert pruned.coloured < 0.5
    assert agreement_db(exact, pruned) > 40
    np.testing.assert_allclose(pruned.depth, exact.depth, rtol=2e-3)
    assert see(model, Pruning(0.2)).coloured < pruned.coloured < see(model, Pruning(0.01)).coloured


def test_depth_does_not_depend_on_what_is_left_out() -> None:
    model = make_model()
    views = [see(model, Pruning(budget)) for budget in (0.0, 0.04, 0.5)]
    for view in views[1:]:
        for name in ("accumulation", "depth", "depth_median", "z_depth"):
            assert np.array_equal(getattr(view, name), getattr(views[0], name))
        assert not np.array_equal(view.rgb, views[0].rgb)


def test_neither_chunks_nor_threads_change_a_bit() -> None:
    model = make_model()
    whole = see(model, Pruning(), chunk_rays=41 * 23)
    threads = numba.get_num_threads()
    try:
        views = [see(model, Pruning(), chunk_rays=chunk) for chunk in (1, 13, 500)]
        numba.set_num_threads(1)
        views.append(see(model, Pruning()))
    finally:
        numba.set_num_threads(threads)
    for view in views:
        assert view.coloured == whole.coloured
        for name in COLUMNS:
            # torch's own products of matrices may round otherwise for other numbers of rows.
            np.testing.assert_allclose(getattr(view, name), getattr(whole, name), rtol=1e-5, atol=1e-6)


def test_backends_prune_the_same() -> None:
    a, b = (see(make_model(backend=backend), Pruning()) for backend in ("torch", "numba"))
    assert agreement_db(a, b) > 60
    assert a.coloured == pytest.approx(b.coloured, abs=1e-3)


def test_points_that_are_not_numbers_end_in_no_crash() -> None:
    model = make_model()
    with torch.no_grad():
        model.field.grid.table.fill_(torch.nan)
    rays = make_rays(20, torch.float32)
    out = render_pruned(model, rays, appearance=torch.zeros(20, 3), pruning=Pruning(), normals=True)
    assert bool(out.seen.colour.isnan().all())


def test_what_cannot_be_is_refused() -> None:
    for budget in (-0.1, 1.0, float("nan")):
        with pytest.raises(ConfigError, match="0 or more and below 1"):
            Pruning(budget)
    model, rays = make_model(BARE), make_rays(3, torch.float32)
    with pytest.raises(ConfigError, match="predicts no normals"):
        render_pruned(model, rays, appearance=torch.zeros(3, 0), pruning=Pruning(), normals=True)


def test_fused_chunks_are_larger() -> None:
    model = make_model()
    assert default_chunk(model, Pruning()) > default_chunk(model) == default_chunk(model, None)
    for other in (make_model(backend="torch"), make_model(DAMPED)):
        assert default_chunk(other, Pruning()) == default_chunk(model)


def trained_with_tubes(scene_folder: Path, folder: Path) -> tuple[PLNeRF, Scene]:
    """Sixty steps on the tiny scene, with one curve right through the ball."""
    scene = load_scene(scene_folder, store=folder / "pixels")
    x, y, z = scene.frames.to_scene(np.array([[0.0, 0.0, 0.5]]))[0]
    rows = ([[x, y]], [[1.0, 0.0]], [[0.0] * 3], [[z, 0.0, 0.0]], [[-0.4, 0.4]], [0.1])
    guides = Guides(*(torch.tensor(row, dtype=torch.float32) for row in rows))
    config = replace(
        BASE, tubes=TubeConfig(GridShape(levels=2, coarsest=32, finest=64, features=4, log2_table=10)),
        sampler=SamplerConfig(proposals=(24, 16), final=24), stretch=(1.0, 1.0, 1.0),
    )  # fmt: skip
    model = PLNeRF(config, len(scene.names), "numba", torch.Generator().manual_seed(0), guides)
    train = TrainConfig(rays=256, normal_rays=16, warmup_steps=10, anneal_steps=20)
    optimizer = build_optimizer(model, train)
    training = Training(model, optimizer, scene.cameras, train, NonFiniteMonitor(torch.device("cpu")))
    sampler = PixelSampler(scene.images, scene.train)
    for step in range(60):
        set_learning_rates(optimizer, train, step, step / 60)
        generator = torch.Generator().manual_seed(step)
        training.step(sampler.draw(train.rays, generator), min(1.0, (step + 1) / 20), generator)
    return model.eval(), scene


@pytest.mark.slow
def test_models_with_tubes_are_pruned_too(tiny_scene: Path, tmp_path: Path) -> None:
    """Densities, feature vectors and so colours of the tubes' own, whichever code samples the fields."""
    model, scene = trained_with_tubes(tiny_scene, tmp_path)
    assert can_prune(model) and is_fused(model)

    def view(pruning: Pruning | None) -> RenderedView:
        vector = model.appearance.detach().mean(0)
        return render_view(model, scene.cameras[[0]], vector, normals=True, pruning=pruning)

    exact, whole, pruned = view(None), view(Pruning(0.0)), view(Pruning())
    assert agreement_db(exact, whole) > 80
    assert agreement_db(exact, pruned) > 40
    assert pruned.coloured < 0.95  # sixty steps leave much haze
    np.testing.assert_allclose(pruned.depth, exact.depth, rtol=2e-3)
    for backend in ("numba", "torch"):
        same = PLNeRF(model.config, len(scene.names), backend, torch.Generator(), model.guides).eval()
        same.load_state_dict(model.state_dict())
        vector = model.appearance.detach().mean(0)
        other = render_view(same, scene.cameras[[0]], vector, normals=True, pruning=Pruning())
        assert agreement_db(pruned, other) > 60
    model.tubes = None
    assert agreement_db(exact, view(Pruning(0.0))) < 40  # the tubes are in the picture
