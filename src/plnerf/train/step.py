"""One training step: cast the rays of a batch, render them, weigh the losses, step the optimiser.

The same on a CPU and on a GPU.  Nothing in it waits for the device, and with a batch that is there already
nothing copies to it, so that a CUDA graph can hold it (`graph.py`): all that changes comes in tensors.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Generator, Tensor

from plnerf.rays.rays import pixel_rays
from plnerf.render.ray_ops import ray_ops
from plnerf.render.system import RadianceSystem
from plnerf.scene.cameras import Cameras
from plnerf.train.batches import to_device
from plnerf.train.config import TrainConfig
from plnerf.train.losses import loss_terms
from plnerf.train.optimizer import Optimizer
from plnerf.train.pixels import PixelBatch
from plnerf.train.ranks import SharedGradients


class NonFiniteMonitor:
    """Counts the steps before the first loss that is not finite, on the device; reading the count waits."""

    def __init__(self, device: torch.device) -> None:
        self._all_so_far = torch.ones((), dtype=torch.bool, device=device)
        self._count = torch.zeros((), dtype=torch.int64, device=device)

    def add(self, total: Float[Tensor, ""]) -> None:
        """Notes the loss of one more step."""
        self._all_so_far.logical_and_(total.isfinite())
        self._count.add_(self._all_so_far)

    def count(self) -> int:
        """Steps with a finite loss before the first without one."""
        return int(self._count.item())


@dataclass(frozen=True)
class Training:
    """What is trained, and how; all on one device."""

    model: RadianceSystem
    optimizer: Optimizer
    cameras: Cameras
    config: TrainConfig
    monitor: NonFiniteMonitor
    gradients: SharedGradients | None = None
    """Where several processes train together."""

    def step(
        self,
        batch: PixelBatch,
        anneal: float | Float[Tensor, ""],
        generator: Generator,
        refine_poses: bool = False,
        normals: bool = True,
    ) -> dict[str, Tensor]:
        """One step; returns the weighted loss terms.  `anneal` as in `proposals.sample_along_rays`.

        A batch on the host is copied to the device first.
        """
        model, config, backend = self.model, self.config, self.model.backend
        batch = to_device(batch, self.cameras.centre.device)
        rays = pixel_rays(self.cameras, batch.camera, batch.pixel_px, backend)
        if refine_poses:
            rays = model.poses(rays)
        out = model(
            rays,
            appearance=model.appearance[rays.camera],
            anneal=anneal,
            generator=generator,
            normal_rays=config.normal_rays if normals and model.predicts_normals else 0,
            normals_shape_density=config.loss.normals_shape_density,
        )
        terms = loss_terms(out, batch.colour, batch.importance, config.loss, ray_ops(backend))
        self.optimizer.zero_grad(set_to_none=False)  # the ops add to the gradients in place
        total = torch.stack(list(terms.values())).sum()
        if self.gradients is None:
            total.backward()
        else:
            terms = self.gradients.backward(terms)
            total = torch.stack(list(terms.values())).sum()
        self.monitor.add(total.detach())
        self.optimizer.step()
        return {name: term.detach() for name, term in terms.items()}
