"""The loss terms and their weights.

Letters: r rays, S intervals; p the importance weight of a ray, 1 where pixels are drawn uniformly.
"""

from collections.abc import Iterator
from dataclasses import replace

from jaxtyping import Float
from torch import Tensor

from plnerf.render.proposals import Histogram
from plnerf.render.ray_ops import TORCH, RayOps
from plnerf.render.system import NormalSamples, RenderedRays
from plnerf.train.config import LossWeights


def loss_terms(
    out: RenderedRays,
    colour: Float[Tensor, "r 3"],
    importance: Float[Tensor, " r"],
    weights: LossWeights,
    ops: RayOps = TORCH,
) -> dict[str, Tensor]:
    """Weighted terms by name; their sum is what is minimised.

    A ray's importance counts for all that shapes the field: weighing only the colour would leave the
    distortion loss five times too strong on wires, where rays are drawn five times as often.  The
    proposals are not weighed: they shall cover wires best.
    """
    final = out.histograms[-1]
    terms = {"colour": (importance[:, None] * (out.colour - colour) ** 2).mean()}
    if out.coarse_colour is not None:
        terms["coarse"] = (importance[:, None] * (out.coarse_colour - colour) ** 2).mean()
    if weights.interlevel:
        terms["interlevel"] = sum(
            (value.mean() for value in _interlevel(out.histograms, weights.interlevel_blur, ops)),
            out.colour.new_zeros(()),
        )
    if weights.distortion:
        terms["distortion"] = (importance * ops.distortion_loss(final.s, final.w)).mean()
    if out.normal_samples is not None:
        samples = out.normal_samples
        if not weights.normals_shape_density:
            samples = replace(
                samples, weights=samples.weights.detach(), from_density=samples.from_density.detach()
            )
        counts = importance[: len(samples.weights)]
        terms["normals"] = (counts * normal_loss(samples)).mean()
        terms["orientation"] = (counts * orientation_loss(samples)).mean()
    return {name: getattr(weights, name) * term for name, term in terms.items()}


def _interlevel(
    histograms: tuple[Histogram, ...], blur: tuple[float, ...], ops: RayOps
) -> Iterator[Float[Tensor, " r"]]:
    """The interlevel loss of each proposal round."""
    *rounds, final = histograms
    if not blur:
        for found in rounds:
            yield ops.interlevel_loss(final.s, final.w, found.s, found.w)
        return
    for found, half_width in zip(rounds, blur, strict=True):
        yield ops.blurred_interlevel_loss(final.s, final.w, found.s, found.w, half_width)


def normal_loss(samples: NormalSamples) -> Float[Tensor, " q"]:
    """R_p = sum_i w_i |n_i - n'_i|^2: the density's normals n and predicted n' agree.  Ref-NeRF eq. 10."""
    return (samples.weights * (samples.from_density - samples.predicted).square().sum(-1)).sum(-1)


def orientation_loss(samples: NormalSamples) -> Float[Tensor, " q"]:
    """R_o = sum_i w_i max(0, n'_i . d)^2: no visible surface faces away.  Ref-NeRF eq. 11."""
    facing_away = (samples.predicted * samples.directions[:, None]).sum(-1).clamp_min(0)
    return (samples.weights * facing_away**2).sum(-1)
