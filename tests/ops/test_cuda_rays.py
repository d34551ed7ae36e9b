"""The Triton kernels on rays are the references: interpreted on a CPU, or run on a GPU where there is one."""

from collections.abc import Callable

import pytest
import torch
from tests.ops.test_cpu_rays import STRETCH, edges, in_double, make_rays, truth
from tests.ops.test_cpu_stepfun import histograms, levels, with_gradient
from tests.ops.test_cpu_volume import inputs, with_gradients
from tests.ops.test_cpu_volume import truth as true_rendering
from torch import Tensor

from plnerf.ops import cuda_rays, cuda_stepfun, cuda_volume
from plnerf.rays import stepfun
from plnerf.rays.rays import Rays
from plnerf.rays.warp import s_to_t
from plnerf.render import volume

DTYPES = pytest.mark.parametrize("dtype", [torch.float32, torch.float64], ids=str)
RENDERED = pytest.mark.parametrize(
    "case", ["random", "empty", "opaque", "thin", "no width", "one interval", "far away", "no rays"]
)
STEPPED = pytest.mark.parametrize(
    "case", ["random", "no weight", "all in one", "no width", "one interval", "same edges", "no rays"]
)


def some(*tensors: Tensor, device: str) -> list[Tensor]:
    """Interpreted, a program takes milliseconds: of fifty rays the first few are looked at."""
    return [tensor[: 6 if device == "cpu" else None].to(device) for tensor in tensors]


def assert_close(found: list[Tensor], expected: list[Tensor], tolerance: float) -> None:
    """Relative to the largest value, or to 1."""
    for a, b in zip(found, expected, strict=True):
        assert a.dtype == b.dtype
        scale = max(1.0, float(b.abs().max())) if b.numel() else 1.0
        torch.testing.assert_close(a, b, atol=tolerance * scale, rtol=0)


@pytest.mark.filterwarnings("ignore:.*encountered in:RuntimeWarning")  # NumPy's, of the interpreter
@RENDERED
@DTYPES
def test_rendering_is_the_reference(case: str, dtype: torch.dtype, device: str) -> None:
    given = some(*inputs(case, dtype), device=device)
    expected = with_gradients(true_rendering, *given)
    tolerance = 5e-6 if dtype == torch.float32 else 1e-13
    assert_close(with_gradients(cuda_volume.render_rays, *given), expected, tolerance)


@pytest.mark.filterwarnings("ignore:.*encountered in:RuntimeWarning")
@RENDERED
@DTYPES
def test_weights_are_the_reference(case: str, dtype: torch.dtype, device: str) -> None:
    sigma, t, colours = some(*inputs(case, dtype), device=device)

    def weights(of: Callable[[Tensor, Tensor], Tensor]) -> list[Tensor]:
        return with_gradients(lambda sigma, t, _: (of(sigma, t),), sigma, t, colours, outputs=(0,))[:2]

    tolerance = 5e-6 if dtype == torch.float32 else 1e-13
    assert_close(weights(cuda_volume.weights_from_density), weights(volume.weights_from_density), tolerance)


@pytest.mark.parametrize("outputs", [(0,), (1,), (2,)], ids=str)
def test_each_output_has_the_truth_s_gradient_alone(outputs: tuple[int, ...], device: str) -> None:
    given = some(*inputs("random"), device=device)
    expected = with_gradients(true_rendering, *given, outputs=outputs)
    assert_close(with_gradients(cuda_volume.render_rays, *given, outputs=outputs), expected, 1e-13)


@pytest.mark.filterwarnings("ignore:.*encountered in:RuntimeWarning")
def test_infinite_density_stops_the_ray_and_not_a_number_is_not_hidden(device: str) -> None:
    sigma = torch.tensor([[0.5, float("inf"), 0.5, float("inf")], [0.5, float("nan"), 0.5, 1.0]])
    t = torch.tensor([[1.0, 2.0, 3.0, 4.0, 5.0]]).repeat(2, 1)
    colours = torch.rand(2, 4, 3, generator=torch.Generator().manual_seed(0))
    found = with_gradients(cuda_volume.render_rays, *(value.to(device) for value in (sigma, t, colours)))
    expected = with_gradients(true_rendering, sigma, t, colours)
    for a, b in zip(found[:5], expected, strict=False):
        torch.testing.assert_close(a[0].cpu(), b[0], atol=1e-6, rtol=0)
    assert all(bool(value[0].isfinite().all()) for value in found)
    assert bool(found[1][1].isnan().all())


@STEPPED
@DTYPES
@pytest.mark.parametrize("anneal", [1.0, 0.3])
def test_resampling_is_the_reference(case: str, dtype: torch.dtype, anneal: float, device: str) -> None:
    s, w, u = some(*histograms(case, 37, 0, dtype), levels(case, 25, dtype), device=device)
    exponent = torch.tensor(anneal, dtype=dtype, device=device)
    found = cuda_stepfun.resample_edges(s, w.requires_grad_(), u, 0.03, exponent)
    assert found.shape == u.shape
    assert not found.requires_grad
    expected = stepfun.resample_edges(s, w.detach(), u, 0.03, anneal)
    assert_close([found], [expected], 3e-5 if dtype == torch.float32 else 1e-12)
    assert bool((found.diff() >= 0).all())
    assert torch.equal(found, cuda_stepfun.resample_edges(s, w, u, 0.03, anneal)) or dtype == torch.float64


@STEPPED
@pytest.mark.parametrize("proposal_intervals", [1, 24, 64])
def test_interlevel_loss_is_the_reference(case: str, proposal_intervals: int, device: str) -> None:
    given = (*histograms(case, 24, 2, torch.float64), *histograms(case, proposal_intervals, 3, torch.float64))
    s, w, other, w_other = some(*given, device=device)
    found, expected = (
        with_gradient(lambda w_other, of=of: of(s, w, other, w_other), w_other)
        for of in (cuda_stepfun.interlevel_loss, stepfun.interlevel_loss)
    )
    assert_close(found, expected, 1e-12)


@STEPPED
@DTYPES
def test_distortion_loss_is_the_reference(case: str, dtype: torch.dtype, device: str) -> None:
    s, w = some(*histograms(case, 37, 4, dtype), device=device)
    found, expected = (
        with_gradient(lambda w, of=of: of(s, w), w)
        for of in (cuda_stepfun.distortion_loss, stepfun.distortion_loss)
    )
    assert_close(found, expected, 3e-6 if dtype == torch.float32 else 1e-13)


def kernel(rays: Rays, t: Tensor, contraction: bool, octaves: int) -> tuple[Tensor, Tensor]:
    return cuda_rays.frustum_features(
        rays.origins, rays.directions, rays.radius, t, STRETCH, contraction, octaves
    )


@pytest.mark.parametrize("contraction", [True, False], ids=["contracted", "clamped"])
@pytest.mark.parametrize(("intervals", "octaves"), [(1, 0), (24, 6), (37, 3)])
def test_features_are_the_reference(contraction: bool, intervals: int, octaves: int, device: str) -> None:
    rays, t = make_rays(30).to(torch.device(device)), edges(30, intervals).to(device)
    unit, encoded = kernel(rays, t, contraction, octaves)
    assert encoded.shape == (30, intervals, 6 * octaves)
    expected = truth(rays, t, contraction, octaves)
    torch.testing.assert_close(unit, expected[0], atol=1e-14, rtol=0)
    torch.testing.assert_close(encoded, expected[1], atol=1e-12, rtol=0)


def test_features_in_single_precision_are_as_good_as_the_references(device: str) -> None:
    """Both measured against double precision, from the same rounded rays."""
    rays = make_rays(100, torch.float32).to(torch.device(device))
    t = edges(100, 24, torch.float32).to(device)
    exact = truth(in_double(rays), t.double(), True, 6)
    for found, single, double in zip(
        kernel(rays, t, True, 6), truth(rays, t, True, 6), exact, strict=True
    ):  # fmt: skip
        error, error_of_truth = float((found - double).abs().max()), float((single - double).abs().max())
        assert error < 2 * error_of_truth + 5e-7


@DTYPES
@pytest.mark.parametrize("knee", [0.02, 0.25, 5000.0])
def test_distances_are_the_reference(knee: float, dtype: torch.dtype, device: str) -> None:
    s = torch.rand(20, 33, generator=torch.Generator().manual_seed(0), dtype=torch.float64).to(dtype)
    s[0, :2] = torch.tensor([0.0, 1.0])
    for edges_of in (s.to(device), s.t().to(device), s[:0].to(device)):
        found = cuda_rays.s_to_t(edges_of, 0.05, 1000.0, knee)
        rtol = 1e-6 if dtype == torch.float32 else 1e-13
        torch.testing.assert_close(found, s_to_t(edges_of, 0.05, 1000.0, knee), rtol=rtol, atol=0)


def test_no_rays_strided_inputs_and_mixed_types(device: str) -> None:
    rays, t = make_rays(9, torch.float32).to(torch.device(device)), edges(9, 5, torch.float32).to(device)
    strided = Rays(
        rays.origins.t().contiguous().t(), rays.directions.t().contiguous().t(),
        rays.radius.repeat_interleave(2)[::2], rays.camera,
    )  # fmt: skip
    for a, b in zip(kernel(strided, t.t().contiguous().t(), True, 2), kernel(rays, t, True, 2), strict=True):
        assert torch.equal(a, b)
    assert kernel(rays[:0], t[:0], True, 2)[1].shape == (0, 5, 12)
    with pytest.raises(TypeError, match="tensors of one type"):
        kernel(rays, t.double(), True, 2)
    with pytest.raises(NotImplementedError, match="kernel of s_to_t has no gradient by s"):
        cuda_rays.s_to_t(t.requires_grad_(), 0.1, 10.0, 1.0)
