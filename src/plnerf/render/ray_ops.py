"""What a backend does to rays, as one value: the references in torch, or fused kernels.

Plain torch makes a pass over memory for every operation in an equation, and on a GPU launches a kernel; for
the few thousand samples of a step this, not the arithmetic, is what takes the time.  The equations stay
where they are (`rays/`, `field/encodings.py`, `render/volume.py`); here they are put together to what the
model asks for.
"""

from collections.abc import Callable
from functools import cache, partial
from typing import NamedTuple

from jaxtyping import Float
from torch import Generator, Tensor

from plnerf.field.encodings import integrated_positional_encoding
from plnerf.field.guides import Windows
from plnerf.ops.backends import Backend
from plnerf.ops.dispatch import kernels
from plnerf.ops.rendered import Rendered
from plnerf.rays.contraction import clamp_frustums, contract_frustums
from plnerf.rays.frustums import ray_frustums
from plnerf.rays.histograms import blurred_interlevel_loss, dilate
from plnerf.rays.rays import Rays
from plnerf.rays.stepfun import distortion_loss, interlevel_loss, resample_edges
from plnerf.rays.warp import s_to_t
from plnerf.render.guided import guide_edges
from plnerf.render.volume import (
    accumulation,
    composite,
    expected_depth,
    median_depth,
    weights_from_density,
)


class RayOps(NamedTuple):
    """Functions on rays; see the references below and in `TORCH` for what each one does."""

    s_to_t: Callable[[Tensor, float, float, float], Tensor]
    frustum_features: Callable[[Rays, Tensor, tuple[float, float, float], bool, int], tuple[Tensor, Tensor]]
    weights_from_density: Callable[[Tensor, Tensor], Tensor]
    resample_edges: Callable[[Tensor, Tensor, Tensor, float, float | Tensor], Tensor]
    render_rays: Callable[[Tensor, Tensor, Tensor], Rendered]
    interlevel_loss: Callable[[Tensor, Tensor, Tensor, Tensor], Tensor]
    distortion_loss: Callable[[Tensor, Tensor], Tensor]
    blurred_interlevel_loss: Callable[[Tensor, Tensor, Tensor, Tensor, float], Tensor]
    dilate: Callable[[Tensor, Tensor, float], Tensor]
    guide_edges: Callable[[Tensor, Windows, int, tuple[float, float, float], Generator | None], Tensor]


def frustum_features(
    rays: Rays, t: Float[Tensor, "r E"], stretch: tuple[float, float, float], contraction: bool, octaves: int
) -> tuple[Float[Tensor, "r E-1 3"], Float[Tensor, "r E-1 e"]]:
    """Frustums between the edges t: their means in the unit cube, and their IPE; e = 6 octaves.

    Contracted, or clamped to [-2, 2]^3; the cube [-2, 2]^3 becomes [0, 1]^3 for the hash grids.
    """
    bound = contract_frustums if contraction else clamp_frustums
    mean, variance = bound(ray_frustums(rays, t), stretch)
    return (mean + 2) / 4, integrated_positional_encoding(mean, variance, octaves)


def render_rays(
    density: Float[Tensor, "r S"], t: Float[Tensor, "r S+1"], colours: Float[Tensor, "r S 3"]
) -> Rendered:
    """The rendering sum.  What lies behind the last interval takes its colour (nerfacto's "last sample"):
    the sky needs no density.
    """
    w = weights_from_density(density, t)
    total = accumulation(w)
    colour = composite(w, colours) + (1 - total)[:, None] * colours[:, -1]
    still = w.detach()
    return Rendered(w, colour, total, expected_depth(still, t), median_depth(still, t))


TORCH = RayOps(
    s_to_t,
    frustum_features,
    weights_from_density,
    resample_edges,
    render_rays,
    interlevel_loss,
    distortion_loss,
    blurred_interlevel_loss,
    dilate,
    guide_edges,
)


@cache
def ray_ops(backend: Backend) -> RayOps:
    """The functions of a backend: fused where it has kernels, else plain torch."""
    fused = kernels(backend).on_rays
    if fused is None:
        return TORCH

    def features(
        rays: Rays, t: Tensor, stretch: tuple[float, float, float], contraction: bool, octaves: int
    ) -> tuple[Tensor, Tensor]:
        return fused.frustum_features(
            rays.origins, rays.directions, rays.radius, t, stretch, contraction, octaves
        )

    return RayOps(
        fused.s_to_t,
        features,
        fused.weights_from_density,
        fused.resample_edges,
        fused.render_rays,
        fused.interlevel_loss,
        fused.distortion_loss,
        fused.blurred_interlevel_loss or TORCH.blurred_interlevel_loss,
        fused.dilate or TORCH.dilate,
        partial(guide_edges, backend=backend),
    )
