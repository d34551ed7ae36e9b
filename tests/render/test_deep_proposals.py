"""Mip-NeRF 360: the proposal learns from the interlevel loss alone, all else from the colours."""

import torch
from tests.render.test_coarse_fine import some_rays

from plnerf.field.config import VanillaConfig
from plnerf.render.config import DeepProposalsConfig, SamplerConfig
from plnerf.render.deep_proposals import DeepProposalsNeRF
from plnerf.train.config import LossWeights
from plnerf.train.losses import loss_terms

SMALL = VanillaConfig(
    encoding="ipe", octaves=4, contraction=True, depth=3, width=16, skip=2, colour_width=8, appearance=2,
    normals=True,
)  # fmt: skip
CONFIG = DeepProposalsConfig(
    field=SMALL, proposal=SMALL, sampler=SamplerConfig(proposals=(12, 10), final=8, near=0.1, far=1000.0)
)


def a_system() -> DeepProposalsNeRF:
    return DeepProposalsNeRF(CONFIG, 3, "torch", torch.Generator().manual_seed(0))


def gradients(system: DeepProposalsNeRF, name: str) -> dict[str, bool]:
    """Which parameters one loss term moves."""
    rays = some_rays(40)
    out = system(
        rays, appearance=system.appearance[rays.camera], generator=torch.Generator().manual_seed(3),
        normal_rays=8,
    )  # fmt: skip
    terms = loss_terms(out, torch.rand(40, 3), torch.ones(40), LossWeights())
    system.zero_grad()
    terms[name].backward()
    return {
        key: value.grad is not None and bool(value.grad.abs().max() > 0)
        for key, value in system.named_parameters()
    }


def test_shapes() -> None:
    rays = some_rays(7)
    out = a_system()(rays, appearance=torch.zeros(7, 2), normals=True)
    assert [h.w.shape[1] for h in out.histograms] == [12, 10, 8]
    assert out.colour.shape == out.normals.shape == (7, 3)
    assert (out.colour >= 0).all() and (out.colour <= 1).all() and out.depth.isfinite().all()


def test_the_proposal_is_trained_by_the_interlevel_loss_alone() -> None:
    system = a_system()
    with torch.no_grad():  # in a new field no round has less than the final one
        system.field.density_layer[-1].bias += 8.0
        system.field.density_layer[-1].weight *= 8.0
    moved = gradients(system, "interlevel")
    assert {key.split(".")[0] for key, yes in moved.items() if yes} == {"proposal"}
    assert all(yes for key, yes in moved.items() if key.startswith("proposal"))
    moved = gradients(system, "colour")
    assert {key.split(".")[0] for key, yes in moved.items() if yes} == {"field", "appearance"}
