"""Cases of what a step does to its rays, and of the colour network.

Letters: r rays, S final intervals, P intervals of a proposal round.
"""

from itertools import pairwise

import torch
from jaxtyping import Float
from torch import Generator, Tensor

from plnerf.bench.case import Op, OpCase, Work, leaf
from plnerf.ops import dispatch, reference
from plnerf.ops.backends import Backend
from plnerf.rays.rays import Rays
from plnerf.rays.stepfun import even_edges, stratified_levels
from plnerf.render.ray_ops import TORCH, RayOps, ray_ops

OCTAVES, FEATURE, HIDDEN = 6, 15, 64
_STRETCH = (1.0, 1.0, 1.0)


def ray_cases(backend: Backend, r: int, P: int, S: int) -> list[OpCase]:
    """The functions of `RayOps`: bytes and operations per interval, times intervals."""
    fast, final, proposal = ray_ops(backend), f"{r:,} x {S}", f"{r:,} x {P}"

    def edges_weights(intervals: int, generator: Generator) -> tuple[Tensor, Tensor]:
        s = even_edges(r, intervals, generator, torch.zeros(()))
        return s, torch.rand(r, intervals, generator=generator) / intervals

    def rendering(generator: Generator) -> tuple[Tensor, ...]:
        s, _ = edges_weights(S, generator)
        density = leaf(torch.rand(r, S, generator=generator) * 4)
        return density, 1 + s, leaf(torch.rand(r, S, 3, generator=generator))

    def weights(generator: Generator) -> tuple[Tensor, ...]:
        s, _ = edges_weights(P, generator)
        return leaf(torch.rand(r, P, generator=generator) * 4), 1 + s

    def resampling(generator: Generator) -> tuple[Tensor, ...]:
        return *edges_weights(P, generator), stratified_levels(r, S + 1, generator, torch.zeros(()))

    def interlevel(generator: Generator) -> tuple[Tensor, ...]:
        s_proposal, w_proposal = edges_weights(P, generator)
        return *edges_weights(S, generator), s_proposal, leaf(w_proposal)

    def distortion(generator: Generator) -> tuple[Tensor, ...]:
        s, w = edges_weights(S, generator)
        return s, leaf(w)

    return [
        OpCase(
            "frustums and IPE", f"{final}, {OCTAVES} octaves", lambda generator: cones(r, S, generator),
            _features(TORCH), _features(fast),
            # Moments 25, mean 6, contraction 15, variances 30; an octave and axis of the IPE 6.
            Work(4 * r * S * (4 + 6 * OCTAVES), flops=r * S * (76 + 18 * OCTAVES)),
        ),
        OpCase(
            "volume rendering", final, rendering, TORCH.render_rays, fast.render_rays,
            Work(4 * r * S * 6, flops=r * S * 16), Work(4 * r * S * 9, flops=r * S * 20),
        ),
        OpCase(
            "weights from density", proposal, weights, TORCH.weights_from_density, fast.weights_from_density,
            Work(4 * r * P * 3, flops=r * P * 6), Work(4 * r * P * 4, flops=r * P * 5),
        ),
        OpCase(
            "resampling", f"{proposal} to {S + 1} edges", resampling,
            lambda s, w, u: TORCH.resample_edges(s, w, u, 0.03, 0.5),
            lambda s, w, u: fast.resample_edges(s, w, u, 0.03, 0.5),
            Work(4 * r * (2 * P + 2 * S), flops=r * (4 * P + 6 * S)),
        ),
        OpCase(
            "interlevel loss", f"{final} against {P}", interlevel,
            TORCH.interlevel_loss, fast.interlevel_loss,
            Work(8 * r * (P + S), flops=r * (P + 6 * S)), Work(8 * r * P, flops=r * (P + 3 * S)),
        ),
        OpCase(
            "distortion loss", final, distortion, TORCH.distortion_loss, fast.distortion_loss,
            Work(8 * r * S, flops=r * S * 12), Work(8 * r * S, flops=r * S * 12),
        ),
    ]  # fmt: skip


def cones(r: int, S: int, generator: Generator) -> tuple[Tensor, ...]:
    """Origins, directions and radii of random rays from near the origin, and edges along them."""
    origins = torch.rand(r, 3, generator=generator) * 0.6 - 0.3
    directions = torch.nn.functional.normalize(torch.randn(r, 3, generator=generator), dim=-1)
    s = even_edges(r, S, generator, origins)
    return origins, directions, torch.full((r,), 0.003), 0.03 + 10 * s**2


def _features(ops: RayOps) -> Op:
    def features(
        origins: Float[Tensor, "r 3"],
        directions: Float[Tensor, "r 3"],
        radius: Float[Tensor, " r"],
        t: Tensor,
    ) -> tuple[Tensor, Tensor]:
        camera = torch.zeros(len(t), dtype=torch.int64, device=t.device)
        return ops.frustum_features(Rays(origins, directions, radius, camera), t, _STRETCH, True, OCTAVES)

    return features


def network_case(backend: Backend, r: int, S: int) -> OpCase:
    """The colour network of the preset: 15 features with a gradient, 36 of the IPE without, 2 hidden."""
    inputs, const = FEATURE, 6 * OCTAVES
    widths = (inputs + const, HIDDEN, HIDDEN, 3)
    products = 2 * sum(a * b for a, b in pairwise(widths))
    first = 2 * const * HIDDEN  # of these no gradient by the inputs is asked for

    def setup(generator: Generator) -> tuple[Tensor, ...]:
        x = leaf(torch.randn(r, S, inputs, generator=generator))
        still = torch.randn(r, S, const, generator=generator)
        base = leaf(torch.randn(r, HIDDEN, generator=generator))
        weights = [leaf(torch.randn(HIDDEN, widths[0], generator=generator) / widths[0] ** 0.5)]
        for a, b in pairwise(widths[1:]):
            weights += [leaf(torch.randn(b, a, generator=generator) / a**0.5), leaf(torch.zeros(b))]
        return x, still, base, *weights

    moved = 4 * r * S * (inputs + const + 3)
    return OpCase(
        name="colour network",
        shape=f"{r:,} x {S}, {' - '.join(map(str, widths))}",
        setup=setup,
        reference=lambda x, still, base, *weights: reference.ray_mlp(x, still, base, weights),
        kernel=lambda x, still, base, *weights: dispatch.ray_mlp(x, still, base, weights, backend),
        forward=Work(moved, flops=r * S * products),
        backward=Work(moved + 4 * r * S * inputs, flops=r * S * (2 * products - first)),
    )
