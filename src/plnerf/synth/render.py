"""Pictures of parts by Mitsuba 3: photographs, wire coverage and depth.  The only file that knows Mitsuba.

The scalar variant is used: it runs on all cores and needs nothing but the wheel, where the LLVM variant asks
for a system library.  Pixel (0, 0) covers [0, 1] x [0, 1] of the image plane and is the plain mean of its
samples (box filter).
"""

import importlib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8

from plnerf.errors import ConfigError
from plnerf.synth.capture import View
from plnerf.synth.config import ImageConfig
from plnerf.synth.flight_config import CaptureConfig
from plnerf.synth.meshes import write_ply
from plnerf.synth.parts import Part, Surface
from plnerf.synth.tiles import TILE_PX, Window, strips, tiles_of

COVERAGE_SAMPLES = 36  # per pixel, one in each cell of a 6 x 6 grid
BOUNCES = 3
NEAR_M = 0.05  # where Mitsuba's camera rays begin, on a plane across the camera's z axis


@dataclass(frozen=True)
class Studio:
    """The loaded scenes of one site; nothing in it changes between pictures."""

    mi: Any
    capture: CaptureConfig
    image: ImageConfig
    lit: Any
    wires_only: Any  # wires shine, all else is black: what is left of them is what is seen of them
    wire_faces: Float[np.ndarray, "f 3 3"]  # corners of the wires' triangles, world, metres

    def photo(self, view: View, seed: int) -> UInt8[np.ndarray, "h w 3"]:
        """The view in sRGB at the fixed exposure."""
        return to_srgb(self.linear((view,), seed))

    def linear(self, instants: Sequence[View], seed: int) -> Float[np.ndarray, "h w 3"]:
        """Linear light at the fixed exposure, 1 is white; the mean over the instants of an open shutter.

        The samples are shared out among the instants, so that blur costs no time.
        """
        integrator = self.mi.load_dict({"type": "path", "max_depth": BOUNCES})
        samples = max(1, round(self.image.samples_per_pixel / len(instants)))
        rows = math.isqrt(samples)  # the sampler fills a grid of cells, and would round with a warning
        samples = rows * -(-samples // rows)
        total = np.zeros((self.capture.height_px, self.capture.width_px, 3))
        for k, view in enumerate(instants):
            sampler = {"type": "multijitter", "sample_count": samples, "seed": seed + (k << 16)}
            total += self._render(self.lit, integrator, view, sampler)[..., :3]
        return total * (self.image.exposure / len(instants))

    def wire_coverage(self, view: View) -> Float[np.ndarray, "h w"]:
        """The fraction of each pixel's area in which a conductor or shield wire is seen.

        Only strips that wires project into are rendered; in all others there is none to be seen.
        """
        capture = self.capture
        integrator = self.mi.load_dict({"type": "path", "max_depth": 1, "block_size": TILE_PX})
        sampler = {"type": "stratified", "sample_count": COVERAGE_SAMPLES, "seed": 0}
        coverage = np.zeros((capture.height_px, capture.width_px))
        for window in strips(tiles_of(self.wire_faces, view, capture), capture):
            x, y, width, height = window
            part = self._render(self.wires_only, integrator, view, sampler, window)[..., 0]
            coverage[y : y + height, x : x + width] = part
        return coverage

    def depth_m(self, view: View) -> Float[np.ndarray, "h w"]:
        """Distance along the camera's z axis of what each pixel's centre sees; 0 for the sky."""
        integrator = self.mi.load_dict({"type": "aov", "aovs": "t:depth"})
        sampler = {"type": "stratified", "sample_count": 1, "jitter": False}
        along_ray = self._render(self.wires_only, integrator, view, sampler)[..., -1]
        height, width = along_ray.shape
        x = (np.arange(width) + 0.5 - width / 2) / self.capture.focal_px
        y = (np.arange(height) + 0.5 - height / 2) / self.capture.focal_px
        along_axis = NEAR_M + along_ray / np.sqrt(1 + x[None] ** 2 + y[:, None] ** 2)
        return np.where(along_ray > 0, along_axis, 0.0)

    def _render(
        self,
        scene: Any,
        integrator: Any,
        view: View,
        sampler: dict[str, object],
        window: Window | None = None,
    ) -> Float[np.ndarray, "h w c"]:
        capture = self.capture
        x, y, width, height = window or (0, 0, capture.width_px, capture.height_px)
        pose = np.eye(4)
        pose[:3, :3] = view.R_world_camera * np.array([-1.0, -1.0, 1.0])  # Mitsuba's camera: x left, y up
        pose[:3, 3] = view.centre
        sensor = self.mi.load_dict({
            "type": "perspective",
            "fov_axis": "x",
            "fov": math.degrees(2 * math.atan(capture.width_px / 2 / capture.focal_px)),
            "near_clip": NEAR_M,
            "far_clip": 5000.0,
            "to_world": self.mi.ScalarTransform4f(pose),
            "sampler": sampler,
            "film": {
                "type": "hdrfilm",
                "width": capture.width_px,
                "height": capture.height_px,
                "crop_offset_x": x,
                "crop_offset_y": y,
                "crop_width": width,
                "crop_height": height,
                "pixel_format": "rgb",
                "component_format": "float32",
                "rfilter": {"type": "box"},
            },
        })
        spp, seed = sampler["sample_count"], sampler.get("seed", 0)
        image = self.mi.render(scene, sensor=sensor, integrator=integrator, spp=spp, seed=seed)
        return np.array(image, dtype=np.float64)


def require_mitsuba() -> Any:
    """The mitsuba module with its variant set."""
    try:
        mi = importlib.import_module("mitsuba")
    except ImportError as error:
        raise ConfigError(
            'plnerf synth renders with Mitsuba 3, which is not installed. Run: pip install "plnerf[synth]"'
        ) from error
    mi.set_variant("scalar_rgb")
    return mi


def open_studio(parts: Sequence[Part], capture: CaptureConfig, image: ImageConfig, scratch: Path) -> Studio:
    """Load all parts; `scratch` is an existing folder for meshes, needed only during this call."""
    mi = require_mitsuba()
    lit: dict[str, object] = {"type": "scene", "sky": _sky(mi, image)}
    marked: dict[str, object] = {"type": "scene"}
    for i, part in enumerate(parts):
        path = scratch / f"{i}.ply"
        write_ply(part.mesh, path)
        shape = {"type": "ply", "filename": str(path), "face_normals": not part.mesh.smooth}
        lit[f"part{i}"] = shape | {"bsdf": _bsdf(mi, part.surface)}
        dark = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}}
        marked[f"part{i}"] = shape | {"bsdf": dark}
        if part.wire:
            shining = {"type": "area", "radiance": {"type": "rgb", "value": 1.0}}
            marked[f"part{i}"] = shape | {"bsdf": dark, "emitter": shining}
    faces = [part.mesh.vertices[part.mesh.faces] for part in parts if part.wire]
    wire_faces = np.concatenate([np.zeros((0, 3, 3)), *faces])
    return Studio(mi, capture, image, mi.load_dict(lit), mi.load_dict(marked), wire_faces)


def to_srgb(linear: Float[np.ndarray, "h w 3"]) -> UInt8[np.ndarray, "h w 3"]:
    """IEC 61966-2-1, clipped at 1."""
    x = np.clip(linear, 0.0, 1.0)
    encoded = np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)
    return np.rint(255 * encoded).astype(np.uint8)


def _sky(mi: Any, image: ImageConfig) -> dict[str, object]:
    azimuth, elevation = math.radians(image.sun_azimuth_deg), math.radians(image.sun_elevation_deg)
    direction = [
        math.cos(azimuth) * math.cos(elevation),
        math.sin(azimuth) * math.cos(elevation),
        math.sin(elevation),
    ]
    return {"type": "sunsky", "sun_direction": direction, "turbidity": image.turbidity, "albedo": 0.2}


def _bsdf(mi: Any, surface: Surface) -> dict[str, object]:
    colour: dict[str, object]
    if surface.colour is None:
        colour = {"type": "mesh_attribute", "name": "vertex_color"}
    elif isinstance(surface.colour, np.ndarray):
        bitmap = mi.Bitmap(surface.colour.astype(np.float16))
        colour = {"type": "bitmap", "bitmap": bitmap, "raw": True, "wrap_mode": "clamp"}
    else:
        colour = {"type": "rgb", "value": list(surface.colour)}
    if surface.kind in ("matt", "leaf"):
        return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": colour}}
    metallic, specular = (0.75, 0.5) if surface.kind == "metal" else (0.0, 0.6)
    return {
        "type": "twosided",
        "bsdf": {
            "type": "principled",
            "base_color": colour,
            "metallic": metallic,
            "roughness": surface.roughness,
            "specular": specular,
        },
    }
