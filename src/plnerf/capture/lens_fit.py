"""Whether the lens that came out of structure from motion is possible: if not, the poses are bent with it.

Where images overlap little or look alike, a model can fit them with false matches and a false lens at once,
at a small error.  The lens gives it away: square pixels are not asked for, so that they are a check.

fx, fy: focal lengths in pixels across and up; s: the image's longer side in pixels.
"""

from typing import Any

import numpy as np

MOST_ASPECT = 0.03
"""How far fx / fy may be from 1: pixels are square to well under 1 %, and good models showed it to 0.5 %."""
LEAST_FOCAL, MOST_FOCAL = 0.3, 10.0
"""Limits of the mean focal length over s: 118 degrees across, and a lens of 360 mm on film."""
MOST_STATED = 1.5
"""By what factor the focal length may differ from EXIF's: files made smaller or cropped misstate it."""
GRID, SAME_PX = 24, 0.5
"""Pixels at which the distortion is looked at, along each side; how well it must come back through itself."""


def lens_problem(camera: Any, stated_px: float | None) -> str | None:
    """What is wrong with a lens, in words; None where it is plausible.

    camera: pycolmap.Camera of a perspective model.  stated_px: focal length of EXIF, where there is one.
    """
    fx, fy = float(camera.focal_length_x), float(camera.focal_length_y)
    lens = f"focal lengths of {fx:.0f} px across and {fy:.0f} px up"
    if not np.isfinite([fx, fy]).all() or min(fx, fy) <= 0 or abs(fx / fy - 1) > MOST_ASPECT:
        return f"{lens}, where cameras have square pixels"
    side = max(camera.width, camera.height)
    focal = (fx * fy) ** 0.5
    if not LEAST_FOCAL <= focal / side <= MOST_FOCAL:
        return f"{lens}, which no lens of images of {side} px has"
    if stated_px is not None and not 1 / MOST_STATED <= focal / stated_px <= MOST_STATED:
        return f"{lens}, where EXIF states {stated_px:.0f} px"
    if _folds(camera):
        return f"{lens} and a distortion that shows places twice within the image"
    return None


def _folds(camera: Any) -> bool:
    """Whether the distortion is no one-to-one map of the image.

    Pixels are brought to the plane z = 1 and back; between neighbours the map must keep its orientation.
    """
    u, v = np.meshgrid(np.linspace(0, camera.width, GRID), np.linspace(0, camera.height, GRID))
    px = np.stack([u, v], -1)
    plane = np.asarray(camera.cam_from_img(px.reshape(-1, 2))).reshape(px.shape)
    if not np.isfinite(plane).all():
        return True
    back = camera.img_from_cam(np.concatenate([plane, np.ones((GRID, GRID, 1))], -1).reshape(-1, 3))
    right, down = np.diff(plane, axis=1)[:-1], np.diff(plane, axis=0)[:, :-1]
    turned = right[..., 0] * down[..., 1] - right[..., 1] * down[..., 0]
    off = np.abs(np.asarray(back).reshape(px.shape) - px).max()
    return bool((turned <= 0).any() or not off <= SAME_PX)
