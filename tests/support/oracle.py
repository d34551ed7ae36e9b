"""Models with known answers, to measure rendering and evaluation against.

The tiny scene's oracle traces the scene of conftest.py (a ball on a chequered floor) exactly; the plane's
shows where each ray hits a plane.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from plnerf.field.config import DensityConfig, RadianceConfig
from plnerf.ops.grid import GridShape
from plnerf.rays.rays import Rays, pixel_rays
from plnerf.render.config import ModelConfig, SamplerConfig
from plnerf.render.model import PLNeRF
from plnerf.render.system import RenderedRays
from plnerf.scene.cameras import Cameras
from plnerf.scene.scene import Scene
from plnerf.scene.transforms import Frames
from plnerf.train.config import RunConfig
from plnerf.train.run import TrainedRun
from plnerf.train.scene_record import SceneRecord

FAR = 1000.0


def tiny_config(normals: bool = True) -> ModelConfig:
    """The smallest model that has all parts."""
    grid = GridShape(levels=2, coarsest=4, finest=8, features=4, log2_table=8)
    return ModelConfig(
        field=RadianceConfig(grid, hidden=8, feature=4, appearance=3, normals=normals),
        proposals=(DensityConfig(grid, hidden=4),),
        sampler=SamplerConfig(proposals=(8,), final=6),
    )


@dataclass(frozen=True)
class Seen:
    """What rays see: colours, distance (infinite where nothing), unit normals."""

    colour: Tensor
    t: Tensor
    normal: Tensor


class Oracle(PLNeRF):
    """A PLNeRF whose forward pass is a function of the rays that is known; remembers what it was asked."""

    def __init__(self, see: Callable[[Rays], Seen], images: int = 1, normals: bool = True) -> None:
        super().__init__(tiny_config(normals), images, "torch", torch.Generator().manual_seed(0))
        self.see = see
        self.chunks: list[int] = []
        self.cameras: set[int] = set()
        self.appearances: list[Tensor] = []

    def forward(self, rays: Rays, *, appearance: Tensor, normals: bool = False) -> RenderedRays:  # type: ignore[override]  # fewer options
        self.chunks.append(len(rays))
        self.cameras.update(rays.camera.tolist())
        self.appearances.append(appearance)
        seen = self.see(rays)
        hit = torch.isfinite(seen.t)
        t = torch.where(hit, seen.t, FAR)
        return RenderedRays(
            colour=seen.colour,
            accumulation=hit.float(),
            depth=1.25 * t,  # unlike the median, so that none is mistaken for the other
            depth_median=t,
            normals=seen.normal * hit[:, None] if normals else None,
            histograms=(),
            normal_samples=None,
        )


def plane(normal: Tensor, offset: float) -> Callable[[Rays], Seen]:
    """The plane {x : normal . x = offset}; a ray's colour is the point that it hits."""

    def see(rays: Rays) -> Seen:
        t = (offset - rays.origins @ normal) / (rays.directions @ normal)
        t = torch.where(t > 0, t, torch.inf)
        point = rays.origins + torch.where(torch.isfinite(t), t, 0)[:, None] * rays.directions
        return Seen(point, t, normal.expand(len(rays), 3))

    return see


def tiny_world(frames: Frames) -> Callable[[Rays], Seen]:
    """The ball on the floor of conftest.py, for rays of the scene frame."""
    R, scale = torch.from_numpy(frames.R_scene_world), frames.scale

    def see(rays: Rays) -> Seen:
        o = torch.from_numpy(frames.to_world(rays.origins.double().numpy()))
        d = rays.directions.double() @ R
        to_ball = o - torch.tensor([0.0, 0.0, 0.5])
        b = (d * to_ball).sum(-1)
        root = b * b - ((to_ball * to_ball).sum(-1) - 0.25)
        t_ball = torch.where(root > 0, -b - root.clamp_min(0).sqrt(), torch.inf)
        t_floor = torch.where(d[:, 2] < 0, -o[:, 2] / d[:, 2].clamp_max(-1e-9), torch.inf)
        t = torch.minimum(t_ball, t_floor)
        x = o + torch.where(torch.isfinite(t), t, 0)[:, None] * d
        dark = (torch.floor(x[:, :2] / 0.5).sum(-1) % 2)[:, None]
        floor = 60 + 120 * dark * torch.tensor([1.0, 0.8, 0.6])
        normal = (x - torch.tensor([0.0, 0.0, 0.5])) / 0.5
        shade = 0.5 + 0.5 * (normal @ torch.tensor([0.3, 0.2, 0.93]).double()).clamp(-1, 1)
        ball = shade[:, None] * torch.tensor([230.0, 60.0, 40.0])
        colour = torch.where(torch.isfinite(t)[:, None], floor, torch.full_like(floor, 200.0))
        on_ball = (t_ball < t_floor)[:, None]
        colour = torch.where(on_ball, ball, colour)
        up = torch.tensor([0.0, 0.0, 1.0]).double()
        n = torch.where(on_ball, normal, up) @ R.T
        return Seen((colour / 255).float(), (t * scale).float(), n.float())

    return see


def z_depth_mm(scene: Scene, i: int) -> np.ndarray:
    """True depth of a tiny image along its camera's axis in millimetres, uint16, 0 for the sky."""
    rows, columns = torch.meshgrid(torch.arange(32), torch.arange(48), indexing="ij")
    pixels = torch.stack([columns, rows], -1).reshape(-1, 2) + 0.5
    rays = pixel_rays(scene.cameras, torch.full((32 * 48,), i), pixels)
    t = tiny_world(scene.frames)(rays).t / scene.frames.scale
    z = t * (rays.directions @ scene.cameras.R_scene_camera[i, :, 2])
    mm = torch.where(torch.isfinite(z), (z * 1000).round(), 0).clamp(max=65535)
    return mm.numpy().astype(np.uint16).reshape(32, 48)


def oracle_run(scene: Scene, folder: Path, see: Callable[[Rays], Seen] | None = None) -> TrainedRun:
    """A finished run of the tiny scene whose model knows everything."""
    model = Oracle(see or tiny_world(scene.frames), len(scene.names))
    config = RunConfig(
        scene=str(scene.root),
        downscale=1,
        preset="oracle",
        backend="torch",
        device="cpu",
        model=model.config,
        steps=7,
    )
    run = TrainedRun(folder, config, SceneRecord.of(scene), model.eval(), 7, 1.5)
    run.__dict__["scene"] = scene  # as the cached property keeps it
    return run


def one_camera(
    R: Tensor | None = None,
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0),
    size: tuple[int, int] = (13, 9),
    focal: float = 11.0,
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0),
) -> Cameras:
    """A camera that looks along +z unless turned."""
    return Cameras(
        R_scene_camera=(torch.eye(3) if R is None else R)[None],
        centre=torch.tensor([centre]),
        focal_px=torch.tensor([[focal, focal * 1.1]]),
        principal_px=torch.tensor([[size[0] / 2 + 0.7, size[1] / 2 - 0.4]]),
        distortion=torch.tensor([distortion]),
        size_px=torch.tensor([size]),
    )
