"""How well Gaussians agree with the renders of a field and with photos, on views they were not fitted to."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from jaxtyping import Bool, Float

from plnerf.errors import PlnerfError
from plnerf.export.splat_fit import as_gaussians
from plnerf.export.splat_project import render
from plnerf.export.splat_views import TargetView
from plnerf.export.splats import Splats
from plnerf.scene.cameras import Cameras
from plnerf.train.metrics import psnr
from plnerf.train.run import TrainedRun


@dataclass(frozen=True)
class Agreement:
    """Mean PSNR in dB over held-out views, whole pictures; None where there is nothing to compare with."""

    views: int
    field_db: float | None
    """Of the splats against the field's renders."""
    photos_db: float | None
    """Of the splats against the photos."""
    field_photos_db: float | None
    """Of the field's renders against the same photos."""
    why_no_photos: str | None = None


def agreement(
    run: TrainedRun, splats: Splats, held_out: Sequence[int], views: Sequence[TargetView]
) -> Agreement:
    """Agreement on held-out images, whose renders are given; splats in the LineFrame of the renders."""
    rendered = [rendered_view(splats, view) for view in views]
    fields = [view.rgb.astype(np.float32) / 255 for view in views]
    whole = [np.ones(view.surface.shape, bool) for view in views]
    against_field = _mean([psnr(*one) for one in zip(rendered, fields, whole, strict=True)])
    try:
        photos = [photo(run, i, view) for i, view in zip(held_out, views, strict=True)]
    except (PlnerfError, OSError) as error:
        return Agreement(len(views), against_field, None, None, f"The photos cannot be read: {error}")
    seen = [psnr(one, *both) for one, both in zip(rendered, photos, strict=True)]
    seen_by_field = [psnr(one, *both) for one, both in zip(fields, photos, strict=True)]
    return Agreement(len(views), against_field, _mean(seen), _mean(seen_by_field))


def rendered_view(splats: Splats, view: TargetView) -> Float[np.ndarray, "h w 3"]:
    """What the camera of a view sees of Gaussians, in [0, 1]."""
    with torch.no_grad():
        rgb: Float[np.ndarray, "h w 3"] = render(as_gaussians(splats), view.camera)[0].numpy()
    return np.clip(rgb, 0.0, 1.0)


def photo(
    run: TrainedRun, i: int, view: TargetView
) -> tuple[Float[np.ndarray, "h w 3"], Bool[np.ndarray, "h w"]]:
    """A photo as the pinhole camera of a view would have taken it, and where it may be used."""
    scene = run.scene
    cameras, (w, h) = scene.cameras[[i]], view.camera.size_px
    rgb: np.ndarray = scene.images.image(i)
    valid: np.ndarray = scene.images.valid(i).astype(np.uint8)
    if cameras.distorted:
        rgb, valid = _undistorted(cameras, rgb), _undistorted(cameras, valid)
    if rgb.shape[:2] != (h, w):
        rgb = cv2.resize(rgb, (w, h), interpolation=cv2.INTER_AREA)
        valid = cv2.resize(valid, (w, h), interpolation=cv2.INTER_NEAREST)
    return rgb.astype(np.float32) / 255, valid > 0


def _undistorted(camera: Cameras, picture: np.ndarray) -> np.ndarray:
    """OpenCV counts pixels from their centres, and has k1 k2 p1 p2 k3 in the order of `Cameras`."""
    (fx, fy), (cx, cy) = camera.focal_px[0].tolist(), camera.principal_px[0].tolist()
    K = np.array([[fx, 0, cx - 0.5], [0, fy, cy - 0.5], [0, 0, 1]])
    return cv2.undistort(picture, K, camera.distortion[0].double().numpy())


def _mean(values: Sequence[float | None]) -> float | None:
    present = [value for value in values if value is not None]
    return float(np.mean(present)) if present else None
