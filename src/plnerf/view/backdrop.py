"""What one browser shows behind the things drawn in space: the field, a photo, or a wipe between the two."""

import threading

import cv2
import numpy as np
import viser
from jaxtyping import Bool, Float, UInt8

from plnerf.view.eye import Eye
from plnerf.view.field_pictures import FAR, FieldPicture
from plnerf.view.posed_views import PosedViews

PHOTO_PX = 1280
"""Longer side of a photo in the window."""
NEAR = 0.005
"""Depth of a photo in the viewer's units: before everything that is drawn in space."""
SAME_PLACE_M = 0.02
"""An eye sees what a photo shows if it is no farther than this from where the photo was taken."""
JPEG_COARSE, JPEG_FINE = 70, 90
FINE_PX = 100_000
"""Pixels from which on a picture counts as fine."""


Seen = tuple[UInt8[np.ndarray, "h w 3"], Bool[np.ndarray, "h w"]]
"""A photo as an eye sees it, and where."""


class Backdrop:
    """Of one client; may be called from any thread."""

    def __init__(self, client: viser.ClientHandle, views: PosedViews | None) -> None:
        self._client, self._views = client, views
        self._lock = threading.Lock()
        self._field: FieldPicture | None = None
        self._photo: tuple[int, UInt8[np.ndarray, "h w 3"]] | None = None
        self._share = 0.0
        self._empty = True

    def show_field(self, picture: FieldPicture | None, eye: Eye) -> None:
        """A picture of the field as seen by an eye; None: no field."""
        with self._lock:
            self._field = picture
            self._send(eye)

    def show_photo(self, i: int | None, share: float, eye: Eye) -> bool:
        """Photo i over the left share of the window; None: no photo.  Whether there is one to show."""
        with self._lock:
            if i is None or self._views is None:
                self._photo = None
            elif self._photo is None or self._photo[0] != i:
                photo = self._views.photo(i, PHOTO_PX)
                self._photo = None if photo is None else (i, photo)
            self._share = share
            self._send(eye)
            return self._photo is not None

    def look(self, eye: Eye) -> None:
        """The eye has moved: a photo is turned with it, or vanishes where the eye is at another place."""
        with self._lock:
            if self._photo is not None and self._share:
                self._send(eye)

    def _send(self, eye: Eye) -> None:
        image, depth = composed(self._field, self._seen_photo(eye), self._share)
        if image is None:
            if not self._empty:
                self._client.scene.set_background_image(None)
            self._empty = True
            return
        self._empty = False
        quality = JPEG_FINE if image.shape[0] * image.shape[1] >= FINE_PX else JPEG_COARSE
        self._client.scene.set_background_image(image, "jpeg", jpeg_quality=quality, depth=depth)
        self._client.flush()

    def _seen_photo(self, eye: Eye) -> Seen | None:
        if self._photo is None or self._views is None or not self._share:
            return None
        i, photo = self._photo
        if np.linalg.norm(self._views.cameras.centre[i].numpy() - eye.centre) > SAME_PLACE_M:
            return None
        width = PHOTO_PX if eye.aspect >= 1 else max(1, round(PHOTO_PX * eye.aspect))
        return self._views.seen_by(i, eye, (width, max(1, round(width / eye.aspect))), photo)


def composed(
    field: FieldPicture | None, photo: Seen | None, share: float
) -> tuple[UInt8[np.ndarray, "k l 3"] | None, Float[np.ndarray, "k l"] | None]:
    """Picture and depth: the photo over the left share, the field or white beside it; None: nothing."""
    if photo is None:
        return (None, None) if field is None else (field.picture, field.depth)
    seen, inside = photo
    height, width = inside.shape
    if field is None:
        image, depth = np.full_like(seen, 255), np.full((height, width), FAR)
    else:
        image = cv2.resize(field.picture, (width, height), interpolation=cv2.INTER_LINEAR).astype(np.uint8)
        depth = cv2.resize(field.depth, (width, height), interpolation=cv2.INTER_NEAREST).astype(np.float64)
    edge = round(share * width)
    left = inside & (np.arange(width) < edge)
    image[left], depth[left] = seen[left], NEAR
    if edge < width:
        image[:, max(edge - 1, 0) : edge + 1] = 255
    return image, depth
