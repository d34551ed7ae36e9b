"""The panel of a run in training: its curves, and buttons that let it wait or end it."""

import numpy as np
import viser

from plnerf.view.browser import Browser
from plnerf.view.training_progress import TrainingProgress

HEIGHT_PX = 110
TICK_PX = 15
"""Between two marks of the axis upwards at least; with uPlot's 30 px a curve this low has one mark."""
BLUE, AMBER = "#1971c2", "#e8890c"


class TrainingPanel:
    """Of one browser; what its buttons do holds for all."""

    def __init__(self, browser: Browser, progress: TrainingProgress) -> None:
        self._browser, self._progress = browser, progress
        gui = browser.client.gui
        with gui.add_folder("Training"):
            self._text = gui.add_markdown(progress.text())
            self._loss = self._chart("loss, all terms", BLUE, logarithmic=True)
            self._psnr = self._chart("PSNR of training pixels, dB", BLUE)
            self._held_out = self._chart("PSNR of held-out pixels, dB", AMBER)
            self._wait = gui.add_button("Pause", hint="After this step; pictures go on.")
            stop = gui.add_button(
                "Stop and save", hint="Writes a checkpoint and ends; plnerf train ... --resume goes on."
            )
        self._wait.on_click(lambda _: self._pause())
        stop.on_click(lambda _: self._stop())
        self.show()

    def show(self) -> None:
        """The newest values."""
        steps, loss, psnr = self._progress.curves()
        held_at, held_out = self._progress.held_out()
        self._text.content = self._progress.text()
        self._wait.label = "Go on" if self._progress.turns.paused else "Pause"
        for chart, at, values in (
            (self._loss, steps, loss), (self._psnr, steps, psnr), (self._held_out, held_at, held_out),
        ):  # fmt: skip
            chart.visible = len(at) > 1  # of fewer there is no curve
            if len(at) > 1:
                chart.data = (at, values)

    def _chart(self, title: str, colour: str, *, logarithmic: bool = False) -> viser.GuiUplotHandle:
        """An empty chart, not on show yet."""
        curve = {"label": "value", "stroke": colour, "width": 1.5, "points": {"show": False}}
        return self._browser.client.gui.add_uplot(
            (np.zeros(1), np.ones(1)), ({"label": "step"}, curve),
            scales={"x": {"time": False}, "y": {"distr": 3 if logarithmic else 1}},
            axes=({}, {} if logarithmic else {"space": TICK_PX}), title=title, height=HEIGHT_PX,
            padding=(10, 24, 0, 0), legend={"show": False}, visible=False,
        )  # fmt: skip

    def _pause(self) -> None:
        self._progress.turns.pause(not self._progress.turns.paused)
        self.show()

    def _stop(self) -> None:
        self._progress.turns.stop()
        self.show()

