"""Whether kernels compute on this device what the references compute: run before they are chosen.

A kernel may be sound where it was tested and not here: another GPU, another version of Triton or of the
driver, no C compiler for what Triton compiles for the host.
"""

import torch
from torch import Generator, Tensor

from plnerf.field.guides import Windows
from plnerf.ops import dispatch
from plnerf.ops.backends import Backend, BackendChoice
from plnerf.ops.dispatch import Kernels, kernels
from plnerf.ops.grid import GridShape
from plnerf.rays.rays import Rays, pixel_rays
from plnerf.rays.stepfun import even_edges, stratified_levels
from plnerf.render.ray_ops import TORCH, RayOps, ray_ops
from plnerf.scene.cameras import Cameras

POINTS = 1000
TOLERANCE = 1e-3
"""Largest difference, relative to the reference's largest value; that of sound kernels is up to 1e-5."""
_GRID = GridShape(levels=4, coarsest=8, finest=128, features=2, log2_table=12)  # dense and hashed levels
_SAMPLES, _PROPOSALS, _OCTAVES = 20, 33, 2
_Outputs = dict[str, Tensor]


def resolve_backend(choice: BackendChoice, on: torch.device) -> Backend:
    """The backend for a device, tested where it is Triton's; see `dispatch.resolve_backend`."""
    return dispatch.resolve_backend(choice, on, fault_of)


def fault_of(backend: Backend, on: torch.device, points: int = POINTS) -> str | None:
    """What is wrong with a backend's kernels on a device, in words; None where they are sound.

    Compares values and gradients on so many points, half of them in a row as a ray's samples are, and on
    rays with as many samples together.
    """
    rays = -(-points // _SAMPLES)
    try:
        found = _of_points(kernels(backend), on, points) | _of_rays(ray_ops(backend), on, rays)
        truth = _of_points(kernels("torch"), on, points) | _of_rays(TORCH, on, rays)
        found, truth = found | _of_pixels(backend, on, rays), truth | _of_pixels("torch", on, rays)
    except Exception as error:  # whatever the compiler, the driver or Triton raise: the run goes on without
        first = (str(error).strip() or "no message").splitlines()[0]
        return f"they do not run: {type(error).__name__}: {first}"
    for name, value in truth.items():
        off = float((found[name] - value).abs().max() / value.abs().max())
        if not off <= TOLERANCE:  # NaN is wrong, too
            return f"{name} is off by {off:.2g} of the largest value"
    return None


def _of_points(ops: Kernels, on: torch.device, points: int) -> _Outputs:
    """The hash encoding, its gradients, and a step of its table."""
    generator = Generator().manual_seed(0)
    spread, ends = torch.rand(points // 2, 3, generator=generator), torch.rand(2, 3, generator=generator)
    row = torch.lerp(ends[0], ends[1], torch.linspace(0, 1, points - len(spread))[:, None])
    x = torch.cat([spread, row]).to(on)
    table = torch.randn(_GRID.rows, _GRID.features, generator=generator).to(on).requires_grad_()
    cotangent = torch.randn(points, _GRID.width, generator=generator).to(on).requires_grad_()
    encoded = ops.hash_encode(x, table, _GRID)
    (g_table,) = torch.autograd.grad(encoded, table, cotangent.detach())
    g_x = ops.hash_position_gradient(x, cotangent, table, _GRID)
    second, g_cotangent = torch.autograd.grad(g_x, (table, cotangent), x)
    m, v = torch.zeros_like(g_table), torch.zeros_like(g_table)
    stepped, emptied = table.detach().clone(), g_table.clone()
    ops.adam_rows(stepped, emptied, m, v, rate=0.1, betas=(0.9, 0.99), eps=1e-8, step=1)
    return {
        "the hash encoding": encoded.detach(),
        "the gradient of a table": g_table,
        "the gradient by position": g_x.detach(),
        "the second gradient of a table": second,
        "the second gradient of an encoding": g_cotangent,
        "a step of Adam": stepped,
        "the first moment of Adam": m,
        "the second moment of Adam": v,
        "the gradient after a step": emptied + 1,
    }


def _of_pixels(backend: Backend, on: torch.device, count: int) -> _Outputs:
    """The rays of pixels, of a camera with a lens and of one without."""
    generator = Generator().manual_seed(2)
    lens = torch.tensor([[0.06, -0.08, -1e-3, 2e-4, 0.01], [0.0] * 5])
    cameras = Cameras(
        R_scene_camera=torch.linalg.qr(torch.randn(2, 3, 3, generator=generator)).Q,
        centre=torch.randn(2, 3, generator=generator),
        focal_px=torch.tensor([[900.0, 910.0], [1000.0, 1000.0]]),
        principal_px=torch.tensor([[510.0, 390.0], [500.0, 400.0]]),
        distortion=lens,
        size_px=torch.tensor([[1000, 800]] * 2),
    ).to(on)
    pixel_px = torch.rand(count, 2, generator=generator) * torch.tensor([1000.0, 800.0])
    rays = pixel_rays(cameras, (torch.arange(count) % 2).to(on), pixel_px.to(on), backend)
    return {
        "the origin of a ray": rays.origins,
        "the direction of a ray": rays.directions,
        "the radius of a ray": rays.radius,
    }


def _of_rays(ops: RayOps, on: torch.device, count: int) -> _Outputs:
    """What is done to rays, with the gradients."""
    generator = Generator().manual_seed(1)

    def drawn(*shape: int) -> Tensor:
        return torch.rand(*shape, generator=generator).to(on)

    still = torch.zeros(())
    s, other = (even_edges(count, n, generator, still).to(on) for n in (_SAMPLES, _PROPOSALS))
    levels = stratified_levels(count, _SAMPLES + 1, generator, still).to(on)
    direction = torch.nn.functional.normalize(drawn(count, 3) - 0.5, dim=-1)
    rays = Rays(drawn(count, 3), direction, 1e-3 + 1e-3 * drawn(count), torch.zeros(count, device=on).long())
    t = ops.s_to_t(s, 0.1, 100.0, 1.0)
    unit, encoded = ops.frustum_features(rays, t, (1.0, 2.0, 0.5), True, _OCTAVES)
    density, colours = drawn(count, _SAMPLES).requires_grad_(), drawn(count, _SAMPLES, 3).requires_grad_()
    seen = ops.render_rays(density, t, colours)
    g_density, g_colours = torch.autograd.grad(seen.colour.sum() + seen.w[:, 3].sum(), (density, colours))
    weights = ops.weights_from_density(density, t)
    (g_weights,) = torch.autograd.grad(weights, density, drawn(count, _SAMPLES))
    proposal = (drawn(count, _PROPOSALS) / _PROPOSALS).requires_grad_()
    final = (drawn(count, _SAMPLES) / _SAMPLES).requires_grad_()
    losses = ops.interlevel_loss(s, final, other, proposal), ops.distortion_loss(s, final)
    (g_interlevel,) = torch.autograd.grad(losses[0].sum(), proposal)
    low = 0.1 + drawn(count, 2)
    met = Windows(low, low + 0.1, torch.zeros(count, 2, device=on).long(), drawn(count) < 0.5)
    (g_distortion,) = torch.autograd.grad(losses[1].sum(), final)
    return {
        "the distance": t,
        "the place of a frustum": unit,
        "the encoding of a frustum": encoded,
        "a weight": weights.detach(),
        "the gradient of a weight": g_weights,
        "the colour of a ray": seen.colour.detach(),
        "the accumulation of a ray": seen.accumulation.detach(),
        "the expected depth": seen.depth,
        "the median depth": seen.depth_median,
        "the gradient by density": g_density,
        "the gradient by colours": g_colours,
        "a resampled edge": ops.resample_edges(other, proposal.detach(), levels, 0.01, 0.5),
        "an edge laid near a wire": ops.guide_edges(s, met, 8, (0.1, 100.0, 1.0), None),
        "the interlevel loss": losses[0].detach(),
        "the distortion loss": losses[1].detach(),
        "the gradient of the interlevel loss": g_interlevel,
        "the gradient of the distortion loss": g_distortion,
    }
