"""The warp along a ray: its two directions are each other's inverse, and it keeps order."""

import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from plnerf.rays.warp import s_to_t, t_to_s, warp

RANGES = st.sampled_from([(0.03, 1000.0, 0.25), (0.03, 4.0, 0.25), (0.3, 1000.0, 0.25), (0.01, 0.2, 0.25)])
Range = tuple[float, float, float]


@given(RANGES, st.integers(0, 1000))
@settings(deadline=None)
def test_warped_distances_come_back(limits: Range, seed: int) -> None:
    s = torch.rand(200, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    s = torch.cat([s, torch.tensor([0.0, 1.0], dtype=torch.float64)])
    torch.testing.assert_close(t_to_s(s_to_t(s, *limits), *limits), s, atol=1e-9, rtol=0)


@given(RANGES, st.floats(0, 1))
@settings(deadline=None)
def test_distances_come_back(limits: Range, share: float) -> None:
    near, far, _ = limits
    t = torch.tensor([near * (far / near) ** share], dtype=torch.float64)
    torch.testing.assert_close(s_to_t(t_to_s(t, *limits), *limits), t, rtol=1e-9, atol=0)


@given(RANGES)
@settings(deadline=None)
def test_what_is_before_or_behind_the_range_is_at_its_ends(limits: Range) -> None:
    near, far, _ = limits
    t = torch.tensor([-5.0, 0.0, 0.5 * near, near, far, 2 * far, 1e9], dtype=torch.float64)
    s = t_to_s(t, *limits)
    torch.testing.assert_close(s, torch.tensor([0.0] * 4 + [1.0] * 3, dtype=torch.float64))
    assert s.min() >= 0 and s.max() <= 1


@given(RANGES)
@settings(deadline=None)
def test_order_is_kept_and_the_knee_is_no_step(limits: Range) -> None:
    near, far, knee = limits
    t = torch.logspace(0, 1, 2000, far / near, dtype=torch.float64) * near
    assert (t_to_s(t, *limits).diff() > 0).all()
    assert abs(warp(knee * (1 - 1e-9), knee) - warp(knee, knee)) < 1e-8
    around = torch.tensor([knee * (1 - 1e-6), knee, knee * (1 + 1e-6)], dtype=torch.float64)
    if near < knee < far:
        below, above = t_to_s(around, *limits).diff()
        assert abs(below / above - 1) < 1e-3  # as steep on both sides


def test_a_gradient_passes_both_ways() -> None:
    t = torch.tensor([0.1, 0.2, 0.3, 5.0], dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda t: t_to_s(t, 0.03, 1000.0, 0.25), t)
