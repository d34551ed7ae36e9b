"""The only place where frames change: file to world, world to scene, OpenGL to OpenCV.

Frames.  ``world``: the file's own frame, metric east-north-up when the file says unit "m", else the unscaled
frame of structure from motion.  ``scene``: world rotated (z up), shifted and scaled isotropically:
as a scene is read, x along the cameras' track and the cameras in [-1, 1]^3; once wires are known, x along
them and their extent in [-1, 1].  Camera axes: OpenCV's (x right, y down, z
forward) inside, OpenGL's (x right, y up, z backward) in transforms.json.  Everything here is float64;
letters: n cameras, R rotations, T rigid 4x4.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from plnerf.errors import SceneError

MAX_POSITION = 1e9
"""Further from the origin, nothing is left of a camera's place in double precision beside what it sees."""
MAX_DRIFT = 1e-3
"""How far a pose's singular values may be from 1: below, it is rounding and is removed; above, it is an
error."""


_UNITS: dict[str, Literal["m", "unscaled"]] = {"m": "m", "unscaled": "unscaled"}


@dataclass(frozen=True, eq=False)
class Frames:
    """The similarity between scene and world: x_scene = scale * R_scene_world (x_world - shift_world)."""

    R_scene_world: Float[np.ndarray, "3 3"]
    scale: float
    """Scene units per world unit."""
    shift_world: Float[np.ndarray, "3"]
    """The world point that is the scene's origin."""
    unit: Literal["m", "unscaled"]
    crs: str | None
    """Coordinate reference system of the survey (such as "EPSG:25832"), or None."""
    up_source: str
    """How gravity was found: "file", or the name of the estimate."""
    origin: Float[np.ndarray, "3"] | None = None
    """Longitude and latitude in degrees, and height in metres above what the heights of `crs` are above, of
    the world's origin, where the world is local east-north-up."""

    @property
    def up_world(self) -> Float[np.ndarray, "3"]:
        """Unit vector against gravity, in the world."""
        up: Float[np.ndarray, 3] = self.R_scene_world[2]
        return up

    def to_scene(self, x_world: Float[np.ndarray, "*b 3"]) -> Float[np.ndarray, "*b 3"]:
        """World coordinates to scene coordinates, float64."""
        turned: Float[np.ndarray, "*b 3"] = (x_world - self.shift_world) @ self.R_scene_world.T
        scaled: Float[np.ndarray, "*b 3"] = turned * self.scale
        return scaled

    def to_world(self, x_scene: Float[np.ndarray, "*b 3"]) -> Float[np.ndarray, "*b 3"]:
        """Scene coordinates to world coordinates, float64."""
        turned: Float[np.ndarray, "*b 3"] = x_scene.astype(np.float64) @ self.R_scene_world
        shifted: Float[np.ndarray, "*b 3"] = turned / self.scale + self.shift_world
        return shifted

    def from_frames(self, old: "Frames") -> tuple[float, Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]:
        """Scale, rotation and shift from another scene frame of the same world to this one:
        x = scale R x_old + shift."""
        R = self.R_scene_world @ old.R_scene_world.T
        shift: Float[np.ndarray, 3] = self.scale * self.R_scene_world @ (old.shift_world - self.shift_world)
        return self.scale / old.scale, R, shift

    def direction_to_scene(self, d_world: Float[np.ndarray, "*b 3"]) -> Float[np.ndarray, "*b 3"]:
        """Directions of the world turned into the scene frame; their lengths stay."""
        turned: Float[np.ndarray, "*b 3"] = d_world @ self.R_scene_world.T
        return turned

    def length_to_scene(self, length: float) -> float:
        """A length of the world in scene units."""
        return length * self.scale

    def length_to_world(self, length: float) -> float:
        """A length of the scene frame in world units."""
        return length / self.scale

    def depth_to_world(self, depth: Float[np.ndarray, "*b"]) -> Float[np.ndarray, "*b"]:
        """Depths of the scene frame in world units."""
        scaled: Float[np.ndarray, "*b"] = depth / self.scale
        return scaled

    def pose_to_scene(
        self, T_world_camera: Float[np.ndarray, "*b 4 4"]
    ) -> tuple[Float[np.ndarray, "*b 3 3"], Float[np.ndarray, "*b 3"]]:
        """Rotation R_scene_camera and centre in the scene frame of a camera in the world."""
        return self.R_scene_world @ T_world_camera[..., :3, :3], self.to_scene(T_world_camera[..., :3, 3])

    def pose_to_world(
        self, R_scene_camera: Float[np.ndarray, "3 3"], centre: Float[np.ndarray, "3"]
    ) -> Float[np.ndarray, "4 4"]:
        """T_world_camera of a camera in the scene frame."""
        T_world_camera = np.eye(4)
        T_world_camera[:3, :3] = self.R_scene_world.T @ R_scene_camera
        T_world_camera[:3, 3] = self.to_world(centre)
        return T_world_camera

    def to_json(self) -> dict[str, object]:
        """Plain JSON values; ``from_json`` gives back the same bits, also through ``json.dumps``."""
        return {
            "R_scene_world": self.R_scene_world.tolist(),
            "scale": self.scale,
            "shift_world": self.shift_world.tolist(),
            "unit": self.unit,
            "crs": self.crs,
            "up_source": self.up_source,
            "origin_lon_lat_height": None if self.origin is None else self.origin.tolist(),
        }

    @classmethod
    def from_json(cls, data: Mapping[str, object]) -> "Frames":
        """The inverse of ``to_json``.  Raises SceneError when a value is absent or of the wrong kind."""
        try:
            rotation = np.array(data["R_scene_world"], dtype=np.float64).reshape(3, 3)
            shift = np.array(data["shift_world"], dtype=np.float64).reshape(3)
            scale = float(np.array(data["scale"], dtype=np.float64).reshape(()))
            unit: Literal["m", "unscaled"] = _UNITS[str(data["unit"])]
            place = data.get("origin_lon_lat_height")
            origin = None if place is None else np.array(place, dtype=np.float64).reshape(3)
        except (KeyError, TypeError, ValueError) as error:
            raise SceneError(
                "The stored frames need R_scene_world (3x3), shift_world (3), scale and unit, but hold "
                f"{sorted(data)} ({error!r}). They were edited or written by another program: make them "
                "again by loading the scene folder."
            ) from error
        crs = data.get("crs")
        return cls(
            R_scene_world=rotation,
            scale=scale,
            shift_world=shift,
            unit=unit,
            crs=None if crs is None else str(crs),
            up_source=str(data.get("up_source", "unknown")),
            origin=origin,
        )


def flip_camera_axes(T_world_camera: Float[np.ndarray, "*b 4 4"]) -> Float[np.ndarray, "*b 4 4"]:
    """OpenGL camera axes to OpenCV's, and back: y and z turn round, so the function is its own inverse."""
    flipped: Float[np.ndarray, "*b 4 4"] = T_world_camera * np.array([1.0, -1.0, -1.0, 1.0])
    return flipped


def rigid_pose(matrix: Float[np.ndarray, "r 4"], where: str) -> Float[np.ndarray, "4 4"]:
    """The rigid 4x4 transform that a file's 3x4 or 4x4 matrix states.

    Singular values of the 3x3 part within ``MAX_DRIFT`` of 1 are rounding: the nearest rotation (in the
    Frobenius norm, U V^T of its SVD) takes its place.  Raises SceneError, naming ``where``, for anything
    further away.
    """
    shape = tuple(matrix.shape)
    if shape not in {(3, 4), (4, 4)}:
        raise SceneError(
            f"{where}: a camera-to-world matrix has 4 rows of 4 numbers (or 3 of 4), but this one has shape "
            f"{shape}. Correct the file, or run the pose estimation again."
        )
    if not np.isfinite(matrix).all():
        raise SceneError(
            f"{where}: the camera-to-world matrix holds NaN or infinity, so this image has no position. "
            "Remove the image from the file, or run the pose estimation again."
        )
    if np.abs(matrix[:3, 3]).max() > MAX_POSITION:
        raise SceneError(
            f"{where}: the camera-to-world matrix puts the camera {np.abs(matrix[:3, 3]).max():g} from the "
            "world's origin, where no camera is. Remove the image from the file, or run the pose estimation "
            "again."
        )
    if shape == (4, 4) and not np.allclose(matrix[3], [0, 0, 0, 1], atol=1e-9):
        raise SceneError(
            f"{where}: the last row of a camera-to-world matrix is 0 0 0 1, but here it is "
            f"{' '.join(f'{v:g}' for v in matrix[3])}. Is the matrix transposed? It is read row by row."
        )
    left, singular, right = np.linalg.svd(matrix[:3, :3])
    values = ", ".join(f"{v:.4g}" for v in singular)
    if singular[2] <= 1e-6 * singular[0]:
        raise SceneError(
            f"{where}: the camera-to-world matrix is singular (singular values {values}; a rotation has 1, "
            "1, 1), so it has no direction of view. Remove the image from the file, or run the pose "
            "estimation again."
        )
    if np.linalg.det(matrix[:3, :3]) < 0:
        raise SceneError(
            f"{where}: the camera-to-world matrix mirrors space (its determinant is negative), which no "
            "camera does. Usually one axis was negated or two were exchanged in a conversion: "
            "transforms.json wants OpenGL camera axes (x right, y up, z backward)."
        )
    if np.abs(singular - 1).max() > MAX_DRIFT:
        raise SceneError(
            f"{where}: the camera-to-world matrix is not rigid (singular values {values}; each must be "
            f"within {MAX_DRIFT:g} of 1). Take scale and shear out of the rotations; a scale of the whole "
            "scene belongs in the positions alone."
        )
    rigid = np.eye(4)
    rigid[:3, :3] = left @ right
    rigid[:3, 3] = matrix[:3, 3]
    return rigid
