"""What every radiance field system has in common, whatever its field and its samples.

Letters: r rays, S final intervals; lengths in the scene frame.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Generator, Tensor, nn

from plnerf.field.guides import Guides
from plnerf.field.poses import PoseCorrections
from plnerf.ops.backends import Backend
from plnerf.ops.rendered import Rendered
from plnerf.rays.rays import Rays
from plnerf.render.config import SamplerConfig
from plnerf.render.proposals import Histogram


@dataclass(frozen=True)
class NormalSamples:
    """Normals of the samples of some rays, for the losses of Ref-NeRF."""

    weights: Float[Tensor, "q S"]
    from_density: Float[Tensor, "q S 3"]
    predicted: Float[Tensor, "q S 3"]
    directions: Float[Tensor, "q 3"]


@dataclass(frozen=True)
class RenderedRays:
    """What rays see."""

    colour: Float[Tensor, "r 3"]
    accumulation: Float[Tensor, " r"]
    depth: Float[Tensor, " r"]
    depth_median: Float[Tensor, " r"]
    normals: Float[Tensor, "r 3"] | None
    histograms: tuple[Histogram, ...]
    """Of the proposal rounds and, last, of the final one."""
    normal_samples: NormalSamples | None
    coarse_colour: Float[Tensor, "r 3"] | None = None
    """What the coarse samples alone show, where a system renders them."""

    @classmethod
    def of(
        cls,
        seen: Rendered,
        s: Float[Tensor, "r E"],
        history: tuple[Histogram, ...] = (),
        *,
        normals: Float[Tensor, "r 3"] | None = None,
        normal_samples: NormalSamples | None = None,
        coarse_colour: Float[Tensor, "r 3"] | None = None,
    ) -> "RenderedRays":
        """From what is seen between the edges s, after the rounds of `history`."""
        return cls(
            seen.colour,
            seen.accumulation,
            seen.depth,
            seen.depth_median,
            normals,
            (*history, Histogram(s, seen.w)),
            normal_samples,
            coarse_colour,
        )


class RadianceSystem(nn.Module):
    """A field, how rays are sampled in it, and what is learnt of each image: appearance and pose."""

    guides: Guides | None = None
    """Curves that the samples follow, where the system can."""
    fixed_shapes: bool = True
    """Whether tensors have the same shapes in every step, as a CUDA graph needs them."""

    def __init__(self, sampler: SamplerConfig, appearance: int, images: int, backend: Backend) -> None:
        super().__init__()
        self.sampler, self.backend = sampler, backend
        # Zero at the start: the mean vector, used for views without an image of their own, stays within what
        # is seen.
        self.appearance = nn.Parameter(torch.zeros(images, appearance))
        self.poses = PoseCorrections(images)

    @property
    def predicts_normals(self) -> bool:
        """Whether the field has normals to render and to train."""
        return False

    def update(self, step: int, generator: Generator) -> None:
        """What is to be done between steps; called before each one."""

    def forward(
        self,
        rays: Rays,
        *,
        appearance: Float[Tensor, "r A"],
        anneal: float | Tensor = 1.0,
        generator: Generator | None = None,
        normals: bool = False,
        normal_rays: int = 0,
        normals_shape_density: bool = True,
    ) -> RenderedRays:
        """Render rays.  With a generator the samples are jittered; `normals` renders the predicted normals;
        the first `normal_rays` rays return their samples' normals for the losses, of which those of the
        density, and the features of the predicted ones, have a graph only if they shall shape the field."""
        raise NotImplementedError

    def mean_appearance(self, rays: int, images: Tensor) -> Float[Tensor, "{rays} A"]:
        """The mean vector of some images, for views that have none of their own."""
        return self.appearance[images].mean(0).expand(rays, -1)
