"""Pictures of a trained field from any place, strip by strip: one that nobody waits for is given up."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal, get_args

import numpy as np
import torch
from jaxtyping import Float, UInt8

from plnerf.render.pictures import (
    Colours,
    DepthRange,
    accumulation_picture,
    depth_picture,
    depth_range,
    inferno,
    normals_picture,
    rgb_picture,
    uncertainty_picture,
    viridis_r,
    world_depth,
    world_deviation,
)
from plnerf.render.pruning import Pruning, pruning_pays
from plnerf.render.views import RenderedView, render_view
from plnerf.scene.cameras import Cameras
from plnerf.train.run import TrainedRun
from plnerf.view.display_frame import DisplayFrame
from plnerf.view.eye import Eye
from plnerf.view.turns import Turns

Layer = Literal["rgb", "depth", "normals", "uncertainty", "accumulation"]
LENGTHS: dict[Layer, tuple[Colours, str]] = {
    "depth": (viridis_r, "Depth along the camera's axis; grey: no surface"),
    "uncertainty": (inferno, "Standard deviation of where rays end; grey: no surface"),
}
"""The layers that show lengths: their colours, and what they show."""
STRIP_RAYS, TRAINING_STRIP_RAYS = 8192, 2048
"""Between two of these a picture may be given up; of a field in training a step is taken."""
FAR = 160.0
"""Depth of what has no surface, in the viewer's units: the farthest that viser sends is 167."""


@dataclass(frozen=True, eq=False)
class FieldPicture:
    """What an eye sees of a field."""

    picture: UInt8[np.ndarray, "h w 3"]
    depth: Float[np.ndarray, "h w"]
    """Along the eye's axis, in the viewer's units; FAR where there is no surface."""
    shown: DepthRange | None
    """The lengths at both ends of the colours of depth and uncertainty; None for other layers."""


class FieldPictures:
    """Renders one run.  To be called from one thread at a time: kernels share their pool of threads."""

    def __init__(self, run: TrainedRun, frame: DisplayFrame, turns: Turns | None = None) -> None:
        """turns: of a run that is being trained, whose thread then renders."""
        self._run, self._frame, self._turns = run, frame, turns
        self._train = torch.tensor(run.record.train, device=run.model.appearance.device)
        self._strip_rays = STRIP_RAYS if turns is None else TRAINING_STRIP_RAYS
        self._pruning = Pruning() if pruning_pays(run.model) else None

    @property
    def layers(self) -> tuple[Layer, ...]:
        """What there is to show of this field."""
        return tuple(one for one in get_args(Layer) if one != "normals" or self._run.model.predicts_normals)

    def render(
        self,
        eye: Eye,
        layer: Layer,
        rays: int,
        *,
        shown: DepthRange | None = None,
        goes_on: Callable[[], bool] = lambda: True,
        through: Callable[[Callable[[], RenderedView]], RenderedView] = lambda strip: strip(),
    ) -> FieldPicture | None:
        """A picture of about so many pixels; None where `goes_on` is false between two strips.

        Colours are pruned where that is faster (`render/pruning.py`).  shown: range of a picture of depths or
        of uncertainty; None: its own.  through: calls what renders a strip, and returns what that returns; a
        picture asked for by another thread is rendered by the right one.
        """
        frames = self._run.record.frames
        camera = self._frame.scene_camera(frames, eye.camera(rays))
        parts: list[RenderedView] = []
        for strip in strips(camera, self._strip_rays):
            if parts and not goes_on():
                return None
            parts.append(through(partial(self._view, strip, layer, self._pruning)))
        view = joined(parts)
        depth = self._frame.depth_to_viewer(frames, view.z_depth.astype(np.float64))
        depth = np.where(view.has_surface, np.clip(depth, 0.0, FAR), FAR)
        if layer in {"depth", "uncertainty"}:
            metres = world_depth(view, frames) if layer == "depth" else world_deviation(view, frames)
            shown = shown or depth_range([metres], frames)
            picture = depth_picture if layer == "depth" else uncertainty_picture
            return FieldPicture(picture(metres, shown), depth, shown)
        return FieldPicture(self._picture(view, layer), depth, None)

    def _view(self, camera: Cameras, layer: Layer, pruning: Pruning | None) -> RenderedView:
        model = self._run.model

        def rendered() -> RenderedView:
            with torch.no_grad():
                appearance = model.mean_appearance(1, self._train)[0].clone()
            return render_view(
                model, camera, appearance, normals=layer == "normals", deviation=layer == "uncertainty",
                pruning=pruning,
            )  # fmt: skip

        return rendered() if self._turns is None else self._turns.take(rendered)

    def _picture(self, view: RenderedView, layer: Layer) -> UInt8[np.ndarray, "h w 3"]:
        if layer == "normals":
            return normals_picture(view)
        if layer == "accumulation":
            return np.repeat(accumulation_picture(view.accumulation)[..., None], 3, 2)
        return rgb_picture(view.rgb)

    def along(self, eye: Eye, direction: Float[np.ndarray, "3"]) -> float | None:
        """How far from the eye along a direction the field's surface is, LineFrame; None: there is none."""
        z = direction / np.linalg.norm(direction)
        x = np.linalg.svd(z[None])[2][1]
        one = Eye(np.stack([x, np.cross(z, x), z], 1), eye.centre, 1e-3, 1.0)
        frames = self._run.record.frames
        camera = self._frame.scene_camera(frames, one.camera(1))
        view = self._view(camera, "depth", None)
        depth = self._frame.depth_to_viewer(frames, view.z_depth.astype(np.float64))
        return float(depth[0, 0]) if view.has_surface[0, 0] else None


def strips(camera: Cameras, rays: int) -> list[Cameras]:
    """The camera's picture from the top in strips of about so many pixels, as cameras of their own."""
    width, height = camera.size_px[0].tolist()
    rows = max(1, rays // width)
    found = []
    for first in range(0, height, rows):
        shift = torch.tensor([[0.0, first]], dtype=camera.principal_px.dtype)
        size = torch.tensor([[width, min(rows, height - first)]])
        found.append(replace(camera, principal_px=camera.principal_px - shift, size_px=size))
    return found


def joined(parts: list[RenderedView]) -> RenderedView:
    """Strips below each other as one view."""

    def stacked(name: str) -> np.ndarray:
        return np.concatenate([getattr(part, name) for part in parts])

    return RenderedView(
        rgb=stacked("rgb"),
        accumulation=stacked("accumulation"),
        depth=stacked("depth"),
        depth_median=stacked("depth_median"),
        z_depth=stacked("z_depth"),
        normals=None if parts[0].normals is None else stacked("normals"),
        depth_deviation=None if parts[0].depth_deviation is None else stacked("depth_deviation"),
    )
