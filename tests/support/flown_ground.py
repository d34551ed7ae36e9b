"""A small made-up capture: photos of rough ground from tracks of an aircraft, through a lens that bends."""

import json
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

from plnerf.synth.hang_views import PhotoView

WIDTH, HEIGHT, FOCAL = 240, 160, 200.0
LENS = (-0.08, 0.03, 0.001, -0.002, 0.0)
HIGH = 10.0
"""Height of the cameras over the ground z = 0, metres."""
METRE_PX = 40.0
"""Pixels of the ground's picture per metre."""


def views(tracks: tuple[float, ...] = (-2.0, 2.0), each: int = 5) -> list[PhotoView]:
    """Cameras that look down, flown along x at several y."""
    R = np.array([[1.0, 0, 0], [0, -1, 0], [0, 0, -1]])
    found = []
    for track in tracks:
        for i in range(each):
            centre = np.array([1.5 * (i - (each - 1) / 2), track, HIGH])
            name = f"{len(found):04d}.jpg"
            found.append(
                PhotoView(name, Path(name), R, centre, np.array([FOCAL, FOCAL + 1]),
                          np.array([121.0, 79.0]), np.array(LENS), WIDTH, HEIGHT)
            )  # fmt: skip
    return found


def ground(size_px: int = 1600) -> np.ndarray:
    """Grey patches of all sizes, uint8 (n, n, 3); its middle is the world's origin."""
    random = np.random.default_rng(5)
    total = np.zeros((size_px, size_px))
    for cells in (12, 50, 200, 800):
        noise = random.standard_normal((cells, cells))
        total += cv2.resize(noise, (size_px, size_px), interpolation=cv2.INTER_CUBIC)
    grey = 110 + 28 * total / total.std()
    return np.clip(grey[..., None] * [1.0, 0.95, 0.8], 0, 255).astype(np.uint8)


def photo(view: PhotoView, picture: np.ndarray) -> np.ndarray:
    """What a camera sees of the ground."""
    x, y = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
    plane = view.plane(np.stack([x, y], -1).reshape(-1, 2))
    rays = np.column_stack([plane, np.ones(len(plane))]) @ view.R_world_camera.T
    hit = view.centre + rays * (-view.centre[2] / rays[:, 2:])
    at = (hit[:, :2] * METRE_PX + picture.shape[0] / 2 - 0.5).astype(np.float32).reshape(HEIGHT, WIDTH, 2)
    return cv2.remap(picture, at[..., 0], at[..., 1], cv2.INTER_AREA)


def write_capture(folder: Path, tracks: tuple[float, ...] = (-2.0, 2.0), each: int = 5) -> Path:
    """The photos as JPEG with EXIF, and transforms.json."""
    (folder / "images").mkdir(parents=True)
    picture, frames = ground(), []
    exif = Image.Exif()
    exif[0x010F] = "maker"
    for view in views(tracks, each):
        Image.fromarray(photo(view, picture)).save(
            folder / "images" / view.name, quality=88, subsampling=1, exif=exif, comment=b"flown"
        )
        pose = view.T_world_camera_opengl().tolist()
        frames.append({"file_path": f"images/{view.name}", "transform_matrix": pose})
    names = ("k1", "k2", "p1", "p2", "k3")
    content = {
        "w": WIDTH, "h": HEIGHT, "fl_x": FOCAL, "fl_y": FOCAL + 1, "cx": 121.0, "cy": 79.0,
        **dict(zip(names, LENS, strict=True)),
        "plnerf": {"format_version": 1, "unit": "m", "crs": None, "up": [0, 0, 1]},
        "frames": frames,
    }  # fmt: skip
    (folder / "transforms.json").write_text(json.dumps(content))
    return folder
