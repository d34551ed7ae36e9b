"""The field as one browser sees it: drawn anew whenever its camera moves, coarse at once and then finer."""

import time
from collections.abc import Callable
from dataclasses import replace
from typing import cast

import numpy as np

from plnerf.render.pictures import DepthRange, legend
from plnerf.view.browser import Browser
from plnerf.view.eye import Eye
from plnerf.view.field_pictures import FAR, LENGTHS, FieldPicture, FieldPictures, Layer
from plnerf.view.page_text import plain
from plnerf.view.render_thread import Wish

SIZES = {"320 px": 320, "640 px": 640, "960 px": 960, "1280 px": 1280, "1920 px": 1920}
DEFAULT = "640 px"
OFF = "off"
LEGEND_PX = 300


class FieldPanel:
    """Its controls, and its wishes to the thread that renders."""

    def __init__(self, browser: Browser, field: FieldPictures) -> None:
        self._browser, self._field = browser, field
        self._range: DepthRange | None = None
        gui = browser.client.gui
        with gui.add_folder("Field"):
            self._layer = gui.add_dropdown("layer", (*field.layers, OFF), initial_value="rgb")
            self._size = gui.add_dropdown(
                "width when at rest", tuple(SIZES), initial_value=DEFAULT,
                hint="Of the finest picture. A moving camera sees a coarser one.",
            )  # fmt: skip
            self._hides = gui.add_checkbox(
                "hides what is behind", initial_value=False, hint="Wires, points, cameras behind a surface."
            )
            self._status = gui.add_markdown("waiting for the kernels")
            self._legend = gui.add_image(
                np.full((1, LEGEND_PX, 3), 255, np.uint8), format="png", visible=False
            )
        self._explained: tuple[Layer, DepthRange] | None = None
        self._told: str | None = None
        self._layer.on_update(lambda _: self._new_layer())
        for one in (self._size, self._hides):
            one.on_update(lambda _: self.draw(browser.eye))

    def _new_layer(self) -> None:
        self._range = None
        self.draw(self._browser.eye)

    @property
    def shown(self) -> Layer | None:
        """The layer on show; None: the field is hidden."""
        return None if self._layer.value == OFF else cast(Layer, self._layer.value)

    def refresh(self) -> None:
        """Wishes for the finest picture alone, of a field that has changed, if none is on its way."""
        browser = self._browser
        if self.shown is not None and browser.shared.renders.rests(browser.client.client_id):
            self.draw(browser.eye, coarse=False)

    def draw(self, eye: Eye, *, coarse: bool = True) -> None:
        """Wishes for pictures from a place, coarse ones first; the earlier wish is given up."""
        browser, layer = self._browser, self.shown
        moved, first_s = time.monotonic(), list[float]()
        if layer is None:
            browser.shared.renders.forget(browser.client.client_id)
            browser.backdrop.show_field(None, eye)
            self._status.content = ""
            self._explain(None, None)
            return

        def draw(rays: int, goes_on: Callable[[], bool]) -> bool:
            if browser.gone.is_set():
                return True
            shown = self._range if layer in LENGTHS else None
            picture = self._field.render(eye, layer, rays, shown=shown, goes_on=goes_on)
            if picture is None:
                return False
            self._range, self._told = picture.shown, None
            if not self._hides.value:
                picture = replace(picture, depth=np.full_like(picture.depth, FAR))
            browser.backdrop.show_field(picture, eye)
            first_s.append(time.monotonic() - moved)
            self._status.content = about(picture, first_s[-1], first_s[0] if coarse else None)
            if layer in LENGTHS:
                self._status.content += "  \n" + LENGTHS[layer][1]
            self._explain(layer, picture.shown)
            return True

        width = min(SIZES[self._size.value], browser.client.camera.image_width or 640)
        most = max(1, round(width * width / eye.aspect))
        drawn_rays = 0 if coarse else most - 1

        def failed(error: Exception) -> None:
            if browser.gone.is_set():
                return
            if not first_s:  # what still stands there was seen from another place
                browser.backdrop.show_field(None, eye)
            self._tell(error)

        browser.shared.renders.wish(Wish(browser.client.client_id, draw, most, failed, drawn_rays))

    def _tell(self, error: Exception) -> None:
        """Says what rendering raised; the next move tries again.

        A camera that is dragged raises it many times a second: only the first of equal ones gets a note.
        """
        words = str(error) or type(error).__name__
        self._status.content = f"**Not rendered:** {plain(words)}"
        if words != self._told:
            self._browser.tell("The field cannot be rendered", words, bad=True)
        self._told = words

    def _explain(self, layer: Layer | None, shown: DepthRange | None) -> None:
        """Shows what the colours of a layer mean, where they mean lengths."""
        if layer is None or shown is None:
            self._legend.visible = False
        elif self._explained != (layer, shown):
            self._explained = layer, shown
            self._legend.image = legend(LEGEND_PX, shown, LENGTHS[layer][0])
        self._legend.visible = shown is not None


def about(picture: FieldPicture, seconds: float, first_s: float | None) -> str:
    """Size of a picture, and how long after the move it and the first one came.

    first_s: None where there was no move.
    """
    height, width = picture.picture.shape[:2]
    if first_s is None:
        after = f"renewed in {seconds:.1f} s"
    else:
        after = f"{seconds:.2f} s after the move (first picture {first_s:.2f} s)"
    return f"{width} × {height} px, {after}"
