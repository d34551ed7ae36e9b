"""Fits Gaussians to renders of the field: a few hundred steps of Adam, each on one render.

Positions are counted in widths of each Gaussian, so that one rate serves near and far ones.  Those of wires
keep their place and shape; their colours are fitted as well.
"""

from collections.abc import Sequence

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from plnerf.errors import TrainingError
from plnerf.export.splat_config import SplatConfig
from plnerf.export.splat_project import Gaussians, render
from plnerf.export.splat_seed import seeds
from plnerf.export.splat_views import TargetView
from plnerf.export.splats import Splats
from plnerf.scene.build_store import Progress

RATES = {"offset": 0.05, "log_scale": 0.05, "quaternion": 0.025, "logit": 0.125, "dc": 0.05, "rest": 0.01}
"""Of Adam, at the start, by what is fitted; `dc` and `rest`: harmonics of degree 0, and the others."""
LAST_RATE = 0.1
"""Of a rate at the end, as a share of that at the start."""
FAINT = 0.02
"""Gaussians of less opacity are left out at the end."""
WIDEST = 0.7
"""The logarithm of the factor by which a Gaussian may grow."""


class Fit:
    """The values that are fitted, and what stays as it is."""

    def __init__(self, start: Splats, wires: Splats) -> None:
        self.wires = wires
        self.base = torch.from_numpy(start.xyz).float()
        self.width = torch.from_numpy(start.scale).amax(1, keepdim=True)
        self.values = {
            "offset": torch.zeros_like(self.base),
            "log_scale": torch.from_numpy(start.scale).log(),
            "quaternion": torch.from_numpy(start.rotation.copy()),
            "logit": torch.from_numpy(start.opacity).logit(),
            "dc": torch.from_numpy(np.concatenate([start.sh[:, :1], wires.sh[:, :1]])),
            "rest": torch.from_numpy(start.sh[:, 1:].copy()),
        }
        for value in self.values.values():
            value.requires_grad_()

    def gaussians(self) -> Gaussians:
        """All of them, those of wires last."""
        value, fixed = self.values, self.wires
        log_scale = torch.minimum(value["log_scale"], self.width.log() + WIDEST)
        none = torch.zeros(len(fixed), *value["rest"].shape[1:])
        return Gaussians(
            torch.cat([self.base + self.width * value["offset"], torch.from_numpy(fixed.xyz).float()]),
            torch.cat([log_scale, torch.from_numpy(fixed.scale).log()]),
            torch.cat([value["quaternion"], torch.from_numpy(fixed.rotation)]),
            torch.cat([value["logit"], torch.from_numpy(fixed.opacity).logit()]),
            torch.cat([value["dc"], torch.cat([value["rest"], none])], 1),
        )


def fit_splats(
    views: Sequence[TargetView], wires: Splats, config: SplatConfig, progress: Progress | None = None
) -> Splats:
    """Gaussians whose renders are like the given ones, those of the wires last.

    The same for the same renders, settings and number of threads.  Raises TrainingError where no render shows
    a surface.
    """
    random = np.random.default_rng(config.seed)
    start = seeds(views, config.count, config.degree, random)
    if not len(start):
        raise TrainingError(
            f"The field shows no surface in any of {len(views)} renders, so that there is nothing to lay "
            "Gaussians on. Train longer, and see what it shows: plnerf render RUN --views test."
        )
    fit = Fit(start, wires)
    groups = [{"params": [value], "lr": RATES[name]} for name, value in fit.values.items()]
    optimiser = torch.optim.Adam(groups, eps=1e-12, foreach=True)
    order = np.zeros(0, np.int64)
    for step in range(config.steps):
        if not len(order):
            order = random.permutation(len(views))
        view, order = views[order[0]], order[1:]
        for group, rate in zip(optimiser.param_groups, RATES.values(), strict=True):
            group["lr"] = rate * LAST_RATE ** (step / config.steps)
        rgb, _ = render(fit.gaussians(), view.camera)
        difference = rgb - torch.from_numpy(view.rgb).float() / 255
        loss = difference.abs().mean() + difference.square().mean()
        optimiser.zero_grad(set_to_none=True)
        loss.backward()
        optimiser.step()
        if progress is not None:
            progress(step + 1, config.steps)
    with torch.no_grad():
        return _as_splats(fit.gaussians(), len(wires))


def _as_splats(gaussians: Gaussians, wires: int) -> Splats:
    """As arrays, without those that are hardly seen; those of wires stay."""
    opacity = gaussians.logit.sigmoid()
    values = [gaussians.xyz, gaussians.log_scale, gaussians.quaternion, gaussians.sh.flatten(1)]
    use = (opacity > FAINT) & torch.cat(values, 1).isfinite().all(1)
    use[len(use) - wires :] = True
    quaternion: Float[Tensor, "n 4"] = F.normalize(gaussians.quaternion, dim=-1)
    return Splats(
        xyz=gaussians.xyz[use].double().numpy(),
        scale=gaussians.log_scale[use].exp().numpy(),
        rotation=quaternion[use].numpy(),
        opacity=opacity[use].numpy(),
        sh=gaussians.sh[use].numpy(),
        drawn=wires,
    )


def as_gaussians(splats: Splats) -> Gaussians:
    """Splats as tensors that can be rendered."""
    opacity = torch.from_numpy(splats.opacity)
    return Gaussians(
        torch.from_numpy(splats.xyz).float(), torch.from_numpy(splats.scale).log(),
        torch.from_numpy(splats.rotation), opacity.logit(), torch.from_numpy(splats.sh),
    )  # fmt: skip
