"""What the Gaussians are fitted to: renders of the field from its own cameras, without lens distortion."""

from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float, UInt8

from plnerf.export.splat_project import Pinhole
from plnerf.line.frame import LineFrame
from plnerf.render.pictures import rgb_picture
from plnerf.render.pruning import Pruning, pruning_pays
from plnerf.render.views import render_view, resized
from plnerf.scene.build_store import Progress
from plnerf.scene.cameras import Cameras
from plnerf.train.evaluate import mean_appearance
from plnerf.train.run import TrainedRun

NEAR = 0.02
"""Nothing is drawn nearer to a camera than this share of the median depth of its render."""


@dataclass(frozen=True, eq=False)
class TargetView:
    """A render of the field, with its camera in the LineFrame."""

    camera: Pinhole
    rgb: UInt8[np.ndarray, "h w 3"]
    z_depth: Float[np.ndarray, "h w"]
    """Median depth along the camera's z axis, in the unit of the LineFrame."""
    surface: Bool[np.ndarray, "h w"]
    """Where a ray more likely ends than not."""


def target_views(
    run: TrainedRun,
    frame: LineFrame,
    cameras: Cameras,
    pixels: int,
    progress: Progress | None = None,
) -> list[TargetView]:
    """Renders of the field from cameras of its scene, of at most `pixels` pixels each.

    frame: the scene's.  The appearance is the mean of the training images'.
    """
    plain = replace(cameras, distortion=torch.zeros_like(cameras.distortion))
    appearance = mean_appearance(run)
    pruning = Pruning() if pruning_pays(run.model) else None
    views = []
    for i in range(len(plain)):
        one = shrunk(plain[[i]], pixels)
        seen = render_view(run.model, one, appearance, normals=False, pruning=pruning)
        depth = frame.from_scene(seen.z_depth.astype(np.float64)).astype(np.float32)
        near = NEAR * float(np.median(depth))
        views.append(
            TargetView(pinhole(frame, one, near), rgb_picture(seen.rgb), depth, seen.has_surface)
        )  # fmt: skip
        if progress is not None:
            progress(i + 1, len(plain))
    return views


def shrunk(camera: Cameras, pixels: int) -> Cameras:
    """One camera with at most about so many pixels."""
    share = pixels / float(camera.size_px.prod())
    return camera if share >= 1 else resized(camera, share**0.5)


def pinhole(frame: LineFrame, camera: Cameras, near: float) -> Pinhole:
    """One camera of a scene in the LineFrame, its distortion left out."""
    moved = frame.cameras(camera)
    w, h = camera.size_px[0].tolist()
    return Pinhole(
        moved.R_scene_camera[0].float(), moved.centre[0].float(), camera.focal_px[0], camera.principal_px[0],
        (w, h), near,
    )  # fmt: skip
