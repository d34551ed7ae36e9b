"""Stills that one browser downloads: of its window, and of the field alone."""

import io
import time

import numpy as np
from jaxtyping import UInt8
from PIL import Image

from plnerf.view.browser import Browser
from plnerf.view.field_panel import FieldPanel

WIDTHS = {"320 px": 320, "1280 px": 1280, "1920 px": 1920, "3840 px": 3840}
WAIT_S = 60.0
"""For a browser to send what it shows."""


class SavePanel:
    """The buttons."""

    def __init__(self, browser: Browser, field: FieldPanel | None) -> None:
        self._browser, self._field = browser, field
        gui = browser.client.gui
        self.folder = gui.add_folder("Save", expand_by_default=False)
        """Also of what else can be saved."""
        with self.folder:
            window = gui.add_button("Still of the window", hint="All that is shown, as a PNG.")
            if field is not None:
                self._width = gui.add_dropdown("width", tuple(WIDTHS), initial_value="1280 px")
                still = gui.add_button("Still of the field", hint="The layer alone.")
                still.on_click(lambda _: self._still())
        window.on_click(lambda _: self._window())

    def _window(self) -> None:
        client = self._browser.client
        camera = client.camera
        try:
            picture = client.get_render(
                camera.image_height, camera.image_width, transport_format="png", timeout=WAIT_S
            )
        except (RuntimeError, TimeoutError) as error:
            self._browser.tell("No still", str(error), bad=True)
            return
        self._send("window", on_white(picture))

    def _still(self) -> None:
        """By the thread that renders, before all other pictures."""
        assert self._field is not None and self._browser.shared.field is not None
        layer, field, eye = self._field.shown, self._browser.shared.field, self._browser.eye
        if layer is None:
            self._browser.tell("No still", "The field is switched off: choose a layer.")
            return
        width = WIDTHS[self._width.value]
        began = time.monotonic()
        text = f"Rendering {width} px, before everything else."
        note = self._browser.client.add_notification("Still", text, loading=True)
        gone, rays = self._browser.gone, round(width * width / eye.aspect)
        found = self._browser.shared.renders.call(
            lambda: field.render(eye, layer, rays, goes_on=lambda: not gone.is_set())
        )
        try:
            picture = found.result()
        except Exception as error:
            self._browser.tell("No still", str(error), bad=True)
            return
        finally:
            note.remove()
        if picture is not None:
            self._send(f"field-{layer}", picture.picture)
            self._browser.tell("Still", f"Rendered in {time.monotonic() - began:.1f} s.")

    def _send(self, what: str, picture: UInt8[np.ndarray, "h w 3"]) -> None:
        file = io.BytesIO()
        Image.fromarray(picture).save(file, "PNG")
        name = f"plnerf-{what}-{time.strftime('%Y%m%d-%H%M%S')}.png"
        self._browser.client.send_file_download(name, file.getvalue(), save_immediately=True)


def on_white(picture: UInt8[np.ndarray, "h w c"]) -> UInt8[np.ndarray, "h w 3"]:
    """A picture without its transparency."""
    if picture.shape[2] == 3:
        return picture
    alpha = picture[..., 3:].astype(np.float32) / 255
    return np.round(picture[..., :3] * alpha + 255 * (1 - alpha)).astype(np.uint8)
