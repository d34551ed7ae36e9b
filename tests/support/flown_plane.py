"""A flight over textured, uneven ground whose photos are exact, and whose poses may be off."""

import json
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float, UInt8
from scipy.spatial.transform import Rotation

SIZE, FOCAL = (320, 240), 300.0
SIDE_M, CELL_PX = 60.0, 12
HEIGHT_M = 20.0


def texture(seed: int = 0, side: int = 1200) -> UInt8[np.ndarray, "s s"]:
    """Blobs of many sizes."""
    rng, out = np.random.default_rng(seed), np.zeros((side, side), np.float32)
    for cell in (4, 8, 16, 40):
        few = rng.standard_normal((side // cell, side // cell)).astype(np.float32)
        out += cv2.resize(few, (side, side), interpolation=cv2.INTER_CUBIC)
    return np.clip(128 + 28 * out, 0, 255).astype(np.uint8)


def flight(views: int = 12, seed: int = 1) -> list[Float[np.ndarray, "4 4"]]:
    """T_world_camera (OpenCV) of two passes over the ground, looking down and a little aside."""
    rng, poses = np.random.default_rng(seed), []
    for k in range(views):
        side = 1 if k % 2 else -1
        centre = [-10 + 20 * k / (views - 1), 4.0 * side, HEIGHT_M + rng.uniform(-2, 2)]
        T = np.eye(4)
        tilt = Rotation.from_euler("xz", [np.pi + side * 0.2, rng.uniform(-0.2, 0.2)])
        T[:3, :3], T[:3, 3] = tilt.as_matrix(), centre
        poses.append(T)
    return poses


def photo(
    ground: UInt8[np.ndarray, "s s"], T: Float[np.ndarray, "4 4"]
) -> UInt8[np.ndarray, "h w 3"]:
    """What a camera without distortion sees of the ground z = 0, in which pixel centres lie at +0.5."""
    w, h = SIZE
    K = np.array([[FOCAL, 0, w / 2], [0, FOCAL, h / 2], [0, 0, 1]])
    R, c = T[:3, :3].T, T[:3, 3]
    per_m = len(ground) / SIDE_M
    world_of_texture = np.array([[1 / per_m, 0, -SIDE_M / 2], [0, 1 / per_m, -SIDE_M / 2], [0, 0, 1]])
    H = K @ np.column_stack([R[:, 0], R[:, 1], -R @ c]) @ world_of_texture
    half = np.array([[1, 0, -0.5], [0, 1, -0.5], [0, 0, 1]])  # OpenCV's centres are whole numbers
    H = half @ H @ np.linalg.inv(half)
    return np.repeat(cv2.warpPerspective(ground, H, SIZE, flags=cv2.INTER_AREA)[..., None], 3, 2)


def write_flight(
    folder: Path, *, off_m: float = 0.0, off_deg: float = 0.0, seed: int = 2, views: int = 12
) -> list[Float[np.ndarray, "4 4"]]:
    """Writes a scene folder whose poses are off by normal errors; returns the true poses by name."""
    (folder / "images").mkdir(parents=True)
    rng, ground, true, frames = np.random.default_rng(seed), texture(), flight(views), []
    for k, T in enumerate(true):
        name = f"images/{k:03d}.png"
        cv2.imwrite(str(folder / name), photo(ground, T))
        given = T.copy()
        given[:3, 3] += off_m * rng.standard_normal(3)
        turn = Rotation.from_rotvec(np.radians(off_deg) * rng.standard_normal(3)).as_matrix()
        given[:3, :3] = turn @ given[:3, :3]
        frames.append({"file_path": name, "transform_matrix": (given * [1.0, -1.0, -1.0, 1.0]).tolist()})
    w, h = SIZE
    lens = {"w": w, "h": h, "fl_x": FOCAL, "fl_y": FOCAL, "cx": w / 2, "cy": h / 2}
    content = {**lens, "camera_model": "OPENCV", "frames": frames, "plnerf": {"unit": "m", "up": [0, 0, 1]}}
    (folder / "transforms.json").write_text(json.dumps(content))
    return true
