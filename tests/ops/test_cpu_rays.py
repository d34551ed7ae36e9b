"""The CPU kernels of the rays' geometry are their references, whatever the rays, the type and the threads."""

import pytest
import torch
from torch import Tensor

from plnerf.field.encodings import integrated_positional_encoding
from plnerf.ops import cpu_rays, launch
from plnerf.rays.contraction import clamp_frustums, contract_frustums
from plnerf.rays.frustums import ray_frustums
from plnerf.rays.rays import Rays
from plnerf.rays.warp import s_to_t

STRETCH = (0.4, 2.0, 1.5)
DTYPES = pytest.mark.parametrize("dtype", [torch.float32, torch.float64], ids=str)
CONTRACTION = pytest.mark.parametrize("contraction", [True, False], ids=["contracted", "clamped"])


def make_rays(n: int, dtype: torch.dtype = torch.float64) -> Rays:
    generator = torch.Generator().manual_seed(0)
    origins, directions = torch.randn(2, n, 3, generator=generator, dtype=torch.float64)
    radius = 1e-3 + 5e-3 * torch.rand(n, generator=generator, dtype=torch.float64)
    unit = torch.nn.functional.normalize(directions, dim=-1)
    index = torch.zeros(n, dtype=torch.long)
    return Rays(origins.to(dtype), unit.to(dtype), radius.to(dtype), index)


def edges(n: int, intervals: int, dtype: torch.dtype = torch.float64) -> Tensor:
    """From near to 1000 away, some intervals without width."""
    s = torch.rand(n, intervals + 1, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    s = s.sort(-1).values
    s[::3, intervals // 2 :] = s[::3, intervals // 2, None]
    return s_to_t(s, 0.03, 1000.0, 0.25).to(dtype)


def truth(rays: Rays, t: Tensor, contraction: bool, octaves: int) -> tuple[Tensor, Tensor]:
    bound = contract_frustums if contraction else clamp_frustums
    mean, variance = bound(ray_frustums(rays, t), STRETCH)
    return (mean + 2) / 4, integrated_positional_encoding(mean, variance, octaves)


def kernel(rays: Rays, t: Tensor, contraction: bool, octaves: int) -> tuple[Tensor, Tensor]:
    return cpu_rays.frustum_features(
        rays.origins, rays.directions, rays.radius, t, STRETCH, contraction, octaves
    )


def in_double(rays: Rays) -> Rays:
    return Rays(rays.origins.double(), rays.directions.double(), rays.radius.double(), rays.camera)


@CONTRACTION
@pytest.mark.parametrize("octaves", [0, 1, 5, 6])
@pytest.mark.parametrize("intervals", [1, 24, 37])
def test_features_are_the_reference(contraction: bool, octaves: int, intervals: int) -> None:
    rays, t = make_rays(70), edges(70, intervals)
    unit, encoded = kernel(rays, t, contraction, octaves)
    assert unit.shape == (70, intervals, 3)
    assert encoded.shape == (70, intervals, 6 * octaves)
    true_unit, true_encoded = truth(rays, t, contraction, octaves)
    torch.testing.assert_close(unit, true_unit, atol=1e-14, rtol=0)
    torch.testing.assert_close(encoded, true_encoded, atol=1e-12, rtol=0)


@CONTRACTION
def test_features_in_single_precision_are_as_good_as_the_references(contraction: bool) -> None:
    """Both measured against double precision, from the same rounded rays."""
    rays, t = make_rays(500, torch.float32), edges(500, 24, torch.float32)
    exact = truth(in_double(rays), t.double(), contraction, 6)
    for found, single, double in zip(
        kernel(rays, t, contraction, 6), truth(rays, t, contraction, 6), exact, strict=True
    ):
        assert found.dtype == torch.float32
        error, error_of_truth = float((found - double).abs().max()), float((single - double).abs().max())
        assert error < 2 * error_of_truth + 5e-7


def test_encoding_is_within_six_ten_millionths_of_its_mean_and_variance() -> None:
    """Apart from what the rounding of the mean does: a ray on which all numbers are exact in float32."""
    rays = Rays(
        torch.zeros(1, 3), torch.tensor([[0.0, 1.0, 0.0]]), torch.zeros(1), torch.zeros(1, dtype=torch.long)
    )
    t = (torch.arange(65) / 64)[None].repeat_interleave(2, -1)[:, 1:-1]  # every second one has no width
    _, found = cpu_rays.frustum_features(
        rays.origins, rays.directions, rays.radius, t, (1.0, 1.0, 1.0), True, 10
    )
    position = rays.directions[:, None].double() * t[:, :-1, None].double()
    exact = integrated_positional_encoding(position, torch.zeros_like(position), 10)
    points = t.diff() == 0
    assert int(points.sum()) == 63
    torch.testing.assert_close(found[points].double(), exact[points], atol=6e-7, rtol=0)


def test_points_on_faces_and_ties_are_the_reference() -> None:
    """Means exactly on a face of the cube or on |x| = |y|, reached by intervals without width."""
    corner = torch.tensor([[1.0, 0.5, 0.2], [-1.0, 1.0, 0.0], [2.0, 2.0, 1.0], [1.0, 1.0, 1.0]])
    origins = (corner.double() - torch.tensor([1.0, 0.0, 0.0])).contiguous()
    rays = Rays(
        origins, torch.tensor([[1.0, 0.0, 0.0]], dtype=torch.float64).expand(4, -1),
        torch.full((4,), 0.01, dtype=torch.float64), torch.zeros(4, dtype=torch.long),
    )  # fmt: skip
    t = torch.ones(4, 2, dtype=torch.float64)
    mean, variance = contract_frustums(ray_frustums(rays, t))
    unit, encoded = cpu_rays.frustum_features(
        rays.origins, rays.directions, rays.radius, t, (1.0, 1.0, 1.0), True, 3
    )
    torch.testing.assert_close(unit, (mean + 2) / 4)
    torch.testing.assert_close(encoded, integrated_positional_encoding(mean, variance, 3))


@CONTRACTION
def test_features_are_finite_and_bounded_over_the_float_range(contraction: bool) -> None:
    ends = torch.cat([torch.zeros(1), torch.logspace(-30, 17, 48)])
    t0, t1 = torch.meshgrid(ends, ends, indexing="ij")
    t = torch.stack([t0[t0 <= t1], t1[t0 <= t1]], -1)
    rays = make_rays(len(t), torch.float32)
    unit, encoded = kernel(rays, t, contraction, 6)
    assert bool(((unit >= 0) & (unit <= 1)).all())
    assert bool((encoded.abs() <= 1 + 1e-6).all())


@DTYPES
@pytest.mark.parametrize("knee", [0.02, 0.25, 5000.0])
def test_distances_are_the_reference(knee: float, dtype: torch.dtype) -> None:
    s = torch.rand(20, 33, generator=torch.Generator().manual_seed(0), dtype=torch.float64).to(dtype)
    s[0, :2] = torch.tensor([0.0, 1.0])
    for edges_of in (s, s.t(), s[0], s[:0]):
        found = cpu_rays.s_to_t(edges_of, 0.05, 1000.0, knee)
        assert found.shape == edges_of.shape
        torch.testing.assert_close(
            found, s_to_t(edges_of, 0.05, 1000.0, knee), rtol=1e-6 if dtype == torch.float32 else 1e-13,
            atol=0,
        )  # fmt: skip


def test_distances_in_single_precision_are_increasing() -> None:
    t = cpu_rays.s_to_t(torch.linspace(0, 1, 257), 0.05, 1000.0, 1.0)
    assert bool((t.diff() > 0).all())
    assert t[-1].item() == pytest.approx(1000, rel=1e-5)


def test_results_do_not_depend_on_the_number_of_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    """Bit for bit."""
    rays, t = make_rays(101, torch.float32), edges(101, 24, torch.float32)
    alone = kernel(rays, t, True, 6)
    monkeypatch.setattr(launch, "_WORTH_WAKING_NS", 0)
    for parts in (2, 7):
        monkeypatch.setattr(launch, "num_threads", lambda parts=parts: parts)
        for a, b in zip(kernel(rays, t, True, 6), alone, strict=True):
            assert torch.equal(a, b)


def test_strided_inputs_and_no_rays_are_no_trouble() -> None:
    rays, t = make_rays(9, torch.float32), edges(9, 5, torch.float32)
    strided = Rays(
        rays.origins.t().contiguous().t(), rays.directions.t().contiguous().t(),
        rays.radius.repeat_interleave(2)[::2], rays.camera,
    )  # fmt: skip
    for a, b in zip(kernel(strided, t.t().contiguous().t(), True, 2), kernel(rays, t, True, 2), strict=True):
        assert torch.equal(a, b)
    unit, encoded = kernel(rays[:0], t[:0], True, 2)
    assert unit.shape == (0, 5, 3)
    assert encoded.shape == (0, 5, 12)


def test_gradients_that_would_be_lost_and_mixed_types_are_refused() -> None:
    rays, t = make_rays(2), edges(2, 3)
    moving = Rays(rays.origins.clone().requires_grad_(), rays.directions, rays.radius, rays.camera)
    with pytest.raises(NotImplementedError, match="kernel of frustum_features has no gradient by origins"):
        kernel(moving, t, True, 2)
    with torch.no_grad():
        kernel(moving, t, True, 2)
    with pytest.raises(NotImplementedError, match="kernel of s_to_t has no gradient by s"):
        cpu_rays.s_to_t(t.requires_grad_(), 0.1, 10.0, 1.0)
    with pytest.raises(TypeError, match="tensors of one type"):
        kernel(make_rays(2, torch.float32), t.detach(), True, 2)
