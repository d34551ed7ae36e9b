"""What of the line, its points and its cameras one browser shows, and in which colours."""

from typing import cast

import viser

from plnerf.view.browser import Browser
from plnerf.view.display_frame import LINE_PER_UNIT
from plnerf.view.frustums import draw_frustums
from plnerf.view.line_drawing import Part, draw_line
from plnerf.view.points import Colouring, Points

LABELS: dict[Part, str] = {
    "wires": "wires",
    "structures": "structures",
    "names": "names, sag",
    "clearances": "clearances",
    "coverage": "what was seen",
}
HIDDEN: tuple[str, ...] = ("coverage",)
"""At first."""
POINT_M = 0.06
"""Size of a point at first."""


class ShowPanel:
    """Draws all of it once, and shows or hides its parts."""

    def __init__(self, browser: Browser) -> None:
        self._browser, self._client, opened = browser, browser.client, browser.opened
        self._cameras: viser.SceneNodeHandle | None = None
        self._cameras_on: viser.GuiCheckboxHandle | None = None
        self._frustums: list[viser.CameraFrustumHandle] = []
        scene, frame = browser.client.scene, opened.frame
        with browser.client.gui.add_folder("Show"):
            if opened.survey is not None:
                for part, node in draw_line(scene, opened.survey, frame).items():
                    self._switch(LABELS[part], node, part not in HIDDEN)
            if opened.points is not None and len(opened.points.xyz):
                # Over a field they would hide what is to be seen.
                self._draw_points(opened.points, browser, opened.run is None)
            if opened.views is not None and browser.shared.small_photos is not None:
                root, self._frustums = draw_frustums(scene, opened.views, frame)
                self._cameras, self._cameras_on = root, self._switch("cameras", root, opened.run is None)

    def fill_photos(self) -> None:
        """Gives the cameras their photos, one after the other: large ones take a while to read."""
        photos = self._browser.shared.small_photos
        for i, frustum in enumerate(self._frustums):
            if self._browser.gone.is_set() or photos is None:
                return
            if (photo := photos.of(i)) is not None:
                frustum.image = photo

    def without_cameras(self, without: bool) -> None:
        """Hides the cameras whatever their switch says, as where the eye is at one of them."""
        if self._cameras is not None and self._cameras_on is not None:
            self._cameras.visible = self._cameras_on.value and not without

    def _switch(self, name: str, node: viser.SceneNodeHandle, on: bool) -> viser.GuiCheckboxHandle:
        box = self._client.gui.add_checkbox(name, initial_value=on)
        node.visible = on

        def switched(_: object) -> None:
            node.visible = box.value

        box.on_update(switched)
        return box

    def _draw_points(self, points: Points, browser: Browser, on: bool) -> None:
        gui, xyz = self._client.gui, browser.opened.frame.to_viewer(points.xyz)
        node = self._client.scene.add_point_cloud(
            "/points", xyz, points.colours(points.colourings[0]), point_size=POINT_M / LINE_PER_UNIT,
            point_shape="circle", point_shading="flat", precision="float32",
        )  # fmt: skip
        self._switch("points", node, on)
        by = gui.add_dropdown("colours of points", points.colourings)
        size = gui.add_slider("size of points, cm", 1.0, 50.0, 1.0, 100 * POINT_M)

        def coloured(_: object) -> None:
            node.colors = points.colours(cast(Colouring, by.value))

        def sized(_: object) -> None:
            node.point_size = size.value / 100 / LINE_PER_UNIT

        by.on_update(coloured)
        size.on_update(sized)
