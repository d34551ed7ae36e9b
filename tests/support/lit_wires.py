"""Pictures of wires as round bars under a light: as wide as they are near, brighter on one side."""

from collections.abc import Callable

import cv2
import numpy as np
import torch

from plnerf.scene.cameras import Cameras, project

FINE = 8
"""Drawn so many times as large, then averaged."""
STRIPS = 9
DARK, SHINE = 90, 40
"""Grey value of a bar in its middle, and how much brighter it is where it faces the light."""


def draw_lit(
    cameras: Cameras,
    lines: list[np.ndarray],
    diameter: float,
    light: np.ndarray,
    seed: int = 0,
    ground: Callable[[tuple[int, ...]], np.ndarray] | None = None,
    grey: tuple[float, float] = (DARK, SHINE),
) -> list[np.ndarray]:
    """What cameras see of polylines (scene frame) before a background that is now darker, now brighter.

    light: direction to it, scene frame.  ground: another background, by rows and columns.  grey: in place of
    `DARK` and `SHINE`.
    """
    random, pictures = np.random.default_rng(seed), []
    for i in range(len(cameras)):
        width, height = (int(side) for side in cameras.size_px[i])
        row, column = (side / FINE for side in np.ogrid[: height * FINE, : width * FINE])
        behind = 100 + 60 * np.sin(row / 23 + i) + 36 * np.cos(column / 31 + 2 * i)
        if ground is not None:
            behind = cv2.resize(ground((height, width)), (width * FINE, height * FINE))
        picture = behind.astype(np.float32)
        in_camera = light @ cameras.R_scene_camera[i].double().numpy()
        for line in lines:
            pixels, depths = project(cameras[[i]], torch.from_numpy(line).float())
            at, depth = pixels[0].double().numpy(), depths[0].double().numpy()
            _bar(picture, at, depth, diameter * float(cameras.focal_px[i, 0]) / depth, in_camera, grey)
        small = cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA)
        noisy = np.clip(small + random.normal(0, 3, small.shape), 0, 255).astype(np.uint8)
        pictures.append(np.repeat(noisy[..., None], 3, -1))
    return pictures


def _bar(
    picture: np.ndarray, at: np.ndarray, depth: np.ndarray, wide: np.ndarray, light: np.ndarray,
    grey: tuple[float, float],
) -> None:  # fmt: skip
    """Strips side by side, each as bright as it faces the light."""
    tangent = np.gradient(at, axis=0)
    tangent /= np.maximum(np.linalg.norm(tangent, axis=1, keepdims=True), 1e-9)
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], 1)
    clear = (depth > 0.02) & (np.abs(at) < 3000).all(1)
    for x in (np.arange(STRIPS) + 0.5) / STRIPS * 2 - 1:
        value = grey[0] + grey[1] * x * (normal @ light[:2])
        drawn = np.round((at + normal * x * wide[:, None] / 2) * FINE - 0.5).astype(int)
        for j in np.flatnonzero(clear[1:] & clear[:-1]):
            thick = max(1, int(np.ceil(wide[j] * FINE / STRIPS)))
            cv2.line(picture, drawn[j].tolist(), drawn[j + 1].tolist(), float(value[j]), thick)
