"""Distances between two places that are clicked: on wires, on points, on the field's surface."""

from dataclasses import dataclass

import numpy as np

from plnerf.line.ends import TWO_SIDED_95
from plnerf.report.colours import CLASSES, OTHER
from plnerf.report.figures import Units
from plnerf.view.browser import Browser
from plnerf.view.eye import looking
from plnerf.view.line_drawing import label, segments
from plnerf.view.opened import Opened
from plnerf.view.page_text import plain
from plnerf.view.pick import Picked, pick_point, pick_wire

COLOUR = (0, 90, 200)
HELP = "Two clicks in the window measure between a wire, a point or the field's surface and another."


@dataclass(frozen=True)
class Distance:
    """Between two places, in metres (or units of an unscaled line)."""

    space: float
    horizontal: float
    up: float
    """How much higher the second is."""

    @classmethod
    def between(cls, a: Picked, b: Picked) -> "Distance":
        """From the first place to the second."""
        step = b.at - a.at
        return cls(float(np.linalg.norm(step)), float(np.hypot(step[0], step[1])), float(step[2]))


class Ruler:
    """The button, the two places, and what is between them."""

    def __init__(self, browser: Browser) -> None:
        self._browser = browser
        self._first: Picked | None = None
        self._count = 0
        gui = browser.client.gui
        with gui.add_folder("Measure", expand_by_default=False):
            self._on = gui.add_checkbox("measure by clicks", initial_value=False, hint=HELP)
            self._text = gui.add_markdown(HELP)
            self._clear = gui.add_button("Clear")
        self._on.on_update(lambda _: self._begin())
        self._clear.on_click(lambda _: self.clear())

    @property
    def on(self) -> bool:
        """Whether clicks measure."""
        return bool(self._on.value)

    def _begin(self) -> None:
        self._first = None
        self._text.content = "Click the first place." if self.on else HELP

    def clear(self) -> None:
        """Removes all that was measured."""
        for k in range(self._count):
            self._browser.client.scene.remove_by_name(f"/measured/{k}")
        self._count = 0
        self._begin()

    def click(self, origin: np.ndarray, direction: np.ndarray) -> None:
        """A ray of the LineFrame was clicked."""
        picked = self._pick(origin, direction)
        if picked is None:
            self._text.content = "Nothing is there. Click a wire, a point or a surface."
            return
        if self._first is None:
            self._first = picked
            self._text.content = f"From {name_of(picked, self._browser.opened)}. Click the second place."
            return
        first, self._first = self._first, None
        self._text.content = self._drawn(first, picked)

    def _pick(self, origin: np.ndarray, direction: np.ndarray) -> Picked | None:
        opened, field = self._browser.opened, self._browser.shared.field
        found = pick_wire(opened, origin, direction) or pick_point(opened, origin, direction)
        if found is not None or field is None:
            return found
        eye = looking(origin, origin + direction, 1e-3, 1.0)
        along = self._browser.shared.renders.call(lambda: field.along(eye, direction)).result(timeout=30)
        return None if along is None else Picked("surface", 0, origin + along * direction)

    def _drawn(self, a: Picked, b: Picked) -> str:
        opened, units = self._browser.opened, Units(self._browser.opened.frame.line.unit)
        found = Distance.between(a, b)
        ends = opened.frame.to_viewer(np.stack([a.at, b.at]))
        scene, name = self._browser.client.scene, f"/measured/{self._count}"
        self._count += 1
        segments(scene, name, ends, COLOUR, 3.0)
        label(scene, f"{name}/text", units.with_unit(found.space, 3), ends.mean(0))
        return "  \n".join([
            f"**{units.with_unit(found.space, 3)}** from {name_of(a, opened)} to {name_of(b, opened)}",
            f"horizontally {units.with_unit(found.horizontal, 3)}, up {units.with_unit(found.up, 3)}",
            certainty(a, b, units),
        ])  # fmt: skip


def name_of(picked: Picked, opened: Opened) -> str:
    """What was clicked, in words."""
    if picked.kind == "wire":
        return f"wire {picked.number}"
    if picked.kind == "surface":
        return "the field's surface"
    points = opened.points
    if points is None or points.label is None:
        return "a point"
    return f"a point ({plain(CLASSES.get(int(points.label[picked.number]), OTHER)[0])})"


def certainty(a: Picked, b: Picked, units: Units) -> str:
    """How well the distance is known, as far as that is known: the wires' part of it."""
    known = [one.sigma_m for one in (a, b) if one.sigma_m is not None]
    if not known:
        return "How well these places are known is not known."
    half = TWO_SIDED_95 * float(np.hypot.reduce(known))
    rest = "" if len(known) == 2 else "; that of the other place is not known"
    return f"± {units.with_unit(half, 3)} (95 %) by the fitted wire{'s' * (len(known) - 1)}{rest}"
