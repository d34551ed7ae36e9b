"""What each image says about lines that run along the span: thin, and pointing where the span points.

All lines along the span's axis meet in one point of an image, their vanishing point; the direction from a
pixel to it is the only one a conductor can have there, but for its sag.  A conductor is a ridge across that
direction: the brightness bends (second derivative) across it and not along it.

Letters: n images of h x w pixels; the span's axis is +x of the scene frame.
"""

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8
from torch import Tensor

from plnerf.detect.ridges import gradient, hessian
from plnerf.scene.cameras import Cameras
from plnerf.scene.images import ImageStore

SCALES_PX = (0.7, 1.4, 2.8)
"""Standard deviations of the Gaussians: wires 1 to 8 px wide."""
GAMMA = 1.0
"""Power of the scale that a bend is multiplied by.  With 2 (scale invariance) the widest scale, which sees
texture as lines, outvotes wires of a pixel or two; Lindeberg recommends 3/2 for ridges."""
EDGE_WEIGHT = 0.75
"""How much a slope across the line counts against a bend: the middle of a line is even, an edge is not."""
MOST = 3.0
"""Largest bend of one pixel, in units of the neighbourhood's: no single pixel makes a line."""
ALONG_PX = 20.0
"""Half the length over which the bend is averaged along the line: texture is not straight."""
STEPS_ALONG = 15
SAG_DEG = (-7.0, -3.5, 0.0, 3.5, 7.0)
"""A conductor's directions beside that of the span's axis: sag, and supports at unequal heights."""
BESIDE_PX, ECHO_PX = 2, 5
"""A ridge is the strongest pixel this far to both sides, and no weaker than a line of the other sign farther
off, because a second derivative echoes beside a line with the other sign.  Twin conductors have the same."""
CONTRAST_PX = 12.0
"""Neighbourhood whose bends a pixel's is compared with."""
LEAST_BEND = 0.004
"""Of the brightness; noise and compression bend that much in a clear sky."""


def line_response(
    image: UInt8[np.ndarray, "h w 3"], towards: Float[np.ndarray, "h w 2"]
) -> Float[np.ndarray, "h w"]:
    """How much a pixel looks like a line in the given direction (unit vectors x, y), 0 to 1.

    The bend across the direction beyond the bend along it and the slope across it, of either sign, at the
    best of a few scales (Lindeberg's normalisation), in units of the neighbourhood's; kept only on the ridge
    itself.
    """
    grey = image.astype(np.float32).mean(-1) / 255
    c, s = towards[..., 0], towards[..., 1]
    best = np.zeros_like(grey)
    for sigma in SCALES_PX:
        xx, xy, yy = hessian(grey, sigma)
        across = s * s * xx - 2 * c * s * xy + c * c * yy
        along = c * c * xx + 2 * c * s * xy + s * s * yy
        x, y = gradient(grey, sigma)
        size = np.abs(across) - np.abs(along) - EDGE_WEIGHT * np.abs(c * y - s * x)
        bend = np.maximum(size, 0) * np.sign(across) * np.float32(sigma ** (GAMMA - 2))
        np.copyto(best, bend, where=np.abs(bend) > np.abs(best))
    most = MOST * _around(best)
    best = _average_along(np.clip(best, -most, most), c, s)
    strength = np.abs(best)
    response = np.clip(strength / (3 * _around(best)), 0, 1)
    return np.where(_is_ridge(best, c, s), response, 0).astype(np.float32)


def _around(bend: np.ndarray) -> np.ndarray:
    """Root mean square of the bends in the neighbourhood."""
    square: np.ndarray = cv2.GaussianBlur(bend * bend, (0, 0), CONTRAST_PX)
    return np.sqrt(square) + np.float32(LEAST_BEND)


def line_evidence(store: ImageStore, cameras: Cameras, images: tuple[int, ...]) -> Float[np.ndarray, " p"]:
    """The responses of the chosen images, one after the other in one flat array; masked-out pixels 0."""
    slope = track_slope(cameras.centre[list(images)].double().numpy())
    maps = []
    for i in images:
        picture = store.image(i)
        towards = vanishing_directions(cameras, i, picture.shape[:2], slope)
        maps.append(np.where(store.valid(i), line_response(picture, towards), 0).ravel())
    return np.concatenate(maps)


def track_slope(centres: Float[np.ndarray, "n 3"]) -> float:
    """How steeply the cameras climb along the span: conductors on a hill climb with them."""
    x, z = centres[:, 0] - centres[:, 0].mean(), centres[:, 2] - centres[:, 2].mean()
    return float((x * z).sum() / max((x * x).sum(), 1e-12))


def vanishing_directions(
    cameras: Cameras, i: int, shape: tuple[int, ...], slope: float
) -> Float[np.ndarray, "h w 2"]:
    """Unit vectors of the image direction in which a line along (1, 0, slope) runs through each pixel.

    The lens is left out: it turns directions by a degree or two, which a second derivative does not notice.
    """
    R_scene_camera: Tensor = cameras.R_scene_camera[i]
    axis = R_scene_camera[0] + slope * R_scene_camera[2]  # in camera axes
    ax, ay, az = (float(v) for v in axis)
    fx, fy = (float(v) for v in cameras.focal_px[i])
    cx, cy = (float(v) for v in cameras.principal_px[i])
    h, w = shape
    u, v = np.meshgrid((np.arange(w) + 0.5 - cx) / fx, (np.arange(h) + 0.5 - cy) / fy)
    # A point moved along the axis moves in the image by (a_xy - uv a_z) / depth.
    dx, dy = fx * (ax - u * az), fy * (ay - v * az)
    length = np.maximum(np.hypot(dx, dy), 1e-9)
    return np.stack([dx / length, dy / length], -1).astype(np.float32)


def _shifted(picture: np.ndarray, dx: np.ndarray, dy: np.ndarray) -> np.ndarray:
    h, w = picture.shape
    x, y = np.meshgrid(np.arange(w, dtype=np.float32), np.arange(h, dtype=np.float32))
    return cv2.remap(picture, x + dx, y + dy, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)


def _average_along(bend: np.ndarray, c: np.ndarray, s: np.ndarray) -> np.ndarray:
    """The bend averaged along the best of the directions that sag allows."""
    best = np.zeros_like(bend)
    steps = np.linspace(-ALONG_PX, ALONG_PX, STEPS_ALONG, dtype=np.float32)
    for angle in np.deg2rad(SAG_DEG).astype(np.float32):
        ca, sa = np.cos(angle), np.sin(angle)
        dx, dy = ca * c - sa * s, sa * c + ca * s
        mean = np.mean([_shifted(bend, k * dx, k * dy) for k in steps], axis=0, dtype=np.float32)
        np.copyto(best, mean, where=np.abs(mean) > np.abs(best))
    return best


def _is_ridge(bend: np.ndarray, c: np.ndarray, s: np.ndarray) -> Bool[np.ndarray, "h w"]:
    """Whether a pixel is the strongest of those to both sides across the direction."""
    strength, sign = np.abs(bend), np.sign(bend)
    ridge = np.ones(bend.shape, dtype=bool)
    for k in range(1, ECHO_PX + 1):
        for side in (-k, k):
            beside = _shifted(bend, -side * s, side * c)
            ridge &= strength >= (np.abs(beside) if k <= BESIDE_PX else -sign * beside)
    return ridge
