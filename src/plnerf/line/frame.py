"""The LineFrame: metric, z up, near the line; entered once from a scene, a world or a CRS, and left once.

    x_line = scale R_line_world (x_world - origin_world)

Of a scene it is the scene frame in metres: the same axes and the same origin.  Nothing else in survey/,
export/, report/ and score/ knows of scales and rotations.  float64 throughout.
"""

from dataclasses import dataclass, fields, replace
from typing import Literal

import numpy as np
from jaxtyping import Float

from plnerf.scene.cameras import Cameras
from plnerf.scene.transforms import Frames

NOMINAL_HALF_M = 20.0
"""Half of an unscaled scene's box is so many units, so that tolerances in metres have the right order."""
MOST_LEAN = 1e-6
"""1 - cosine of the angle by which the world's z may lean from up and still be a height: 0.08 degrees."""


@dataclass(frozen=True, eq=False)
class LineFrame:
    """A similarity of the world, and of the scene if the line was found in one."""

    R_line_world: Float[np.ndarray, "3 3"]
    scale: float
    """Units of this frame per world unit: 1 in metric worlds."""
    origin_world: Float[np.ndarray, "3"]
    unit: Literal["m", "unscaled"]
    """Of lengths in this frame."""
    crs: str | None = None
    """Of the survey, such as "EPSG:28992", or with heights "EPSG:28992+5709"; None: unknown."""
    origin_lon_lat_height: Float[np.ndarray, "3"] | None = None
    """Of the world's origin (degrees, metres above what the heights of `crs` are above) where the world is
    local east-north-up; None: the world's coordinates are those of the CRS, or unknown."""
    scene_per_unit: float | None = None
    """Scene units per unit of this frame; None: there is no scene."""

    @classmethod
    def of_scene(cls, frames: Frames) -> "LineFrame":
        """The scene frame in metres, or, where nothing gives a scale, in units of the box."""
        per_unit = frames.scale if frames.unit == "m" else 1 / NOMINAL_HALF_M
        return cls(
            frames.R_scene_world, frames.scale / per_unit, frames.shift_world, frames.unit, frames.crs,
            frames.origin, per_unit,
        )  # fmt: skip

    @classmethod
    def of_cloud(
        cls, xyz: Float[np.ndarray, "n 3"], crs: str | None,
        origin: tuple[float, float, float] | None = None,
    ) -> "LineFrame":  # fmt: skip
        """Axes of the cloud's own coordinates (metres, z up), its origin at whole metres in their middle.

        origin: `origin_lon_lat_height`.
        """
        middle = np.round((xyz.min(0) + xyz.max(0)) / 2) if len(xyz) else np.zeros(3)
        middle[2] = 0.0  # heights stay what they are
        return cls(np.eye(3), 1.0, middle, "m", crs, None if origin is None else np.array(origin))

    def from_world(self, x: Float[np.ndarray, "*b 3"]) -> Float[np.ndarray, "*b 3"]:
        """World coordinates to this frame's."""
        moved: Float[np.ndarray, "*b 3"] = self.scale * ((x - self.origin_world) @ self.R_line_world.T)
        return moved

    def to_world(self, x: Float[np.ndarray, "*b 3"]) -> Float[np.ndarray, "*b 3"]:
        """The inverse of `from_world`."""
        moved: Float[np.ndarray, "*b 3"] = x @ self.R_line_world / self.scale + self.origin_world
        return moved

    def from_frame(self, old: "LineFrame") -> tuple[float, Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]:
        """Scale, rotation and shift from another frame of the same world: x = scale R x_old + shift."""
        # Origins lie near to one another and may lie far from the world's: their difference loses nothing.
        shift: Float[np.ndarray, 3] = self.scale * self.R_line_world @ (old.origin_world - self.origin_world)
        return self.scale / old.scale, self.R_line_world @ old.R_line_world.T, shift

    def same_as(self, other: "LineFrame") -> bool:
        """Whether coordinates mean the same places in both, to the last bit."""
        arrays = ((self.R_line_world, other.R_line_world), (self.origin_world, other.origin_world))
        return self.scale == other.scale and all(np.array_equal(*pair) for pair in arrays)

    @property
    def similarity(self) -> tuple[float, Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]:
        """`from_world` as scale, rotation and shift: x_line = scale R x_world + shift."""
        shift: Float[np.ndarray, 3] = -self.scale * (self.R_line_world @ self.origin_world)
        return self.scale, self.R_line_world, shift

    @property
    def upright(self) -> bool:
        """Whether the world's z is up as well, so that it is a height."""
        return bool(1 - self.R_line_world[2, 2] < MOST_LEAN)

    def from_scene(self, x: Float[np.ndarray, "*b"]) -> Float[np.ndarray, "*b"]:
        """Points or lengths of the scene frame in this one: the axes and the origin are the same."""
        return x / self._per_unit

    def to_scene(self, x: Float[np.ndarray, "*b"]) -> Float[np.ndarray, "*b"]:
        """The inverse of `from_scene`."""
        return x * self._per_unit

    def cameras(self, cameras: Cameras) -> Cameras:
        """Cameras of the scene in this frame, float64."""
        values = [getattr(cameras, one.name) for one in fields(cameras)]
        found = Cameras(*(value.double() if value.is_floating_point() else value for value in values))
        return replace(found, centre=found.centre / self._per_unit)

    @property
    def _per_unit(self) -> float:
        if self.scene_per_unit is None:
            raise ValueError("this line was not found in a scene")
        return self.scene_per_unit
