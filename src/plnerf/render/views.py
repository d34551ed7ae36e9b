"""Whole views from rays, a chunk at a time.

Letters: h rows, w columns of a view; r rays.  Lengths are in scene units, cameras are OpenCV's (z forward),
pixel centres are at +0.5.  Memory is bounded by the chunk and the view's own arrays.
"""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from plnerf.errors import ConfigError, TrainingError
from plnerf.rays.rays import pixel_rays
from plnerf.render.proposals import s_to_t
from plnerf.render.pruning import Pruning, is_fused, render_pruned
from plnerf.render.ray_ops import ray_ops
from plnerf.render.system import RadianceSystem, RenderedRays
from plnerf.render.volume import depth_deviation
from plnerf.scene.cameras import Cameras
from plnerf.scene.memory import require_memory

CPU_CHUNK_RAYS, GPU_CHUNK_RAYS = 1024, 32768
"""Rays at once: on a CPU what stays in its cache (a quarter faster than 4096), on a GPU what fills it."""
FUSED_CHUNK_RAYS = 16384
"""Rays at once where fused kernels render pruned views on a CPU, which keep to the cache by themselves: about
6 kB each with the demo's model.  A quarter faster than 1024."""


VIEW_BYTES = 2 * 7 * 4
"""Memory of a pixel of a view at least: its columns without normals, in parts and as one table."""


@dataclass(frozen=True, eq=False)
class RenderedView:
    """What one camera sees, float32."""

    rgb: Float[np.ndarray, "h w 3"]
    """In [0, 1], encoded as the photos are (sRGB)."""
    accumulation: Float[np.ndarray, "h w"]
    """Probability that a ray ends at all; below one half there is no surface."""
    depth: Float[np.ndarray, "h w"]
    """Expected distance along the ray."""
    depth_median: Float[np.ndarray, "h w"]
    """Distance at which the transmittance is one half; the far end of the ray where that never happens."""
    z_depth: Float[np.ndarray, "h w"]
    """The median depth along the camera's z axis, as depth images have it."""
    normals: Float[np.ndarray, "h w 3"] | None
    """Weighted sum of the unit normals in the scene frame: no longer than the accumulation."""
    depth_deviation: Float[np.ndarray, "h w"] | None = None
    """Standard deviation of the distance along the ray at which it ends: how much the field's own density is
    spread, not how wrong its depth is.  None where it was not asked for."""
    coloured: float = 1.0
    """Share of the rays' intervals whose colour was computed."""

    @property
    def has_surface(self) -> Bool[np.ndarray, "h w"]:
        """Where a ray more likely ends than not."""
        ends: Bool[np.ndarray, "h w"] = self.accumulation >= 0.5
        return ends


def render_view(
    model: RadianceSystem,
    camera: Cameras,
    appearance: Float[Tensor, " A"],
    *,
    chunk_rays: int | None = None,
    normals: bool,
    deviation: bool = False,
    pruning: Pruning | None = None,
) -> RenderedView:
    """Renders the whole view of one camera on the model's device; the chunk size does not change the result.

    camera: one camera in the scene frame.  appearance: the vector that decides exposure and white balance.
    chunk_rays: None chooses by the device.  deviation: whether to find the depth's standard deviation.
    pruning: what may be left out; None renders exactly.
    Raises ConfigError for normals of a model that predicts none, TrainingError where it renders values that
    are not finite.
    """
    chunk = default_chunk(model, pruning) if chunk_rays is None else chunk_rays
    if len(camera) != 1 or chunk < 1:
        raise ConfigError(
            f"A view has one camera and chunks of 1 ray or more, but got {len(camera)} cameras, {chunk} rays."
        )
    width, height = camera.size_px[0].tolist()
    parts, coloured, device = list[Tensor](), 0, model.appearance.device
    camera, appearance = camera.to(device), appearance.to(device)
    for first in range(0, width * height, chunk):
        flat = torch.arange(first, min(first + chunk, width * height), device=device)
        columns, computed = _render_pixels(model, camera, appearance, flat, normals, deviation, pruning)
        parts.append(columns)
        coloured += computed
    # One table of columns: colour 3, accumulation, depth, median depth, z depth; deviation, normals 3 if any.
    table = torch.cat(parts).numpy().reshape(height, width, -1)
    _check_finite(table)
    return RenderedView(
        rgb=np.clip(table[..., :3], 0.0, 1.0),
        accumulation=table[..., 3].copy(),
        depth=table[..., 4].copy(),
        depth_median=table[..., 5].copy(),
        z_depth=table[..., 6].copy(),
        normals=table[..., -3:].copy() if normals else None,
        depth_deviation=table[..., 7].copy() if deviation else None,
        coloured=coloured / (width * height * model.sampler.final),
    )


def _check_finite(table: Float[np.ndarray, "h w c"]) -> None:
    """Finite weights can still overflow; in a picture of 8 bits that would not show."""
    bad = int((~np.isfinite(table)).any(-1).sum())
    if bad:
        raise TrainingError(
            f"{bad:,} of the {table[..., 0].size:,} pixels of a view are not finite: the model's weights are "
            "too large for float32. Remove the run's newest checkpoint to use the one before, or train again "
            "with a lower train.hash_lr and train.mlp_lr."
        )


def default_chunk(model: RadianceSystem, pruning: Pruning | None = None) -> int:
    """How many rays to render at once on the model's device."""
    if model.appearance.device.type != "cpu":
        return GPU_CHUNK_RAYS
    return FUSED_CHUNK_RAYS if pruning is not None and is_fused(model) else CPU_CHUNK_RAYS


def _render_pixels(
    model: RadianceSystem,
    camera: Cameras,
    appearance: Float[Tensor, " A"],
    flat: Int[Tensor, " r"],
    normals: bool,
    deviation: bool,
    pruning: Pruning | None,
) -> tuple[Float[Tensor, "r c"], int]:
    """Columns of some pixels, by their index row by row, on the CPU; how many intervals have a colour."""
    width = camera.size_px[0, 0]
    pixel_px = torch.stack([flat % width, flat // width], -1) + 0.5
    rays = pixel_rays(camera, torch.zeros_like(flat), pixel_px, model.backend)
    along_z = rays.directions @ camera.R_scene_camera[0, :, 2]
    with torch.inference_mode():
        vectors = appearance.expand(len(rays), -1)
        if pruning is None:
            out = model(rays, appearance=vectors, normals=normals)
            coloured = len(rays) * model.sampler.final
        else:
            out, coloured = render_pruned(model, rays, appearance=vectors, pruning=pruning, normals=normals)
        columns = [out.colour, *(c[:, None] for c in (out.accumulation, out.depth, out.depth_median))]
        columns.append(out.depth_median[:, None] * along_z[:, None])
        if deviation:
            columns.append(_deviation(model, out)[:, None])
        if normals:
            columns.append(out.normals)
        return torch.cat(columns, -1).float().cpu(), coloured


def _deviation(model: RadianceSystem, out: RenderedRays) -> Float[Tensor, " r"]:
    """Standard deviation of the distances at which rays end, by their final intervals."""
    final = out.histograms[-1]
    return depth_deviation(final.w, s_to_t(final.s, model.sampler, ray_ops(model.backend)))


def resized(cameras: Cameras, factor: float) -> Cameras:
    """The same cameras with `factor` times as many pixels along each side, rounded to whole ones.

    Intrinsics follow the true ratio of the sizes, an axis each.  Raises ConfigError unless 0 < factor < inf
    and a view fits into memory.
    """
    if not 0 < factor < float("inf"):
        raise ConfigError(f"Views are resized by a positive factor, but got {factor}.")
    width, height = (cameras.size_px.double() * factor).amax(0).tolist()
    require_memory(
        VIEW_BYTES * width * height,
        f"A view of {width:.10g}x{height:.10g} pixels",
        "Render at a smaller scale.",
    )
    size = (cameras.size_px * factor).round().long().clamp_min(1)
    ratio = size / cameras.size_px
    return Cameras(
        R_scene_camera=cameras.R_scene_camera,
        centre=cameras.centre,
        focal_px=cameras.focal_px * ratio,
        principal_px=cameras.principal_px * ratio,
        distortion=cameras.distortion,
        size_px=size,
    )
