"""Films of the field along a way: one at a time, rendered while no browser waits for a picture."""

import tempfile
import threading
from collections.abc import Callable
from concurrent.futures import CancelledError
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from plnerf.render.picture_files import write_png
from plnerf.render.pictures import DepthRange, with_legend
from plnerf.render.views import RenderedView
from plnerf.render.write_video import require_ffmpeg, write_video
from plnerf.view.eye import Eye
from plnerf.view.field_pictures import LENGTHS, FieldPictures, Layer
from plnerf.view.flights import Flight
from plnerf.view.render_thread import RenderThread

FPS = 24
PREVIEWS, PREVIEW_RAYS = 5, 3000
"""Small pictures along the way, so that all frames of depths or of uncertainty share one range."""


@dataclass(frozen=True, eq=False)
class FilmPlan:
    """The settings of a film: its layer, its way and its size."""

    flight: Flight
    layer: Layer
    frames: int
    width_px: int
    aspect: float
    """Width over height."""

    def eye(self, frame: int) -> Eye:
        """From where a frame is seen."""
        return self.flight.at(frame / max(self.frames - 1, 1), self.aspect)

    @property
    def rays(self) -> int:
        """Pixels of a frame."""
        return max(1, round(self.width_px * self.width_px / self.aspect))


Ended = Callable[[bytes | None, Exception | None], None]


class FilmRoom:
    """Makes one film at a time, for the browser that asked first."""

    def __init__(self, field: FieldPictures, renders: RenderThread) -> None:
        self._field, self._renders = field, renders
        self._lock = threading.Lock()
        self._done: tuple[int, int] | None = None

    @property
    def progress(self) -> tuple[int, int] | None:
        """Frames that are rendered and all frames of the film that is being made; None: there is none."""
        return self._done

    def begin(
        self, plan: FilmPlan, goes_on: Callable[[], bool], rendered: Callable[[int], None], ended: Ended
    ) -> bool:
        """Begins a film in a thread of its own; false where another one is being made.

        goes_on: asked between two strips of a frame.  rendered: called with the number of frames so far.
        ended: called once, with the MP4, with what went wrong, or with neither where it was given up.
        """
        with self._lock:
            if self._done is not None:
                return False
            self._done = 0, plan.frames
        threading.Thread(
            target=self._film, args=(plan, goes_on, rendered, ended), name="plnerf-view-film", daemon=True
        ).start()
        return True

    def _film(
        self, plan: FilmPlan, goes_on: Callable[[], bool], rendered: Callable[[int], None], ended: Ended
    ) -> None:
        film, error = None, None
        try:
            require_ffmpeg()
            with tempfile.TemporaryDirectory(prefix="plnerf-film-") as folder:
                film = self._made(plan, Path(folder), goes_on, rendered)
        except CancelledError:
            pass  # the server ends
        except Exception as raised:  # whatever it is, it belongs to who waits for the film
            error = raised
        finally:
            self._done = None
        ended(film, error)

    def _made(
        self, plan: FilmPlan, folder: Path, goes_on: Callable[[], bool], rendered: Callable[[int], None]
    ) -> bytes | None:
        shown = self._range(plan, goes_on) if plan.layer in LENGTHS else None
        paths: list[Path] = []
        for frame in range(plan.frames):
            picture = self._field.render(
                plan.eye(frame), plan.layer, plan.rays, shown=shown, goes_on=goes_on, through=self._in_turn
            )
            if picture is None or not goes_on():
                return None
            pixels = picture.picture
            if shown is not None:
                pixels = with_legend(pixels, shown, LENGTHS[plan.layer][0])
            paths.append(folder / f"{frame:05d}.png")
            write_png(paths[-1], pixels)
            self._done = frame + 1, plan.frames
            rendered(frame + 1)
        write_video(folder / "film.mp4", paths, float(FPS))
        return (folder / "film.mp4").read_bytes()

    def _in_turn(self, strip: Callable[[], RenderedView]) -> RenderedView:
        """Rendered by the thread that renders, when no browser waits."""
        view: RenderedView = self._renders.later(strip).result()
        return view

    def _range(self, plan: FilmPlan, goes_on: Callable[[], bool]) -> DepthRange | None:
        """The lengths at both ends of the colours of all frames; None where the film was given up."""
        found = []
        for frame in np.linspace(0, plan.frames - 1, PREVIEWS).round().astype(int):
            picture = self._field.render(
                plan.eye(int(frame)), plan.layer, PREVIEW_RAYS, goes_on=goes_on, through=self._in_turn
            )
            if picture is None or picture.shown is None:
                return None
            found.append(picture.shown)
        return DepthRange(min(one.near for one in found), max(one.far for one in found), found[0].unit)
