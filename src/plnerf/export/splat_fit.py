"""Fits Gaussians to renders of the field: a few hundred steps of Adam, each on one render.

Most of the Gaussians are laid out evenly (`splat_seed.py`); the others are added while the fit goes on, on
the surface where the renders differ most.  Positions are counted in widths of each Gaussian, so that one rate
serves near and far ones.  Those of wires keep their place and shape; their colours are fitted as well.
"""

from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from plnerf.errors import TrainingError
from plnerf.export.splat_config import SplatConfig
from plnerf.export.splat_project import Gaussians, render
from plnerf.export.splat_seed import seeds, surface_points
from plnerf.export.splat_sh import Y_0
from plnerf.export.splat_views import TargetView
from plnerf.export.splats import Splats
from plnerf.scene.build_store import Progress

LAID_OUT = 0.6
"""Share of the Gaussians that is laid out evenly at the start."""
GROW_EVERY, GROW_UNTIL = 20, 0.7
"""Steps between additions, and the share of the steps after which there are none."""
RATES = {"offset": 0.02, "log_scale": 0.02, "quaternion": 0.01, "logit": 0.05, "dc": 0.02, "rest": 0.004}
LAST_RATE = 0.1
"""Of a rate at the end, as a share of that at the start."""
FAINT = 0.02
"""Gaussians of less opacity are left out at the end."""
WIDEST = 2.5
"""A Gaussian grows by at most the exponential of this."""


class Fit:
    """The Gaussians while they are fitted; rows from `active` on are not in use yet."""

    def __init__(self, start: Splats, wires: Splats, count: int) -> None:
        K = start.sh.shape[1]
        self.active, self.wires = len(start), wires
        self.base, self.width = torch.zeros(count, 3), torch.ones(count, 1)
        self.widest = torch.zeros(count, 1)
        shapes = {
            "offset": (count, 3), "log_scale": (count, 3), "quaternion": (count, 4), "logit": (count,),
            "dc": (count, 1, 3), "rest": (count, K - 1, 3),
        }  # fmt: skip
        self.values = {name: torch.zeros(shape) for name, shape in shapes.items()}
        self.values["wire_dc"] = torch.from_numpy(wires.sh[:, :1].copy())
        self._write(0, start)
        for value in self.values.values():
            value.requires_grad_()

    def _write(self, first: int, splats: Splats) -> None:
        rows = slice(first, first + len(splats))
        with torch.no_grad():
            log_scale = torch.from_numpy(splats.scale).log()
            self.base[rows] = torch.from_numpy(splats.xyz).float()
            self.width[rows] = torch.from_numpy(splats.scale).amax(1, keepdim=True)
            self.widest[rows] = log_scale.amax(1, keepdim=True) + WIDEST
            self.values["log_scale"][rows] = log_scale
            self.values["quaternion"][rows] = torch.from_numpy(splats.rotation)
            self.values["logit"][rows] = torch.from_numpy(splats.opacity).logit()
            self.values["dc"][rows] = torch.from_numpy(splats.sh[:, :1])
            self.values["rest"][rows] = torch.from_numpy(splats.sh[:, 1:])

    def add(self, splats: Splats) -> None:
        """Puts further Gaussians to use, as far as there is room."""
        some = splats.chosen(slice(0, max(0, len(self.base) - self.active)))
        self._write(self.active, some)
        self.active += len(some)

    def gaussians(self) -> Gaussians:
        """All that are in use, wires last."""
        use, value, wires = slice(0, self.active), self.values, self.wires
        log_scale = torch.minimum(value["log_scale"][use], self.widest[use])
        dark = value["wire_dc"].new_zeros(len(wires), value["rest"].shape[1], 3)
        return Gaussians(
            torch.cat([
                self.base[use] + self.width[use] * value["offset"][use], torch.from_numpy(wires.xyz).float()
            ]),
            torch.cat([log_scale, torch.from_numpy(wires.scale).log()]),
            torch.cat([value["quaternion"][use], torch.from_numpy(wires.rotation)]),
            torch.cat([value["logit"][use], torch.from_numpy(wires.opacity).logit()]),
            torch.cat([
                torch.cat([value["dc"][use], value["rest"][use]], 1), torch.cat([value["wire_dc"], dark], 1),
            ]),
        )  # fmt: skip


def fit_splats(
    views: Sequence[TargetView], wires: Splats, config: SplatConfig, progress: Progress | None = None
) -> Splats:
    """Gaussians whose renders are like the given ones, those of the wires last.

    The same for the same renders, settings and number of threads.
    """
    random = np.random.default_rng(config.seed)
    at_first = config.count if not config.steps else max(1, round(LAID_OUT * config.count))
    start = seeds(views, at_first, config.degree, random)
    if not len(start):
        raise TrainingError(
            f"The field shows no surface in any of {len(views)} renders, so that there is nothing to lay "
            "Gaussians on. Train longer, and see what it shows: plnerf render RUN --views test."
        )
    fit = Fit(start, wires, config.count)
    groups = [
        {"params": [value], "lr": RATES[name.removeprefix("wire_")]} for name, value in fit.values.items()
    ]
    optimiser = torch.optim.Adam(groups, eps=1e-12, foreach=True)
    starts = [group["lr"] for group in groups]
    last_growth = int(GROW_UNTIL * config.steps)
    room = config.count - fit.active
    candidates = list[Splats]()
    order = np.zeros(0, np.int64)
    for step in range(config.steps):
        if not len(order):
            order = random.permutation(len(views))
        view, order = views[order[0]], order[1:]
        for group, start in zip(groups, starts, strict=True):
            group["lr"] = start * LAST_RATE ** (step / config.steps)
        rgb, _ = render(fit.gaussians(), view.camera)
        target = torch.from_numpy(view.rgb).float() / 255
        difference = rgb - target
        loss = difference.abs().mean() + difference.square().mean()
        optimiser.zero_grad(set_to_none=True)
        loss.backward()
        optimiser.step()
        if step < last_growth:
            each = -(-room // max(1, last_growth))
            candidates.append(_where_wrong(view, difference.detach(), each, config.degree, random))
            if (step + 1) % GROW_EVERY == 0 or step + 1 == last_growth:
                for one in candidates:
                    fit.add(one)
                candidates = []
        if progress is not None:
            progress(step + 1, config.steps)
    with torch.no_grad():
        return _as_splats(fit.gaussians(), len(wires))


def _where_wrong(
    view: TargetView, difference: Float[Tensor, "h w 3"], count: int, degree: int, random: np.random.Generator
) -> Splats:
    """Small Gaussians on the surface at pixels drawn by how much a render differs there."""
    wrong = (difference.square().sum(-1).numpy() * view.surface).reshape(-1).astype(np.float64)
    count = min(count, int((wrong > 0).sum()))
    drawn = np.zeros(0, np.int64)
    if count:
        drawn = random.choice(len(wrong), count, replace=False, p=wrong / wrong.sum())
    width = (view.z_depth.reshape(-1)[drawn] / float(view.camera.focal_px.mean())).astype(np.float32)
    sh = np.zeros((count, (degree + 1) ** 2, 3), np.float32)
    sh[:, 0] = (view.rgb.reshape(-1, 3)[drawn].astype(np.float32) / 255 - 0.5) / Y_0
    return Splats(
        xyz=surface_points(view).reshape(-1, 3)[drawn],
        scale=np.repeat(width[:, None], 3, 1),
        rotation=np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1)),
        opacity=np.full(count, 0.5, np.float32),
        sh=sh,
    )


def _as_splats(gaussians: Gaussians, wires: int) -> Splats:
    """As arrays, without those that are hardly seen."""
    opacity = gaussians.logit.sigmoid()
    values = [gaussians.xyz, gaussians.log_scale, gaussians.quaternion, gaussians.sh.flatten(1)]
    use = (opacity > FAINT) & torch.cat(values, 1).isfinite().all(1)
    use[len(use) - wires :] = True
    quaternion = torch.nn.functional.normalize(gaussians.quaternion, dim=-1)
    rows = (gaussians.xyz.double(), gaussians.log_scale.exp(), quaternion, opacity, gaussians.sh)
    return Splats(*(row[use].numpy() for row in rows), drawn=wires)


def as_gaussians(splats: Splats) -> Gaussians:
    """Splats as tensors that can be rendered."""
    opacity = torch.from_numpy(splats.opacity)
    return Gaussians(
        torch.from_numpy(splats.xyz).float(), torch.from_numpy(splats.scale).log(),
        torch.from_numpy(splats.rotation), opacity.logit(), torch.from_numpy(splats.sh),
    )  # fmt: skip
