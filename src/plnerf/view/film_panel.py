"""A film of the field along the way, for one browser to download."""

import threading
import time

import viser

from plnerf.view.browser import Browser
from plnerf.view.field_panel import FieldPanel
from plnerf.view.films import FPS, FilmPlan, FilmRoom
from plnerf.view.flight_panel import FlightPanel

WIDTHS = {"320 px": 320, "640 px": 640, "1280 px": 1280}
SECONDS = {"2 s": 2, "4 s": 4, "10 s": 10, "30 s": 30}


class FilmPanel:
    """A panel to choose and start a film, with its progress and a button that gives it up."""

    def __init__(
        self,
        browser: Browser,
        field: FieldPanel,
        flight: FlightPanel,
        films: FilmRoom,
        folder: viser.GuiFolderHandle,
    ) -> None:
        self._browser, self._field, self._flight, self._films = browser, field, flight, films
        self._given_up, self._began = threading.Event(), 0.0
        gui = browser.client.gui
        with folder:
            self._width = gui.add_dropdown("film's width", tuple(WIDTHS), initial_value="320 px")
            self._seconds = gui.add_dropdown(
                "film's length", tuple(SECONDS), initial_value="4 s", hint=f"At {FPS} frames a second."
            )
            self._button = gui.add_button(
                "Film along the way", hint="The layer alone, from one end of the way to the other, as MP4."
            )
            self._bar = gui.add_progress_bar(0.0, visible=False)
            self._status = gui.add_markdown("", visible=False)
            self._cancel = gui.add_button("Give the film up", visible=False)
        self._button.on_click(lambda _: self._begin())
        self._cancel.on_click(lambda _: self._given_up.set())

    def _begin(self) -> None:
        layer, browser = self._field.shown, self._browser
        if layer is None:
            browser.tell("No film", "The field is switched off: choose a layer.")
            return
        self._given_up.clear()
        frames = SECONDS[self._seconds.value] * FPS
        plan = FilmPlan(self._flight.way, layer, frames, WIDTHS[self._width.value], browser.eye.aspect)
        self._began = time.monotonic()
        if not self._films.begin(plan, self._goes_on, self._rendered, self._ended):
            done, total = self._films.progress or (0, 0)
            browser.tell(
                "No film yet",
                f"One film is made at a time, and another is at {done} of {total} frames: the processors "
                "that render it are shared by all windows. Try again when it is done, or give it up where it "
                "was begun.",
            )
            return
        self._show(0)

    def _goes_on(self) -> bool:
        return not self._given_up.is_set() and not self._browser.gone.is_set()

    def _show(self, done: int) -> None:
        """Shows how far the film is made, and lets no other be chosen meanwhile."""
        frames = SECONDS[self._seconds.value] * FPS
        self._bar.value = 100.0 * done / frames
        self._status.content = progress_text(done, frames, time.monotonic() - self._began)
        for one in (self._bar, self._status, self._cancel):
            one.visible = True
        for one in (self._button, self._width, self._seconds):
            one.disabled = True

    def _rendered(self, done: int) -> None:
        if self._goes_on():
            self._show(done)

    def _ended(self, film: bytes | None, error: Exception | None) -> None:
        if self._browser.gone.is_set():
            return
        for one in (self._bar, self._status, self._cancel):
            one.visible = False
        for one in (self._button, self._width, self._seconds):
            one.disabled = False
        if error is not None:
            self._browser.tell("No film", str(error), bad=True)
        elif film is None:
            self._browser.tell("No film", "It was given up.")
        else:
            name = f"plnerf-film-{self._field.shown or 'field'}-{time.strftime('%Y%m%d-%H%M%S')}.mp4"
            self._browser.client.send_file_download(name, film, save_immediately=True)
            seconds = time.monotonic() - self._began
            self._browser.tell("Film", f"{len(film) / 1e6:.1f} MB, made in {seconds:.0f} s.")


def progress_text(done: int, frames: int, seconds: float) -> str:
    """The progress of a film in words, with what limits its speed."""
    text = f"frame {done} of {frames}"
    if done:
        text += f", about {seconds / done * (frames - done):.0f} s left"
    return text + ". The processors limit it; your window's pictures come first."
