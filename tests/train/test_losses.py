"""Losses: each is zero where it should be and only there, weighted by name, unbiased under importance."""

import dataclasses
from typing import Any

import pytest
import torch
from torch import Tensor

from plnerf.errors import ConfigError
from plnerf.rays.histograms import blurred_interlevel_loss
from plnerf.rays.stepfun import distortion_loss, interlevel_loss
from plnerf.render.proposals import Histogram
from plnerf.render.system import NormalSamples, RenderedRays
from plnerf.train.config import LossWeights
from plnerf.train.losses import loss_terms, normal_loss, orientation_loss

R, S, Q = 6, 5, 4
ONE = torch.ones(R)


def unit(*shape: int, seed: int) -> Tensor:
    return torch.nn.functional.normalize(
        torch.randn(*shape, 3, generator=torch.Generator().manual_seed(seed)), dim=-1
    )


def histogram(intervals: int, seed: int) -> Histogram:
    generator = torch.Generator().manual_seed(seed)
    s = torch.rand(R, intervals + 1, generator=generator).sort(-1).values
    w = torch.rand(R, intervals, generator=generator)
    return Histogram(s, 0.8 * w / w.sum(-1, keepdim=True))


def samples() -> NormalSamples:
    weights = torch.rand(Q, S, generator=torch.Generator().manual_seed(0)) / S
    return NormalSamples(weights, unit(Q, S, seed=1), unit(Q, S, seed=2), unit(Q, seed=3))


def rendered(normal_samples: NormalSamples | None) -> RenderedRays:
    colour = torch.rand(R, 3, generator=torch.Generator().manual_seed(4))
    return RenderedRays(
        colour, ONE * 0.8, ONE, ONE, None, (histogram(8, 5), histogram(6, 6), histogram(S, 7)), normal_samples
    )


def test_terms_are_their_losses_times_their_weights() -> None:
    out, truth = rendered(samples()), torch.zeros(R, 3)
    weights = LossWeights(colour=1.5, interlevel=0.7, distortion=0.3, normals=0.2, orientation=0.1)
    terms = loss_terms(out, truth, ONE, weights)
    first, second, final = out.histograms
    between = sum(interlevel_loss(final.s, final.w, h.s, h.w).mean() for h in (first, second))
    assert out.normal_samples is not None
    expected = {
        "colour": 1.5 * (out.colour**2).mean(),
        "interlevel": 0.7 * between,
        "distortion": 0.3 * distortion_loss(final.s, final.w).mean(),
        "normals": 0.2 * normal_loss(out.normal_samples).mean(),
        "orientation": 0.1 * orientation_loss(out.normal_samples).mean(),
    }
    assert terms.keys() == expected.keys()
    for name, value in expected.items():
        torch.testing.assert_close(terms[name], value)
        assert value > 0


@pytest.mark.parametrize("name", ["colour", "interlevel", "distortion", "normals", "orientation"])
def test_a_weight_of_zero_turns_its_term_off_alone(name: str) -> None:
    out, truth = rendered(samples()), torch.zeros(R, 3)
    terms = loss_terms(out, truth, ONE, dataclasses.replace(LossWeights(), **{name: 0.0}))
    assert float(terms.pop(name, torch.zeros(()))) == 0
    assert all(value > 0 for value in terms.values())
    assert len(terms) == 4


@pytest.mark.parametrize("blur", [(0.03, 0.003), (0.0, 0.0)])
def test_the_interlevel_loss_may_be_the_anti_aliased_one(blur: tuple[float, float]) -> None:
    out = rendered(None)
    *rounds, final = out.histograms
    expected = sum(
        blurred_interlevel_loss(final.s, final.w, h.s, h.w, r).mean()
        for h, r in zip(rounds, blur, strict=True)
    )
    weights = LossWeights(interlevel=0.7, interlevel_blur=blur)
    found = loss_terms(out, torch.zeros(R, 3), ONE, weights)["interlevel"]
    torch.testing.assert_close(found, 0.7 * expected)
    assert found > 0


@pytest.mark.parametrize("bad", [{"distortion": -1.0}, {"interlevel_blur": (0.03, -0.003)}])
def test_negative_weights_are_refused(bad: dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match="0 or more"):
        LossWeights(**bad)


def test_terms_without_their_data_are_left_out() -> None:
    terms = loss_terms(rendered(None), torch.zeros(R, 3), ONE, LossWeights())
    assert terms.keys() == {"colour", "interlevel", "distortion"}


def test_colour_loss_is_zero_at_the_truth_alone() -> None:
    out = rendered(None)
    assert float(loss_terms(out, out.colour, ONE, LossWeights())["colour"]) == 0
    off = loss_terms(out, out.colour + 0.1, ONE, LossWeights())
    assert float(off["colour"]) == pytest.approx(0.01)


@pytest.mark.parametrize("name", ["colour", "distortion"])
def test_importance_keeps_losses_unbiased(name: str) -> None:
    """Rays drawn with probability q and weighted by (1/R)/q have the loss of all rays on average."""
    out, truth = rendered(None), torch.zeros(R, 3)
    whole = loss_terms(out, truth, ONE, LossWeights())[name]
    q = torch.tensor([0.4, 0.05, 0.05, 0.2, 0.1, 0.2])
    expectation = torch.zeros(())
    for ray in range(R):  # one draw each, every outcome with its probability
        alone = dataclasses.replace(
            out, colour=out.colour[[ray]], accumulation=ONE[:1], depth=ONE[:1], depth_median=ONE[:1],
            histograms=(Histogram(out.histograms[-1].s[[ray]], out.histograms[-1].w[[ray]]),),
        )  # fmt: skip
        terms = loss_terms(alone, truth[[ray]], (1 / R / q[ray])[None], LossWeights())
        expectation = expectation + q[ray] * terms[name]
    torch.testing.assert_close(expectation, whole)


def test_importance_counts_for_all_but_the_proposals() -> None:
    """Each ray's terms by its own importance; normals belong to the first rays."""
    out, truth = rendered(samples()), torch.zeros(R, 3)
    total = dict.fromkeys(["colour", "distortion", "normals", "orientation"], 0.0)
    whole = loss_terms(out, truth, ONE, LossWeights())
    for ray in range(R):
        only = torch.zeros(R)
        only[ray] = 1
        terms = loss_terms(out, truth, only, LossWeights())
        torch.testing.assert_close(terms["interlevel"], whole["interlevel"])
        assert (float(terms["normals"]) > 0) == (ray < Q)
        for name in total:
            total[name] += float(terms[name])
    for name, value in total.items():
        assert value == pytest.approx(float(whole[name]), rel=1e-5)


@pytest.mark.parametrize("shape_density", [False, True])
def test_normals_move_the_density_only_when_asked_to(shape_density: bool) -> None:
    """The predicted normals learn in either case."""
    some = samples()
    tensors = [value.requires_grad_() for value in (some.weights, some.from_density, some.predicted)]
    weights = LossWeights(normals_shape_density=shape_density)
    terms = loss_terms(rendered(some), torch.zeros(R, 3), ONE, weights)
    total = terms["normals"] + terms["orientation"]
    moved = [g is not None and bool(g.any()) for g in torch.autograd.grad(total, tensors, allow_unused=True)]
    assert moved == [shape_density, shape_density, True]


def test_normal_loss_is_zero_only_where_the_normals_agree() -> None:
    some = samples()
    assert not normal_loss(dataclasses.replace(some, predicted=some.from_density)).any()
    assert bool((normal_loss(some) > 0).all())
    opposite = dataclasses.replace(some, predicted=-some.from_density)
    torch.testing.assert_close(normal_loss(opposite), 4 * some.weights.sum(-1))  # |2 n|^2


def test_orientation_loss_is_zero_where_surfaces_face_the_camera() -> None:
    some = samples()
    along = some.directions[:, None].expand(Q, S, 3)
    assert not orientation_loss(dataclasses.replace(some, predicted=-along)).any()
    torch.testing.assert_close(
        orientation_loss(dataclasses.replace(some, predicted=along)), some.weights.sum(-1)
    )
    across = torch.linalg.cross(along, unit(Q, S, seed=9))
    tilted = torch.nn.functional.normalize(across, dim=-1) * 0.8 + 0.6 * along
    torch.testing.assert_close(
        orientation_loss(dataclasses.replace(some, predicted=tilted)), 0.36 * some.weights.sum(-1)
    )


def test_samples_without_weight_do_not_count() -> None:
    some = samples()
    empty = dataclasses.replace(some, weights=torch.zeros(Q, S))
    assert not normal_loss(empty).any()
    assert not orientation_loss(empty).any()
