"""Where Gaussians begin: on the surfaces that the field's renders show, as dense as the pixels that see them.

Letters: m pixels of all renders, n of them kept.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from plnerf.export.splat_sh import Y_0
from plnerf.export.splat_views import TargetView
from plnerf.export.splats import Splats

OPACITY = 0.3
FLAT = 0.3
"""Thickness of a Gaussian along the surface's normal, as a share of its width."""
WIDEST = 5.0
"""A Gaussian begins no wider than so many pixels, however far its neighbours are."""
MOST_PIXELS = 2_000_000
"""Pixels that are thinned: of more, as many are drawn."""
_WIDTH = 0.6  # standard deviation in mean distances of the three nearest others
_HALVINGS = 12


def seeds(views: Sequence[TargetView], count: int, degree: int, random: np.random.Generator) -> Splats:
    """At most `count` Gaussians on the surfaces of renders; with none where no render shows a surface.

    Space is divided into cubes whose edge is in proportion to a pixel's width on the surface, rounded to a
    power of sqrt(2); each cube keeps one pixel, and the proportion is the one that gives about `count`.
    """
    each = max(1, MOST_PIXELS // max(1, len(views)))
    columns = [_pixels(view, each, random) for view in views]
    xyz, normal, rgb, width = (np.concatenate(one) for one in zip(*columns, strict=True))
    order = random.permutation(len(xyz))
    kept = order[_thinned(xyz[order], width[order], count)]
    return _laid_out(xyz[kept], normal[kept], rgb[kept], width[kept], degree)


def _pixels(
    view: TargetView, count: int, random: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Of pixels that show a surface: places, normals, colours in [0, 1], and a pixel's width there."""
    places = surface_points(view)
    across, down = np.gradient(places, axis=1), np.gradient(places, axis=0)
    normal = np.cross(across, down)
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    towards = view.camera.centre.numpy() - places
    towards /= np.linalg.norm(towards, axis=-1, keepdims=True)
    normal = np.where(length > 0, normal / np.maximum(length, 1e-30), towards)
    use = np.flatnonzero(view.surface)
    use = use if len(use) <= count else random.choice(use, count, replace=False)
    width = view.z_depth.reshape(-1)[use] / float(view.camera.focal_px.mean())
    rgb = view.rgb.reshape(-1, 3)[use].astype(np.float32) / 255
    return places.reshape(-1, 3)[use], normal.reshape(-1, 3)[use].astype(np.float32), rgb, width


def surface_points(view: TargetView) -> Float[np.ndarray, "h w 3"]:
    """The point that each pixel of a render sees, LineFrame."""
    h, w = view.z_depth.shape
    pixel = np.stack(np.meshgrid(np.arange(w) + 0.5, np.arange(h) + 0.5), -1)
    plane = (pixel - view.camera.principal_px.numpy()) / view.camera.focal_px.numpy()
    seen = np.concatenate([plane, np.ones((h, w, 1))], -1) * view.z_depth[..., None]
    turned = seen @ view.camera.R_local_camera.numpy().T
    found: Float[np.ndarray, "h w 3"] = turned + view.camera.centre.numpy()
    return found


def _thinned(xyz: Float[np.ndarray, "m 3"], width: Float[np.ndarray, " m"], count: int) -> np.ndarray:
    """The first point in each cube, for the finest cubes that keep no more than `count`."""
    if len(xyz) <= count:
        return np.arange(len(xyz))
    low, high, kept = -2.0, 20.0, np.zeros(0, np.int64)  # log2 of the cubes' edge in pixels
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        some = _one_each(xyz, width * 2**middle)
        if len(some) <= count:
            high, kept = middle, some
        else:
            low = middle
    return kept


def _one_each(xyz: Float[np.ndarray, "m 3"], edge: Float[np.ndarray, " m"]) -> np.ndarray:
    level = np.floor(np.log2(np.maximum(edge, 1e-9)) * 2).astype(np.int64)  # in steps of sqrt(2)
    cube = np.floor(xyz / 2.0 ** (level[:, None] / 2)).astype(np.int64)
    # A hash of the cube: two that share one lose a point, one in millions.
    with np.errstate(over="ignore"):
        key = cube[:, 0] * 73856093 ^ cube[:, 1] * 19349669 ^ cube[:, 2] * 83492791 ^ level * 2654435761
    return np.unique(key, return_index=True)[1]


def _laid_out(
    xyz: Float[np.ndarray, "n 3"],
    normal: Float[np.ndarray, "n 3"],
    rgb: Float[np.ndarray, "n 3"],
    width: Float[np.ndarray, " n"],
    degree: int,
) -> Splats:
    """Gaussians flat on the surface, as wide as their neighbours are apart."""
    near = 3 if len(xyz) > 3 else len(xyz) - 1
    apart = cKDTree(xyz).query(xyz, k=near + 1)[0][:, 1:].mean(1) if near > 0 else width
    across = (_WIDTH * np.clip(apart, 0.5 * width, WIDEST * width)).astype(np.float32)
    sh = np.zeros((len(xyz), (degree + 1) ** 2, 3), np.float32)
    sh[:, 0] = (rgb - 0.5) / Y_0
    return Splats(
        xyz=xyz,
        scale=np.stack([across, across, FLAT * across], 1),
        rotation=z_along(normal),
        opacity=np.full(len(xyz), OPACITY, np.float32),
        sh=sh,
    )


def z_along(direction: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 4"]:
    """Quaternions w, x, y, z of rotations that turn the z axis into unit directions."""
    if not len(direction):
        return np.zeros((0, 4), np.float32)
    flip = direction[:, 2] < -0.999  # half a turn has no shortest way
    w = np.where(flip, 0.0, 1 + direction[:, 2])
    q = np.stack([w, -direction[:, 1], direction[:, 0], np.zeros(len(w))], 1)
    q[flip] = (0.0, 1.0, 0.0, 0.0)
    x, y, z, w = Rotation.from_quat(q[:, [1, 2, 3, 0]]).as_quat().T
    return np.stack([w, x, y, z], 1).astype(np.float32)
