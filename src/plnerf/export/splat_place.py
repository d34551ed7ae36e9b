"""Where exported Gaussians lie: local float32 coordinates, and the sidecar that places them on the earth.

    local     axes of the world, counted from a point near the splats, at whole metres: x east, y north, z up
              where the world is; of a scene without scale, or whose z is not up, the axes of its LineFrame
    y-up      the same for glTF:  x_gltf = x,  y_gltf = z,  z_gltf = -y
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from plnerf.errors import PlnerfError
from plnerf.export.crs import CrsTransform, crs_transform
from plnerf.export.splats import Splats
from plnerf.line.cloud import Cloud
from plnerf.line.frame import LineFrame
from plnerf.line.survey import Survey
from plnerf.scene.files import write_text

SIDECAR_VERSION = 1
Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""From local axes to glTF's."""
DRAWN = (
    "The last {count} Gaussians are wires, drawn for display along the curves that were fitted to them; they "
    "are not what the field shows."
)


@dataclass(frozen=True, eq=False)
class Placement:
    """From the LineFrame to local coordinates, and what these are."""

    frame: LineFrame
    origin_line: Float[np.ndarray, "3"]
    """The local origin, LineFrame."""
    transform: CrsTransform | None
    """None: nothing is known of the earth (see `why`)."""
    why: str | None = None

    @property
    def in_world(self) -> bool:
        """Whether local axes are those of the world."""
        return self.frame.unit == "m" and self.frame.upright

    @property
    def R_local_line(self) -> Float[np.ndarray, "3 3"]:
        """The rotation of the axes."""
        if not self.in_world:
            return np.eye(3)
        axes: Float[np.ndarray, "3 3"] = self.frame.to_world(np.eye(3)) - self.frame.to_world(np.zeros(3))
        return axes.T

    def local(self, splats: Splats) -> Splats:
        """Gaussians of the LineFrame in local coordinates."""
        R = self.R_local_line
        return splats.moved(R, -R @ self.origin_line)

    def to_json(self) -> dict[str, Any]:
        """What a program needs to place the files; plain values."""
        origin = self.origin_line[None]
        world = self.frame.to_world(origin)[0] if self.in_world else self.origin_line
        T_world_local = np.eye(4)
        T_world_local[:3, 3] = world
        T_world_gltf = T_world_local.copy()
        T_world_gltf[:3, :3] = Y_UP.T
        found: dict[str, Any] = {
            "unit": self.frame.unit,
            "axes": {
                "ply, splat": "the world's, z up" if self.in_world else "of the run's own frame, z up",
                "glb": "y up: x_gltf = x, y_gltf = z, z_gltf = -y",
            },
            "origin_in_world": world.tolist(),
            "T_world_local": T_world_local.tolist(),
            "T_world_gltf": T_world_gltf.tolist(),
            "world": "the run's own frame, without a position on the earth",
            "crs": self.frame.crs,
            "origin_crs": None,
            "origin_lon_lat_height": None,
            "about": [self.why] * (self.why is not None),
        }
        if self.transform is None or not self.in_world:
            return found
        found["world"] = self.transform.world_reference
        found["about"] = list(self.transform.about)
        if self.transform.crs is not None:
            found["origin_crs"] = self.transform.to_map(origin)[0].tolist()
        if self.transform.earth is not None:
            found["origin_lon_lat_height"] = self.transform.to_lon_lat(origin)[0].tolist()
        return found


def placement(frame: LineFrame, xyz: Float[np.ndarray, "n 3"], source: str) -> Placement:
    """The placement of Gaussians of a run, whose origin is near the middle of points of them, LineFrame."""
    start = Placement(frame, np.zeros(3), None)
    middle = np.median(xyz, axis=0) if len(xyz) else np.zeros(3)
    if start.in_world:  # whole metres of the world, so that float32 is exact about it
        middle = frame.from_world(np.round(frame.to_world(middle)))
    few = xyz[:: max(1, len(xyz) // 1000)]
    cloud = Cloud(few, np.ones(len(few), np.uint8), np.zeros(len(few), np.int64))
    try:
        transform = crs_transform(Survey(frame, (), cloud, source))
    except PlnerfError as error:
        return Placement(frame, middle, None, str(error))
    return Placement(frame, middle, transform)


def write_sidecar(
    path: Path, place: Placement, splats: Splats, files: Mapping[str, str], about: Mapping[str, Any]
) -> None:
    """Writes the JSON beside the files.  files: their names by format; about: further plain values."""
    drawn = {"count": splats.drawn, "first": len(splats) - splats.drawn, "about": about_drawn(splats)}
    content = {
        "format_version": SIDECAR_VERSION, "files": dict(files), "gaussians": len(splats),
        "spherical_harmonics_degree": splats.degree, **place.to_json(), "wires_for_display": drawn, **about,
    }  # fmt: skip
    write_text(path, json.dumps(content, indent=1, allow_nan=False) + "\n")


def about_drawn(splats: Splats) -> str:
    """What a reader must know of the drawn wires."""
    return DRAWN.format(count=f"{splats.drawn:,}") if splats.drawn else "No wires are drawn."
