"""A wire that was clicked: its figures, and the photos that show it with the fitted curve drawn over."""

import numpy as np
from jaxtyping import Bool, Float, UInt8

from plnerf.line.ends import TWO_SIDED_95
from plnerf.line.survey import Survey
from plnerf.line.wire import Wire
from plnerf.report.colours import KINDS, rgb
from plnerf.report.figures import Units, share
from plnerf.report.overlay import overlay
from plnerf.view.browser import Browser
from plnerf.view.eye import eye_of
from plnerf.view.line_drawing import WIRE_PX, wire_node
from plnerf.view.page_text import plain
from plnerf.view.posed_views import PosedViews

PICTURE_PX = 960
"""Longer side of a photo in the panel."""
PLACES = 80
"""Along a wire, by which photos are ranked."""
CURVE_STEP_M = 0.2
LEAST_SHARE = 0.05
"""A photo shows a wire if it shows this share of its length, or as much as the best one does of it."""
PICKED, PICKED_PX = (255, 190, 0), 6.0
NOTHING = "Click a wire in the window."


class WirePanel:
    """Which wire and which of its photos."""

    def __init__(self, browser: Browser, survey: Survey) -> None:
        self._browser, self._survey = browser, survey
        self._wire: Wire | None = None
        self._seen: list[int] = []
        gui = browser.client.gui
        with gui.add_folder("Wire"):
            self._image = gui.add_image(np.full((2, 3, 3), 255, np.uint8), visible=False)
            self._turn = gui.add_button_group("shows it", ("larger", "smaller"), visible=False)
            self._go = gui.add_button("Go to this photo", visible=False)
            self._text = gui.add_markdown(NOTHING)
        self._at = 0
        self._turn.on_click(lambda _: self._step(-1 if self._turn.value == "larger" else 1))
        self._go.on_click(lambda _: self._go_there())

    def show(self, wire: Wire) -> None:
        """What is known of a wire, and the photo that shows it largest."""
        views = self._browser.opened.views
        if self._wire is not None:
            self._mark(self._wire, rgb(KINDS[self._wire.kind][1]), WIRE_PX)
        self._wire = wire
        self._mark(wire, PICKED, PICKED_PX)
        self._seen = [] if views is None or views.photos is None else photos_of_wire(views, wire)
        self._at = 0
        self._text.content = figures_of(wire, self._survey, len(self._seen))
        self._step(0)

    def _mark(self, wire: Wire, colour: tuple[int, int, int], px: float) -> None:
        """In another colour than its kind's, or in that again."""
        node = self._browser.client.scene.get_handle_by_name(wire_node(wire))
        if node is not None:
            node.colors, node.thickness = np.array(colour, np.uint8), px

    def _go_there(self) -> None:
        views = self._browser.opened.views
        if views is not None:
            self._browser.go_to(eye_of(views.cameras, self._seen[self._at], self._browser.eye.aspect))

    def _step(self, by: int) -> None:
        views = self._browser.opened.views
        there = bool(self._seen) and views is not None and self._wire is not None
        self._image.visible = self._turn.visible = self._go.visible = there
        if not there or views is None or self._wire is None:
            return
        self._at = (self._at + by) % len(self._seen)
        i = self._seen[self._at]
        drawn = with_wire(views, i, self._wire)
        if drawn is None:
            self._browser.tell("No photo", f"{views.names[i]} cannot be read.")
            return
        self._image.image = drawn
        self._image.label = f"{views.names[i]}, {self._at + 1} of {len(self._seen)}"


def photos_of_wire(views: PosedViews, wire: Wire) -> list[int]:
    """Photos that show the wire, if nothing hides it, in the order of how large they show it.

    That is by the length of the part of it inside of the picture, as a share of the picture's width.
    """
    places = wire.points(np.linspace(0.0, wire.base.length_m, PLACES))
    lengths, shares = np.zeros(len(views.names)), np.zeros(len(views.names))
    for i in range(len(views.names)):
        pixels, size = views.pixels(i, places), views.cameras.size_px[i].numpy()
        inside: Bool[np.ndarray, " p"] = np.all((pixels >= 0) & (pixels < size), axis=1)
        shares[i] = inside.mean()
        steps = np.linalg.norm(np.diff(pixels, axis=0), axis=1)
        lengths[i] = steps[inside[1:] & inside[:-1]].sum() / size[0]
    seen = np.flatnonzero((shares > 0) & (shares >= min(LEAST_SHARE, shares.max())))
    order: list[int] = seen[np.argsort(-lengths[seen])].tolist()
    return order


def with_wire(views: PosedViews, i: int, wire: Wire) -> UInt8[np.ndarray, "h w 3"] | None:
    """Photo i with a line on either side of the fitted wire; None where it cannot be read."""
    photo = views.photo(i, PICTURE_PX)
    if photo is None:
        return None
    shrink = np.array([photo.shape[1], photo.shape[0]]) / views.cameras.size_px[i].numpy()
    line: Float[np.ndarray, "v 2"] = views.pixels(i, wire.polyline(CURVE_STEP_M)) * shrink
    return overlay(photo, [line], [rgb(KINDS[wire.kind][1])])


def figures_of(wire: Wire, survey: Survey, photos: int) -> str:
    """A wire's figures as markdown, lengths with their 95 % intervals."""
    units, seen = Units(survey.frame.unit), wire.evidence
    rows: list[tuple[str, str]] = [("kind", KINDS[wire.kind][0]), ("span", str(survey.span_of(wire.id).id))]
    if wire.open is not None:
        rows.append(("no sag", wire.open))
    named = (("sag", wire.sag), ("span length", wire.span_m), ("length", wire.arc_m), ("p = H/w", wire.p_m))
    rows += [(name, units.interval_with_unit(one)) for name, one in named if one is not None]
    half = units.with_unit(TWO_SIDED_95 * wire.worst_sigma(), 3)
    rows.append(("known to", f"± {half} (95 %) across, at its least certain place"))
    rows.append(("seen in", f"{seen.source}, {share(seen.coverage)} of it"))
    if seen.residual_across_m or seen.residual_up_m:
        across, up = (units.with_unit(one, 3) for one in (seen.residual_across_m, seen.residual_up_m))
        rows.append(("residuals", f"{across} across, {up} up (root mean square)"))
    if photos:
        rows.append(("photos", f"{photos}, the one that shows it largest first"))
    rows += [("note", text) for text in wire.notes]
    head = f"**Wire {wire.id}**" + (f" ({plain(wire.name)})" if wire.name else "")
    return "\n".join([head, "", "| | |", "| --- | --- |", *(f"| {a} | {plain(b)} |" for a, b in rows)])
