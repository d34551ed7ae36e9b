"""A slider that flies one browser's camera along the line."""

import time

from plnerf.view.browser import Browser
from plnerf.view.flights import Flight

SPEED, FRAME_S = 6.0, 0.1
"""Metres a second, and seconds between two places, of a flight that plays by itself."""


class FlightPanel:
    """Which way, how far along it, and whether it plays."""

    def __init__(self, browser: Browser) -> None:
        self._browser, self._flights = browser, {one.name: one for one in browser.shared.flights}
        gui = browser.client.gui
        with gui.add_folder("Fly along"):
            names = tuple(self._flights)
            self._way = gui.add_dropdown("way", names, initial_value=names[0], visible=len(names) > 1)
            # Where the first view of a run is; other first views are beside all ways.
            start = 50.0 if browser.opened.run is not None else 0.0
            self._share = gui.add_slider("along, %", min=0.0, max=100.0, step=0.25, initial_value=start)
            self._plays = gui.add_checkbox("play", initial_value=False)
        self._way.on_update(lambda _: self._fly())
        self._share.on_update(lambda _: self._fly())
        self._plays.on_update(lambda _: self._play())

    @property
    def way(self) -> Flight:
        """The way that is chosen."""
        return self._flights[self._way.value]

    def _fly(self) -> None:
        self._browser.go_to(self.way.at(self._share.value / 100, self._browser.eye.aspect))

    def _play(self) -> None:
        """In a thread of the server's pool, until it is stopped, the way ends or the browser is gone."""
        while self._plays.value and not self._browser.gone.is_set():
            length = max(self.way.length_m, 1e-6)
            share = self._share.value + 100 * SPEED * FRAME_S / length
            if share > 100:
                self._plays.value = False
                return
            self._share.value = share
            time.sleep(FRAME_S)
