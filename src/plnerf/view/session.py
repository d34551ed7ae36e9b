"""What one browser gets when it connects: everything drawn, the panels, and what clicks and moves do."""


import numpy as np
import viser

from plnerf.report.figures import counted
from plnerf.view.browser import Browser
from plnerf.view.field_panel import FieldPanel
from plnerf.view.film_panel import FilmPanel
from plnerf.view.flight_panel import FlightPanel
from plnerf.view.opened import Opened
from plnerf.view.page_text import plain
from plnerf.view.photo_panel import PhotoPanel
from plnerf.view.pick import pick_camera, pick_wire
from plnerf.view.ruler import Ruler
from plnerf.view.save_panel import SavePanel
from plnerf.view.show_panel import ShowPanel
from plnerf.view.training_panel import TrainingPanel
from plnerf.view.wire_panel import WirePanel


def begin_session(browser: Browser) -> None:
    """Draws the scene for a browser and builds its page."""
    opened, shared, client = browser.opened, browser.shared, browser.client
    client.gui.add_markdown(about(opened, training=shared.progress is not None))
    training = TrainingPanel(browser, shared.progress) if shared.progress is not None else None
    field = FieldPanel(browser, shared.field) if shared.field is not None else None
    flight = FlightPanel(browser) if shared.flights else None
    wires = WirePanel(browser, opened.survey) if opened.survey and opened.survey.wires else None
    drawn = ShowPanel(browser)
    photos = PhotoPanel(browser, opened.views, drawn) if opened.views is not None else None
    ruler = Ruler(browser)
    save = SavePanel(browser, field)
    if field is not None and flight is not None and shared.films is not None:
        FilmPanel(browser, field, flight, shared.films, save.folder)

    def moved(_: viser.CameraHandle) -> None:
        browser.backdrop.look(browser.eye)
        if field is not None:
            field.draw(browser.eye)

    def clicked(event: viser.SceneClickEvent) -> None:
        origin = opened.frame.to_line(np.array(event.ray_origin, np.float64))
        direction = np.array(event.ray_direction, np.float64)
        direction /= np.linalg.norm(direction)
        if ruler.on:
            ruler.click(origin, direction)
            return
        wire = pick_wire(opened, origin, direction)
        if wire is not None and wires is not None and opened.survey is not None:
            wires.show(next(one for one in opened.survey.wires if one.id == wire.number))
            return
        camera = pick_camera(opened, origin, direction)
        if camera is not None and photos is not None:
            photos.go_to(camera.number)

    def renew() -> None:
        if training is not None:
            training.show()
        if field is not None:
            field.refresh()

    browser.renew = renew
    client.camera.on_update(moved)
    client.scene.on_click()(clicked)
    if field is not None:
        field.draw(browser.eye)
    drawn.fill_photos()


def about(opened: Opened, *, training: bool = False) -> str:
    """What is shown, and what could not be."""
    parts = []
    if opened.run is not None:
        reached = "in training" if training else f"step {opened.run.step:,}"
        parts.append(f"field of {plain(opened.run.config.preset)}, {reached}")
    if opened.survey is not None:
        parts.append(counted(len(opened.survey.wires), "wire"))
    if opened.points is not None:
        shown, total = len(opened.points.xyz), opened.points.total
        parts.append(counted(shown, "point") + (f" of {total:,}" if shown < total else ""))
    if opened.views is not None:
        parts.append(counted(len(opened.views.names), "camera"))
    lines = [f"**{plain(opened.title)}**", ", ".join(parts), *(f"*{plain(one)}*" for one in opened.notes)]
    if opened.frame.line.unit == "unscaled":
        lines.append("Nothing gives this scene a scale: lengths are in units, unscaled.")
    return "  \n".join(lines)
