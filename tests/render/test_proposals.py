"""Sampling along rays: the warp is what it says, samples go where the density is, gradients stay out."""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from plnerf.errors import ConfigError
from plnerf.rays.histograms import dilate
from plnerf.rays.rays import Rays
from plnerf.rays.stepfun import resample_edges, stratified_levels
from plnerf.render.config import SamplerConfig
from plnerf.render.proposals import s_to_t, sample_along_rays
from plnerf.render.volume import weights_from_density

CONFIG = SamplerConfig(proposals=(64, 32), final=24, near=0.05, far=1000.0, knee=1.0)


def make_rays(n: int) -> Rays:
    directions = torch.nn.functional.normalize(
        torch.randn(n, 3, generator=torch.Generator().manual_seed(0)), dim=-1
    )
    return Rays(torch.zeros(n, 3), directions, torch.full((n,), 1e-3), torch.zeros(n, dtype=torch.long))


def wall(distance: float) -> Callable[[Rays, Tensor], Tensor]:
    """Density of a wall across every ray, at a distance give or take a fifth."""

    def density(rays: Rays, t: Tensor) -> Tensor:
        middle = (t[:, 1:] + t[:, :-1]) / 2
        return torch.where((middle - distance).abs() < 0.2 * distance, 100.0, 0.0)

    return density


@pytest.mark.parametrize("knee", [0.02, 1.0, 3.0, 5000.0])
def test_distances_run_from_near_to_far(knee: float) -> None:
    config = SamplerConfig(near=0.05, far=1000.0, knee=knee)
    t = s_to_t(torch.linspace(0, 1, 1001, dtype=torch.float64), config)
    assert t[0].item() == pytest.approx(0.05, rel=1e-6)
    assert t[-1].item() == pytest.approx(1000, rel=1e-6)
    assert bool((t.diff() > 0).all())


def test_distances_are_linear_up_to_the_knee_and_harmonic_beyond() -> None:
    t = s_to_t(torch.linspace(0, 1, 1001, dtype=torch.float64), CONFIG)
    below, beyond = t[t < 1], t[t > 1]
    np.testing.assert_allclose(below.diff(), below.diff()[0], rtol=1e-9)
    np.testing.assert_allclose((1 / beyond).diff(), (1 / beyond).diff()[0], rtol=1e-9)
    # Continuous and as steep on both sides of the knee; half of the range lies on either.
    assert below.diff()[-1].item() == pytest.approx(beyond.diff()[0].item(), rel=0.02)
    assert len(below) == pytest.approx(len(beyond), rel=0.1)


def test_distances_in_single_precision_are_increasing() -> None:
    t = s_to_t(torch.linspace(0, 1, 257), CONFIG)
    assert t.dtype == torch.float32
    assert t[-1].item() == pytest.approx(1000, rel=1e-5)
    assert bool((t.diff() > 0).all())


@pytest.mark.parametrize("seed", [None, 0], ids=["deterministic", "jittered"])
@pytest.mark.parametrize("distance", [0.4, 3.0, 6.0])
def test_a_wall_attracts_the_samples(distance: float, seed: int | None) -> None:
    generator = None if seed is None else torch.Generator().manual_seed(seed)
    s, history = sample_along_rays(make_rays(5), [wall(distance)] * 2, CONFIG, 1.0, generator)
    assert s.shape == (5, 25)
    assert bool((s.diff() > 0).all())
    assert 0 <= float(s.min()) <= float(s.max()) <= 1
    assert [h.s.shape for h in history] == [(5, 65), (5, 33)]
    assert [h.w.shape for h in history] == [(5, 64), (5, 32)]
    t = s_to_t(s, CONFIG)
    near = ((t - distance).abs() < 0.25 * distance).double().mean().item()
    even = s_to_t(torch.linspace(0, 1, 2001)[None], CONFIG)
    near_if_even = ((even - distance).abs() < 0.25 * distance).double().mean().item()
    assert near_if_even < 0.2 < 0.5 < near


def test_annealing_flattens_the_histogram() -> None:
    def wall_in_fog(rays: Rays, t: Tensor) -> Tensor:
        return wall(3.0)(rays, t) + 0.02

    shares = []
    for anneal in (0.05, 0.5, 1.0):
        s, _ = sample_along_rays(make_rays(1), [wall_in_fog] * 2, CONFIG, anneal, None)
        shares.append(((s_to_t(s, CONFIG) - 3).abs() < 0.75).double().mean().item())
    assert shares == sorted(shares)
    assert shares[-1] > shares[0] + 0.05


@pytest.mark.parametrize("anneal", [0.3, 1.0])
def test_samples_follow_the_annealed_weights_of_the_round_before(anneal: float) -> None:
    s, (first, second) = sample_along_rays(make_rays(2), [wall(3.0)] * 2, CONFIG, anneal, None)
    for before, found in ((first, second.s), (second, s)):
        u = stratified_levels(2, found.shape[1], None, s)
        torch.testing.assert_close(found, resample_edges(before.s, before.w**anneal, u, CONFIG.padding))
    t = s_to_t(first.s, CONFIG)
    torch.testing.assert_close(first.w, weights_from_density(wall(3.0)(make_rays(2), t), t))


def test_dilation_looks_beside_what_was_found_and_none_changes_nothing() -> None:
    """A round's samples are those of the dilated weights: more of them just before and behind a thin wall."""

    def sheet(rays: Rays, t: Tensor) -> Tensor:
        return torch.where((t[:, :-1] < 0.5) & (t[:, 1:] >= 0.5), 1e4, 0.0)

    shares = []
    for dilation in (0.0, 0.005, 0.02):
        config = dataclasses.replace(CONFIG, dilation=dilation)
        s, (first, second) = sample_along_rays(make_rays(2), [sheet] * 2, config, 0.7, None)
        u = stratified_levels(2, 33, None, s)
        looked = dilate(first.s, first.w, dilation) if dilation else first.w
        assert torch.equal(second.s, resample_edges(first.s, looked, u, CONFIG.padding, 0.7))
        hit = int(first.w[0].argmax())
        low, high = float(first.s[0, hit]), float(first.s[0, hit + 1])
        beside = ((second.s > low - 0.02) & (second.s < low)) | ((second.s > high) & (second.s < high + 0.02))
        shares.append(beside.double().mean().item())
    assert shares[0] < shares[1] < shares[2]


def test_samples_are_deterministic_without_a_generator_and_a_function_of_its_seed_with_one() -> None:
    def edges(generator: torch.Generator | None) -> Tensor:
        return sample_along_rays(make_rays(3), [wall(3.0)] * 2, CONFIG, 1.0, generator)[0]

    assert torch.equal(edges(None), edges(None))
    seeds = [edges(torch.Generator().manual_seed(seed)) for seed in (0, 0, 1)]
    assert torch.equal(seeds[0], seeds[1])
    assert not torch.equal(seeds[0], seeds[2])


def test_only_the_weights_carry_a_gradient() -> None:
    """The samples themselves never do: only the interlevel loss trains a proposal."""
    scale = torch.ones((), requires_grad=True)

    def density(rays: Rays, t: Tensor) -> Tensor:
        return scale * torch.ones(len(rays), t.shape[1] - 1)

    s, history = sample_along_rays(make_rays(2), [density, density], CONFIG, 1.0, None)
    assert all(h.w.requires_grad for h in history)
    assert not s.requires_grad
    assert not any(h.s.requires_grad for h in history)


def test_without_proposals_samples_are_even() -> None:
    config = SamplerConfig(proposals=(), final=10)
    s, history = sample_along_rays(make_rays(2), [], config, 1.0, None)
    torch.testing.assert_close(s, torch.linspace(0, 1, 11).expand(2, -1))
    assert history == ()


@pytest.mark.parametrize(
    "bad",
    [
        {"near": 0.0},
        {"near": 5.0, "far": 5.0},
        {"knee": 0.0},
        {"final": 0},
        {"padding": 0.0},
        {"dilation": -0.1},
        {"proposals": (64, 0)},
    ],
    ids=str,
)
def test_a_sampler_that_cannot_be_is_refused(bad: dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match="A sampler needs 0 < near < far") as caught:
        SamplerConfig(**bad)
    name, value = next(iter(bad.items()))
    assert f"{name}={value}" in str(caught.value)
