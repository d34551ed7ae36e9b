"""The photos of a capture: go to where one was taken, and wipe between it and what is drawn."""

from plnerf.view.browser import Browser
from plnerf.view.eye import Eye, eye_of
from plnerf.view.page_text import plain
from plnerf.view.posed_views import PosedViews
from plnerf.view.show_panel import ShowPanel


class PhotoPanel:
    """Which photo, and how far it is wiped over the window."""

    def __init__(self, browser: Browser, views: PosedViews, drawn: ShowPanel) -> None:
        self._browser, self._views, self._drawn = browser, views, drawn
        gui, last = browser.client.gui, len(views.names) - 1
        with gui.add_folder("Photos", expand_by_default=False):
            self._number = gui.add_slider("photo", 0, max(last, 1), 1, 0, disabled=not last)
            self._name = gui.add_markdown(self._title(0))
            self._go = gui.add_button("Go to where it was taken")
            self._wipe = gui.add_slider(
                "wipe, %", 0.0, 100.0, 1.0, 0.0, disabled=views.photos is None,
                hint="The photo over the left of the window, as long as the camera stays where it was taken.",
            )  # fmt: skip
        self._number.on_update(lambda _: self._chosen())
        self._go.on_click(lambda _: self.go_to(self._number.value))
        self._wipe.on_update(lambda _: self._wiped())

    def go_to(self, i: int) -> None:
        """To where photo i was taken, looking as it did."""
        if self._number.value != i:
            self._number.value = i
        self._browser.go_to(eye_of(self._views.cameras, i, self._browser.eye.aspect))

    def _chosen(self) -> None:
        i = int(self._number.value)
        self._name.content = self._title(i)
        if self._wipe.value:
            self.go_to(i)
            self._show(eye_of(self._views.cameras, i, self._browser.eye.aspect))

    def _wiped(self) -> None:
        i, eye = int(self._number.value), self._browser.eye
        if self._wipe.value and not self._near(i, eye):
            eye = eye_of(self._views.cameras, i, eye.aspect)
            self._browser.go_to(eye)
        self._show(eye)

    def _near(self, i: int, eye: Eye) -> bool:
        return bool(abs(self._views.cameras.centre[i].numpy() - eye.centre).max() < 0.01)

    def _show(self, eye: Eye) -> None:
        share = self._wipe.value / 100
        self._drawn.without_cameras(share > 0)  # they would stand between the eye and all else
        there = self._browser.backdrop.show_photo(int(self._number.value) if share else None, share, eye)
        if share and not there:
            self._browser.tell("No photo", f"{self._title(int(self._number.value))} cannot be read.")

    def _title(self, i: int) -> str:
        return f"{i + 1} of {len(self._views.names)}: {plain(self._views.names[i])}"
