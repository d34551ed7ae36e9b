"""A trained radiance field to ask from Python: world coordinates in, world lengths out, NumPy arrays.

    run = plnerf.open_run("runs/span")
    sigma = run.field.density(points)                # (..., 3) -> (...), in 1/world unit
    view = run.field.render(run.field.cameras[0])    # colour, depth, accumulation

The world is that of the scene's transforms.json: metres and z up where the capture is georeferenced.  The
photos are not needed.  Colours are those of the mean appearance of the training images.
"""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Float32, Float64
from torch import Tensor

from plnerf.errors import ConfigError
from plnerf.rays.rays import Rays
from plnerf.render.query import FieldValues, query
from plnerf.render.system import RadianceSystem
from plnerf.render.views import default_chunk, render_view
from plnerf.scene.cameras import Cameras
from plnerf.train.scene_record import SceneRecord


@dataclass(frozen=True, eq=False)
class Camera:
    """A camera in the world: pinhole with OPENCV distortion, axes x right, y down, z forward."""

    T_world_camera: Float64[np.ndarray, "4 4"]
    focal_px: tuple[float, float]
    principal_px: tuple[float, float]
    size_px: tuple[int, int]
    """Width and height."""
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)
    """k1 k2 p1 p2 k3."""
    name: str | None = None
    """The image that was taken from here, if any."""


@dataclass(frozen=True, eq=False)
class Seen:
    """What rays see, in the shape of what was asked: (...) rays, or rows and columns of an image."""

    colour: Float32[np.ndarray, "*s 3"]
    """In [0, 1], encoded as the photos are (sRGB)."""
    depth: Float64[np.ndarray, "*s"]
    """Distance along the ray, in world units, at which half of the light is stopped; infinite where it is
    not."""
    accumulation: Float32[np.ndarray, "*s"]
    """Share of the light that is stopped."""


class Field:
    """The radiance field of a trained run."""

    def __init__(self, model: RadianceSystem, record: SceneRecord) -> None:
        self.model, self.record = model, record
        self.frames = record.frames
        with torch.no_grad():
            train = torch.tensor(record.train, device=model.appearance.device)
            self._appearance = model.mean_appearance(1, train)[0]

    @property
    def unit(self) -> str:
        """Of the world: "m", or "unscaled" where nothing gives it a scale."""
        return self.frames.unit

    @property
    def cameras(self) -> tuple[Camera, ...]:
        """The cameras of the scene's images, in the order of their names."""
        return tuple(self._camera(i) for i in range(len(self.record.names)))

    def density(self, x_world: Float[np.ndarray, "*s 3"]) -> Float64[np.ndarray, "*s"]:
        """Density in 1/world unit: light passes a distance d of it with probability exp(-density d)."""
        density = self._query(x_world, None).density.double() * self.frames.length_to_scene(1.0)
        return density.numpy().reshape(x_world.shape[:-1])

    def features(self, x_world: Float[np.ndarray, "*s 3"]) -> Float32[np.ndarray, "*s G"]:
        """The vectors that the density network hands on to the colour network."""
        return self._query(x_world, None).feature.numpy().reshape(*x_world.shape[:-1], -1)

    def colour(
        self, x_world: Float[np.ndarray, "*s 3"], direction_world: Float[np.ndarray, "*#s 3"]
    ) -> Float32[np.ndarray, "*s 3"]:
        """Colour in [0, 1] of points seen along directions, which point away from the viewer."""
        return self._query(x_world, direction_world).colour.numpy().reshape(x_world.shape)

    def along(
        self,
        origins_world: Float[np.ndarray, "*s 3"],
        directions_world: Float[np.ndarray, "*#s 3"],
        *,
        pixel_rad: float | None = None,
    ) -> Seen:
        """What rays from origins along directions see.

        pixel_rad: angle that a ray stands for; None: that of a pixel of the training images.
        """
        shape = origins_world.shape[:-1]
        origins = self._scene_points(origins_world)
        directions = self._scene_directions(directions_world, shape)
        pixel_rad = 1 / float(self.record.cameras.focal_px.mean()) if pixel_rad is None else pixel_rad
        radius = torch.full((len(origins),), 2 / 12**0.5 * pixel_rad)
        rays = Rays(origins, directions, radius, torch.zeros(len(origins), dtype=torch.int64))
        chunk, device, parts = default_chunk(self.model), self._appearance.device, list[Tensor]()
        with torch.inference_mode():
            for first in range(0, len(rays), chunk):
                few = rays[slice(first, first + chunk)].to(device)
                out = self.model(few, appearance=self._appearance.expand(len(few), -1))
                columns = (out.colour, out.accumulation[:, None], out.depth_median[:, None])
                parts.append(torch.cat(columns, -1).float().cpu())
        table = torch.cat(parts or [torch.zeros(0, 5)]).numpy().reshape(*shape, 5)
        return self._seen(table[..., :3], table[..., 4], table[..., 3])

    def render(self, camera: Camera) -> Seen:
        """The image of one camera, every pixel rendered."""
        view = render_view(self.model, self._scene_camera(camera), self._appearance, normals=False)
        return self._seen(view.rgb, view.depth_median, view.accumulation)

    def _query(
        self, x_world: Float[np.ndarray, "*s 3"], direction_world: Float[np.ndarray, "*#s 3"] | None
    ) -> FieldValues:
        """The field at points, one row each, on the CPU."""
        points = self._scene_points(x_world)
        down = np.array([0.0, 0.0, -1.0]) if direction_world is None else direction_world
        directions = self._scene_directions(down, x_world.shape[:-1])
        chunk, device = default_chunk(self.model) * self.model.sampler.final, self._appearance.device
        parts = []
        with torch.inference_mode():
            for first in range(0, max(len(points), 1), chunk):
                few = slice(first, first + chunk)
                at, along = points[few].to(device), directions[few].to(device)
                found = query(self.model, at, along, self._appearance)
                parts.append([value.float().cpu() for value in found])
        return FieldValues(*(torch.cat(columns) for columns in zip(*parts, strict=True)))

    def _scene_points(self, x_world: Float[np.ndarray, "*s 3"]) -> Float[Tensor, "n 3"]:
        return torch.from_numpy(self.frames.to_scene(x_world).reshape(-1, 3)).float()

    def _scene_directions(
        self, d_world: Float[np.ndarray, "*#s 3"], shape: tuple[int, ...]
    ) -> Float[Tensor, "n 3"]:
        turned = np.broadcast_to(self.frames.direction_to_scene(d_world), (*shape, 3)).reshape(-1, 3)
        length = np.linalg.norm(turned, axis=-1, keepdims=True)
        if not (np.isfinite(length) & (length > 0)).all():
            raise ConfigError("Directions must be finite and longer than 0, but some are not.")
        return torch.from_numpy(turned / length).float()

    def _camera(self, i: int) -> Camera:
        one = self.record.cameras[[i]]
        R, centre = one.R_scene_camera[0].double().numpy(), one.centre[0].double().numpy()
        fx, fy = one.focal_px[0].tolist()
        cx, cy = one.principal_px[0].tolist()
        width, height = one.size_px[0].tolist()
        k1, k2, p1, p2, k3 = one.distortion[0].tolist()
        return Camera(
            self.frames.pose_to_world(R, centre), (fx, fy), (cx, cy), (width, height), (k1, k2, p1, p2, k3),
            self.record.names[i],
        )  # fmt: skip

    def _scene_camera(self, camera: Camera) -> Cameras:
        R, centre = self.frames.pose_to_scene(camera.T_world_camera)
        return Cameras(
            R_scene_camera=torch.from_numpy(R[None]).float(),
            centre=torch.from_numpy(centre[None]).float(),
            focal_px=torch.tensor([camera.focal_px]),
            principal_px=torch.tensor([camera.principal_px]),
            distortion=torch.tensor([camera.distortion]),
            size_px=torch.tensor([camera.size_px], dtype=torch.int64),
        )

    def _seen(
        self,
        rgb: Float[np.ndarray, "*s 3"],
        depth: Float[np.ndarray, "*s"],
        accumulation: Float[np.ndarray, "*s"],
    ) -> Seen:
        world = self.frames.depth_to_world(depth.astype(np.float64))
        clipped = np.clip(rgb, 0.0, 1.0).astype(np.float32)
        return Seen(clipped, np.where(accumulation >= 0.5, world, np.inf), accumulation.astype(np.float32))
