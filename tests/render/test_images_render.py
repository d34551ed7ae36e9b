"""Whole views against closed forms: a plane's depth, its hit points, and the independence of chunks."""

import pytest
import torch
from tests.support.oracle import FAR, Oracle, one_camera, plane, tiny_config

from plnerf.errors import ConfigError, TrainingError
from plnerf.ops.backends import Backend
from plnerf.rays.rays import pixel_rays
from plnerf.render.model import PLNeRF
from plnerf.render.pruning import Pruning
from plnerf.render.views import default_chunk, render_view, resized
from plnerf.scene import memory
from plnerf.scene.cameras import project

LENS = (-0.08, 0.02, 0.001, -0.002, 0.0)
TURN = torch.linalg.matrix_exp(torch.tensor([[0.0, -0.3, 0.2], [0.3, 0.0, -0.5], [-0.2, 0.5, 0.0]]))


@pytest.mark.parametrize("distortion", [(0.0,) * 5, LENS])
def test_a_plane_across_the_axis_has_one_z_depth(distortion: tuple[float, ...]) -> None:
    camera = one_camera(TURN, (0.2, -0.1, 0.4), distortion=distortion)
    axis = TURN[:, 2]
    offset = float(axis @ camera.centre[0]) + 2.5
    view = render_view(Oracle(plane(axis, offset)), camera, torch.zeros(3), normals=True)
    z = torch.from_numpy(view.z_depth)
    torch.testing.assert_close(z, torch.full_like(z, 2.5), rtol=0, atol=1e-5)
    # Along the rays the plane is farther away, by the ray's slant alone.
    assert (view.depth_median >= 2.5 - 1e-5).all() and view.depth_median.max() > 2.7
    torch.testing.assert_close(torch.from_numpy(view.depth), 1.25 * torch.from_numpy(view.depth_median))
    torch.testing.assert_close(torch.from_numpy(view.normals), axis.expand(9, 13, 3))
    assert view.has_surface.all()


@pytest.mark.parametrize("distortion", [(0.0,) * 5, LENS])
def test_every_pixel_shows_the_point_that_projects_to_its_centre(distortion: tuple[float, ...]) -> None:
    camera = one_camera(TURN, distortion=distortion)
    axis = TURN[:, 2]

    def see(rays):  # type: ignore[no-untyped-def]  # as `plane`, moved into [0, 1], where colours are not clipped
        seen = plane(axis, 2.0)(rays)
        return type(seen)(seen.colour / 10 + 0.5, seen.t, seen.normal)

    view = render_view(Oracle(see), camera, torch.zeros(3), normals=False)
    pixels, _ = project(camera, (torch.from_numpy(view.rgb).reshape(-1, 3) - 0.5) * 10)
    rows, columns = torch.meshgrid(torch.arange(9), torch.arange(13), indexing="ij")
    centres = torch.stack([columns, rows], -1).reshape(-1, 2) + 0.5
    torch.testing.assert_close(pixels[0], centres, rtol=0, atol=2e-4)


def test_the_chunk_size_does_not_change_the_view() -> None:
    model = PLNeRF(tiny_config(), 2, "torch", torch.Generator().manual_seed(3)).eval()
    camera, vector = one_camera(), torch.tensor([0.3, -0.2, 0.1])
    whole = render_view(model, camera, vector, chunk_rays=1000, normals=True, deviation=True)
    assert whole.rgb.std() > 1e-4, "a view of one colour would not show anything"
    for chunk in (1, 7, 13 * 9 - 1):
        parts = render_view(model, camera, vector, chunk_rays=chunk, normals=True, deviation=True)
        for name in ("rgb", "accumulation", "depth", "depth_median", "z_depth", "normals", "depth_deviation"):
            a, b = (torch.from_numpy(getattr(v, name)) for v in (whole, parts))
            torch.testing.assert_close(a, b, rtol=1e-4, atol=1e-5, msg=lambda m, n=name: f"{n}: {m}")


@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
@pytest.mark.parametrize("backend", ["torch", "triton"])
@pytest.mark.parametrize("pruning", [None, Pruning()], ids=["exact", "pruned"])
def test_a_gpu_renders_what_a_cpu_renders(backend: Backend, pruning: Pruning | None) -> None:
    """Through a lens, in more than one chunk."""
    views = []
    for device, name in (("cpu", "torch"), ("cuda", backend)):
        model = PLNeRF(tiny_config(), 2, name, torch.Generator().manual_seed(3)).eval().to(device)
        view = render_view(
            model, one_camera(TURN, distortion=LENS), torch.tensor([0.3, -0.2, 0.1]),
            chunk_rays=50, normals=True, deviation=True, pruning=pruning,
        )  # fmt: skip
        views.append(view)
    assert views[0].rgb.std() > 1e-4
    for name in ("rgb", "accumulation", "depth", "depth_median", "z_depth", "normals", "depth_deviation"):
        a, b = (torch.from_numpy(getattr(view, name)) for view in views)
        torch.testing.assert_close(b, a, rtol=1e-4, atol=1e-5, msg=lambda m, n=name: f"{n}: {m}")


@pytest.mark.parametrize("value", [float("nan"), 3e38])
def test_a_view_that_is_not_finite_is_no_view(value: float) -> None:
    """Weights that are no numbers, and finite ones whose sums are infinity less infinity, in any order."""
    model = PLNeRF(tiny_config(), 2, "torch", torch.Generator().manual_seed(3)).eval()
    first, last = model.field.colour_network[0].weight, model.field.colour_network[-1].weight
    with torch.no_grad():
        # Whatever its inputs, every second unit overflows; of either half, units count with both signs.
        first.fill_(value)[1::2] *= -1
        last[0].fill_(value).view(-1, 4)[:, 2:] *= -1
    with pytest.raises(TrainingError, match="117 of the 117 pixels of a view are not finite"):
        render_view(model, one_camera(), torch.zeros(3), normals=False)


@pytest.mark.parametrize("factor", [3000.0, 1e20])
def test_views_that_do_not_fit_into_memory_are_refused(
    factor: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also sizes that no integer holds, which became views of one pixel."""
    monkeypatch.setattr(memory, "available_bytes", lambda: 8e9)
    assert resized(one_camera(), 1000.0).size_px.tolist() == [[13_000, 9_000]]
    with pytest.raises(ConfigError, match=r"pixels needs at least .* GB of memory, but 8\.0 GB are free"):
        resized(one_camera(), factor)


def test_no_chunk_is_larger_than_asked_for() -> None:
    model = Oracle(plane(torch.tensor([0.0, 0.0, 1.0]), 1.0))
    render_view(model, one_camera(), torch.zeros(3), chunk_rays=50, normals=False)
    assert model.chunks == [50, 50, 17]
    model.chunks.clear()
    render_view(model, one_camera(size=(60, 40)), torch.zeros(3), normals=False)
    assert sum(model.chunks) == 2400 and max(model.chunks) == default_chunk(model)


def test_colours_are_clipped_and_nothing_needs_gradients() -> None:
    model = Oracle(plane(torch.tensor([0.0, 0.0, 1.0]), 30.0))
    view = render_view(model, one_camera(), torch.zeros(3), normals=False)
    assert view.rgb.min() == 0.0 and view.rgb.max() == 1.0
    assert view.normals is None


def test_where_no_ray_ends_there_is_no_surface() -> None:
    model = Oracle(plane(torch.tensor([0.0, 0.0, 1.0]), -1.0))
    view = render_view(model, one_camera(), torch.zeros(3), normals=True)
    assert not view.has_surface.any() and (view.depth_median == FAR).all() and (view.normals == 0).all()


def test_the_appearance_vector_goes_to_every_ray() -> None:
    model = Oracle(plane(torch.tensor([0.0, 0.0, 1.0]), 1.0))
    vector = torch.tensor([1.0, 2.0, 3.0])
    render_view(model, one_camera(), vector, chunk_rays=40, normals=False)
    assert torch.equal(torch.cat(model.appearances), vector.expand(13 * 9, 3))


@pytest.mark.parametrize("factor", [0.5, 2.0, 1.3, 0.01])
def test_a_resized_camera_sees_the_same_between_its_edges(factor: float) -> None:
    camera = one_camera(TURN, distortion=LENS)
    other = resized(camera, factor)
    ratio = other.size_px / camera.size_px
    assert (other.size_px >= 1).all() and other.size_px.dtype == torch.int64
    pixels = torch.rand(50, 2, generator=torch.Generator().manual_seed(0)) * camera.size_px
    index = torch.zeros(50, dtype=torch.int64)
    a, b = pixel_rays(camera, index, pixels), pixel_rays(other, index, pixels * ratio)
    torch.testing.assert_close(a.directions, b.directions, rtol=0, atol=1e-5)


@pytest.mark.parametrize("factor", [0.0, -1.0, float("inf"), float("nan")])
def test_impossible_sizes_are_refused(factor: float) -> None:
    with pytest.raises(ConfigError, match="positive factor"):
        resized(one_camera(), factor)


def test_several_cameras_and_empty_chunks_are_refused() -> None:
    model, camera = Oracle(plane(torch.tensor([0.0, 0.0, 1.0]), 1.0)), one_camera()
    with pytest.raises(ConfigError, match="2 cameras"):
        render_view(model, camera[[0, 0]], torch.zeros(3), normals=False)
    with pytest.raises(ConfigError, match="0 rays"):
        render_view(model, camera, torch.zeros(3), chunk_rays=0, normals=False)
