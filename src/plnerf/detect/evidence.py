"""Evidence of lines in a direction in each image: the response of a ridge filter in one direction per pixel.

All lines in one direction of space meet in one point of an image, their vanishing point; the direction from a
pixel to it is the only one a wire can have there, but for its sag.  A wire is a ridge across that direction:
the second derivative of the brightness is large across it and small along it.

Letters: images of h x w pixels.
"""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, UInt8

from plnerf.detect.config_lines import EvidenceConfig
from plnerf.detect.ridges import gradient, hessian
from plnerf.scene.cameras import Cameras
from plnerf.scene.images import ImageStore


def line_response(
    image: UInt8[np.ndarray, "h w 3"],
    towards: Float[np.ndarray, "h w 2"],
    config: EvidenceConfig,
) -> Float[np.ndarray, "h w"]:
    """Response of each pixel, 0 to 1, to a line in the given direction (unit vectors x, y).

    The second derivative across the direction less the one along it and less the first derivative across it,
    of either sign, at the best of a few scales (Lindeberg's normalisation), in units of the neighbourhood's;
    0 beside the ridge's middle.
    """
    grey = image.astype(np.float32).mean(-1) / 255
    c, s = towards[..., 0], towards[..., 1]
    best = np.zeros_like(grey)
    for sigma in config.scales_px:
        xx, xy, yy = hessian(grey, sigma)
        across = s * s * xx - 2 * c * s * xy + c * c * yy
        along = c * c * xx + 2 * c * s * xy + s * s * yy
        x, y = gradient(grey, sigma)
        size = np.abs(across) - np.abs(along) - config.edge_weight * np.abs(c * y - s * x)
        bend = np.maximum(size, 0) * np.sign(across) * np.float32(sigma ** (config.gamma - 2))
        np.copyto(best, bend, where=np.abs(bend) > np.abs(best))
    limit = config.max_bend * _around(best, config)
    best = _average_along(np.clip(best, -limit, limit), c, s, config)
    strength = np.abs(best)
    response = np.clip(strength / (config.full_response * _around(best, config)), 0, 1)
    return np.where(_is_ridge(best, c, s, config), response, 0).astype(np.float32)


def _around(bend: np.ndarray, config: EvidenceConfig) -> np.ndarray:
    """Root mean square of the bends in the neighbourhood."""
    square: np.ndarray = cv2.GaussianBlur(bend * bend, (0, 0), config.contrast_px)
    return np.sqrt(square) + np.float32(config.min_bend)


def line_evidence(
    store: ImageStore,
    cameras: Cameras,
    images: Sequence[int],
    direction: Float[np.ndarray, "3"],
    config: EvidenceConfig,
    progress: Callable[[int], None] | None = None,
) -> Float32[np.ndarray, " p"]:
    """Responses of the chosen images to lines along a direction of the scene frame.

    One image after the other in one flat array; masked-out pixels 0.  progress: called with the number of
    images done.
    """

    def one(i: int) -> Float32[np.ndarray, " _"]:
        picture = store.image(i)
        towards = vanishing_directions(cameras, i, picture.shape[:2], direction)
        return np.where(store.valid(i), line_response(picture, towards, config), 0).ravel()

    maps = []
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for done, part in enumerate(pool.map(one, images), 1):
            maps.append(part)
            if progress is not None:
                progress(done)
    return np.concatenate(maps)


def vanishing_directions(
    cameras: Cameras, i: int, shape: tuple[int, ...], direction: Float[np.ndarray, "3"]
) -> Float32[np.ndarray, "h w 2"]:
    """Unit vectors of the image direction in which a line along a direction of the scene runs at each pixel.

    The lens is left out: it turns directions by a degree or two, which a second derivative does not notice.
    """
    ax, ay, az = (direction @ cameras.R_scene_camera[i].double().numpy()).tolist()  # in camera axes
    fx, fy = (float(v) for v in cameras.focal_px[i])
    cx, cy = (float(v) for v in cameras.principal_px[i])
    h, w = shape
    u, v = np.meshgrid((np.arange(w) + 0.5 - cx) / fx, (np.arange(h) + 0.5 - cy) / fy)
    # A point moved along the direction moves in the image by (a_xy - uv a_z) / depth.
    dx, dy = fx * (ax - u * az), fy * (ay - v * az)
    length = np.maximum(np.hypot(dx, dy), 1e-9)
    return np.stack([dx / length, dy / length], -1).astype(np.float32)


def _shifted(picture: np.ndarray, dx: np.ndarray, dy: np.ndarray) -> np.ndarray:
    h, w = picture.shape
    x, y = np.meshgrid(np.arange(w, dtype=np.float32), np.arange(h, dtype=np.float32))
    return cv2.remap(picture, x + dx, y + dy, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)


def _average_along(bend: np.ndarray, c: np.ndarray, s: np.ndarray, config: EvidenceConfig) -> np.ndarray:
    """The bend averaged along the best of the directions that sag allows."""
    best = np.zeros_like(bend)
    steps = np.linspace(-config.along_px, config.along_px, config.steps_along, dtype=np.float32)
    for angle in np.deg2rad(config.sag_deg).astype(np.float32):
        ca, sa = np.cos(angle), np.sin(angle)
        dx, dy = ca * c - sa * s, sa * c + ca * s
        mean = np.mean([_shifted(bend, k * dx, k * dy) for k in steps], axis=0, dtype=np.float32)
        np.copyto(best, mean, where=np.abs(mean) > np.abs(best))
    return best


def _is_ridge(
    bend: np.ndarray, c: np.ndarray, s: np.ndarray, config: EvidenceConfig
) -> Bool[np.ndarray, "h w"]:
    """Whether a pixel is the strongest of those to both sides across the direction."""
    strength, sign = np.abs(bend), np.sign(bend)
    ridge = np.ones(bend.shape, dtype=bool)
    for k in range(1, config.echo_px + 1):
        for side in (-k, k):
            beside = _shifted(bend, -side * s, side * c)
            ridge &= strength >= (np.abs(beside) if k <= config.beside_px else -sign * beside)
    return ridge
