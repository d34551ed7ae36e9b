"""`plnerf hang`: exact catenaries in the photos of a captured scene, and the truth of them.

Folder: images/NAME, truth.json.  There are no poses beside the images: they are to be found anew.
"""

import json
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8

from plnerf.errors import SceneError
from plnerf.scene.decode import read_rgb
from plnerf.scene.files import check_folder
from plnerf.scene.formats import read_listing
from plnerf.scene.listing import Listing
from plnerf.scene.orientation import estimate_up
from plnerf.synth.hang_choose import Place, choose_wires
from plnerf.synth.hang_config import DrawConfig, HangConfig
from plnerf.synth.hang_depth import Depth, photo_depths
from plnerf.synth.hang_draw import Axis, Box, axis_in, blurred, draw_tile, tiles
from plnerf.synth.hang_light import Light, draw_light
from plnerf.synth.hang_photo import (
    LUMINANCE,
    copy_photo,
    exposures,
    noise_level,
    sharpness_px,
    to_linear,
    to_stored,
    write_like,
)
from plnerf.synth.hang_truth import truth_of
from plnerf.synth.hang_views import PhotoView, photo_views

Progress = Callable[[str, int, int], object]
THINNED = 7
"""Every so many-th pixel each way is read for the light's brightness and colour."""
BRIGHT = (0.95, 0.99)
"""Quantiles of brightness between which pixels give the light's colour; brighter ones may be clipped."""


def hang_in_photos(
    scene: Path, out: Path, config: HangConfig | None = None, progress: Progress | None = None
) -> Path:
    """Hangs wires in a scene's photos and returns the new folder `out`.

    scene: a scene folder, a transforms.json, or a COLMAP folder.  progress: called with the stage's name,
    what is done of it, and of how much.  Raises SceneError where `out` is there and not empty, the scene
    cannot be read, its photos cannot be matched, or none of its wires would be seen from two sides.
    """
    config, report = config or HangConfig(), progress or (lambda stage, done, of: None)
    if out.exists() and not (out.is_dir() and not any(out.iterdir())):
        raise SceneError(f"plnerf hang makes a new folder, but {out} exists and is not empty. Name another.")
    check_folder(out)
    listing = read_listing(scene)
    views = photo_views(listing, _up(listing))
    depths = photo_depths(views, config.depth, lambda done, of: report("depth", done, of))
    place = Place(views, depths, config.choose, config.draw)
    hung = choose_wires(place, np.random.default_rng([config.seed, 1]))
    light = draw_light(config.draw, _white(views, config.draw), np.random.default_rng([config.seed, 2]))
    took = exposures([view.path for view in views])
    out.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=f".{out.name}-", dir=out.parent) as scratch:
        folder = Path(scratch) / "hung"
        (folder / "images").mkdir(parents=True)
        for k, view in enumerate(views):
            axes = [axis for one in hung if (axis := axis_in(view, one, config.draw)) is not None]
            target, lit = folder / "images" / view.name, Light(light.to_sun, light.sky, light.E * took[k])
            painter = np.random.default_rng([config.seed, 3, k])
            photo = with_wires(view, depths[k], axes, lit, config.draw, painter) if axes else None
            if photo is None:
                copy_photo(view.path, target)
            else:
                write_like(view.path, photo, target)
            report("photos", k + 1, len(views))
        truth = truth_of(hung, place, config, str(scene), listing.unit)
        (folder / "truth.json").write_text(json.dumps(truth, indent=1, allow_nan=False), encoding="utf-8")
        if out.exists():
            out.rmdir()
        folder.rename(out)
    return out


def with_wires(
    view: PhotoView,
    depth: Depth,
    axes: Sequence[Axis],
    light: Light,
    config: DrawConfig,
    random: np.random.Generator,
) -> UInt8[np.ndarray, "h w 3"] | None:
    """A photo with wires in it, as blurred and as noisy as itself; None where none of them shows."""
    boxes = tiles(view, axes, config)
    if not boxes:
        return None
    photo = read_rgb(view.path)
    sigma_px, noise = sharpness_px(photo), noise_level(photo)
    changed = photo.copy()
    margin = int(np.ceil(4 * sigma_px)) + 1
    touched = False
    for left, top, right, bottom in boxes:
        # Drawn with a margin, so that the blur sees what comes from beside the tile.
        wide: Box = (left - margin, top - margin, right + margin, bottom + margin)
        layer = blurred(draw_tile(view, depth, axes, light, wide, config), sigma_px)
        alpha = layer.alpha[margin:-margin, margin:-margin, None]
        if not (alpha > 0).any():
            continue
        touched = True
        under = photo[top:bottom, left:right].astype(np.float64)
        lit = to_linear(under) * (1 - alpha) + layer.light[margin:-margin, margin:-margin]
        stored = to_stored(lit)
        # What the wire covers of the photo's noise, it brings: variances add up to what they were.
        covered = np.sqrt(np.clip(1 - (1 - alpha) ** 2, 0, 1))
        stored = (
            stored
            + covered
            * noise.at(stored @ LUMINANCE)[..., None]
            * random.standard_normal(stored.shape[:2])[..., None]
        )
        mixed = np.where(alpha > 0, stored, under)
        changed[top:bottom, left:right] = np.rint(np.clip(mixed, 0, 255)).astype(np.uint8)
    return changed if touched else None


def _up(listing: Listing) -> Float[np.ndarray, "3"]:
    """The file's up, else the cameras'."""
    if listing.up is not None:
        return listing.up
    T = np.stack([shot.T_world_camera for shot in listing.shots])
    return estimate_up(T[:, :3, :3], T[:, :3, 3])[0]


def _white(views: Sequence[PhotoView], config: DrawConfig) -> Float[np.ndarray, "3"]:
    """Light that a white, level, matt surface sends out: so bright that the photos' median is `grey` of it,
    and of the colour of their brightest pixels, which are rarely plants."""
    medians, tints = [], []
    for view in views:
        some = to_linear(read_rgb(view.path)[::THINNED, ::THINNED].astype(np.float64)).reshape(-1, 3)
        bright = some @ LUMINANCE
        medians.append(np.median(bright))
        low, high = np.quantile(bright, BRIGHT)
        chosen = some[(bright >= low) & (bright <= high)].mean(0)
        tints.append(chosen / max(float(chosen @ LUMINANCE), 1e-6))
    tint = np.median(tints, 0)
    white: Float[np.ndarray, 3] = float(np.median(medians)) / config.grey * tint
    return white
