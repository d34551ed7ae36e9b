"""One browser that looks at what is opened: its camera, what it sees, and its part of the page.

Everything in the page belongs to one browser alone, so that two people do not move each other's view.
"""

import threading
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import viser

from plnerf.view.backdrop import Backdrop
from plnerf.view.display_frame import LINE_PER_UNIT
from plnerf.view.eye import Eye
from plnerf.view.field_pictures import FieldPictures
from plnerf.view.films import FilmRoom
from plnerf.view.flights import Flight
from plnerf.view.frustums import SmallPhotos
from plnerf.view.opened import Opened
from plnerf.view.render_thread import RenderThread
from plnerf.view.training_progress import TrainingProgress


@dataclass(frozen=True, eq=False)
class Shared:
    """What all browsers see the same of."""

    opened: Opened
    renders: RenderThread
    field: FieldPictures | None
    flights: tuple[Flight, ...]
    small_photos: SmallPhotos | None
    films: FilmRoom | None = None
    """None: there is no field, or one that still changes."""
    progress: TrainingProgress | None = None
    """Of a run that is being trained."""


class Browser:
    """One client, from its connection to its end."""

    def __init__(self, client: viser.ClientHandle, shared: Shared) -> None:
        self.client, self.shared, self.opened = client, shared, shared.opened
        self.backdrop = Backdrop(client, shared.opened.views)
        self.gone = threading.Event()
        self.renew: Callable[[], None] = lambda: None
        """Shows what a training has reached since."""

    @property
    def eye(self) -> Eye:
        """From where it looks."""
        camera = self.client.camera
        aspect = camera.image_width / camera.image_height if camera.image_height else 1.5
        return Eye.of_viewer(self.opened.frame, camera.wxyz, camera.position, camera.fov, aspect)

    def go_to(self, eye: Eye, distance_m: float | None = None) -> None:
        """Moves its camera.  distance_m: of the place that dragging turns about; None: as before."""
        camera = self.client.camera
        ahead = eye.R_line_camera[:, 2]
        before = float(np.linalg.norm(camera.look_at - camera.position))
        distance = before if distance_m is None else distance_m / LINE_PER_UNIT
        place = self.opened.frame.to_viewer(eye.centre).astype(np.float64)
        with self.client.atomic():
            camera.position = place
            camera.look_at = place + max(distance, 0.05) * ahead
            camera.wxyz = eye.wxyz
            camera.fov = eye.fov_rad
        self.client.flush()

    def tell(self, title: str, text: str, *, bad: bool = False) -> None:
        """A note in the corner of its window."""
        if not self.gone.is_set():
            colour = "red" if bad else None
            self.client.add_notification(title, text, auto_close_seconds=None if bad else 8.0, color=colour)
