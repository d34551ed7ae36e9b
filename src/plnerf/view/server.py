"""The server: a port of this machine, a page, and a browser's session for each who opens it."""

import contextlib
import io
import socket
from collections.abc import Iterator
from typing import Any

import numpy as np
import viser

from plnerf.errors import ConfigError
from plnerf.view.browser import Browser, Shared
from plnerf.view.display_frame import LINE_PER_UNIT
from plnerf.view.eye import Eye, looking
from plnerf.view.field_pictures import FieldPictures
from plnerf.view.films import FilmRoom
from plnerf.view.flights import FOV_RAD, flights_of
from plnerf.view.frustums import SmallPhotos
from plnerf.view.opened import Opened
from plnerf.view.origins import own_page
from plnerf.view.render_thread import RenderThread
from plnerf.view.session import begin_session
from plnerf.view.training_progress import TrainingProgress

DEFAULT_PORT = 8080
TRIES = 100
ASPECT = 1.25
"""Of a window that is not known yet."""


class ViewServer:
    """Serves what is opened from its construction until `stop`."""

    def __init__(
        self,
        opened: Opened,
        host: str = "127.0.0.1",
        port: int | None = None,
        progress: TrainingProgress | None = None,
    ) -> None:
        """port: None: DEFAULT_PORT or the next that is free.  progress: of a run that is being trained.

        Raises ConfigError where the port is taken, or the host is no address of this machine.
        """
        free = free_port(host, port)
        self._renders = RenderThread()
        turns = None if progress is None else progress.turns
        field = None if opened.run is None else FieldPictures(opened.run, opened.frame, turns)
        small = None if opened.views is None else SmallPhotos(opened.views)
        films = None if field is None or progress is not None else FilmRoom(field, self._renders)
        self._shared = Shared(opened, self._renders, field, flights_of(opened), small, films, progress)
        self._browsers: dict[int, Browser] = {}
        with quiet():
            self._server: Any = viser.ViserServer(host, free, label="plnerf", verbose=False)
        # A client could otherwise have viser publish all of this at an address on the internet.
        self._server.request_share_url = lambda verbose=True: None
        self._server.gui.configure_theme(show_share_button=False, show_logo=False, control_width="medium")
        self._server.gui.main_panel.dock_right()
        self._server.scene.set_up_direction("+z")
        self._set_first_view(*first_view(self._shared))
        self._server.on_client_connect(self._connected)
        self._server.on_client_disconnect(self._gone)
        self.host, self.port = host, int(self._server.get_port())
        self._renders.start()
        if field is not None and progress is None:  # so that the kernels are there when somebody looks
            eye, _ = first_view(self._shared)
            self._renders.call(lambda: field.render(eye, "rgb", 600))

    @property
    def address(self) -> str:
        """To be opened in a browser."""
        host = {"0.0.0.0": "127.0.0.1", "::": "[::1]"}.get(self.host, self.host)
        return f"http://{host}:{self.port}"

    @property
    def watched(self) -> bool:
        """Whether a browser is connected."""
        return bool(self._browsers)

    def renew(self) -> None:
        """Shows every browser what a training has reached."""
        for browser in list(self._browsers.values()):
            if not browser.gone.is_set():
                browser.renew()

    def stop(self) -> None:
        """Ends all sessions and the server."""
        for browser in list(self._browsers.values()):
            browser.gone.set()
        self._renders.stop()
        with quiet():
            self._server.stop()

    def _set_first_view(self, eye: Eye, distance_m: float) -> None:
        frame, start = self._shared.opened.frame, self._server.initial_camera
        start.position = frame.to_viewer(eye.centre).astype(np.float64)
        start.look_at = frame.to_viewer(eye.centre + distance_m * eye.R_line_camera[:, 2]).astype(np.float64)
        start.up, start.fov = np.array([0.0, 0.0, 1.0]), eye.fov_rad

    def _connected(self, client: viser.ClientHandle) -> None:
        """Everything is sent to each client from here on: one that is refused gets an empty page."""
        connection = self._server._websock_server._live_connections.get(client.client_id)
        if connection is None or not own_page(connection.request.headers, self.host):
            return
        browser = Browser(client, self._shared)
        self._browsers[client.client_id] = browser
        begin_session(browser)

    def _gone(self, client: viser.ClientHandle) -> None:
        self._renders.forget(client.client_id)
        browser = self._browsers.pop(client.client_id, None)
        if browser is not None:
            browser.gone.set()


def first_view(shared: Shared) -> tuple[Eye, float]:
    """The middle of a run's own flight; of anything else all of it, seen from aside.

    And how far from there the place is that dragging turns about, LineFrame.
    """
    opened = shared.opened
    if opened.run is not None and shared.flights:
        return shared.flights[0].at(0.5, ASPECT), LINE_PER_UNIT
    places = []
    if opened.survey is not None:
        places += [wire.points(np.array([0.0, wire.base.length_m])) for wire in opened.survey.wires]
    if not places and opened.views is not None:
        places.append(opened.views.cameras.centre.numpy())
    if not places and opened.points is not None and len(opened.points.xyz):
        places.append(np.percentile(opened.points.xyz, [5, 95], axis=0))
    points = np.concatenate(places) if places else np.zeros((1, 3))
    middle, extent = (points.min(0) + points.max(0)) / 2, max(float(np.ptp(points, axis=0).max()), 1.0)
    along = np.linalg.svd(points[:, :2] - points[:, :2].mean(0), full_matrices=False)[2][0]
    aside = np.array([along[1], -along[0], 0.0])
    away = extent * (0.95 * aside + [0, 0, 0.4])
    return looking(middle + away, middle, FOV_RAD, ASPECT), float(np.linalg.norm(away))


def free_port(host: str, port: int | None) -> int:
    """The port asked for, or from DEFAULT_PORT on the first that is free.  Raises ConfigError without one."""
    wanted = [port] if port is not None else [*range(DEFAULT_PORT, DEFAULT_PORT + TRIES)]
    why: OSError | None = None
    for one in wanted:
        if not 0 <= one <= 65535:
            raise ConfigError(f"A port is a number from 0 (any free one) to 65535, but got {one}.")
        try:
            family, kind, protocol, _, address = socket.getaddrinfo(host, one, type=socket.SOCK_STREAM)[0]
            with socket.socket(family, kind, protocol) as tried:
                tried.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                tried.bind(address)
                tried.listen(1)
                return int(tried.getsockname()[1])
        except OSError as error:
            why = error
    if port is not None:
        raise ConfigError(
            f"The port {port} of {host} cannot be opened ({why}). Give another --port, or none for one that "
            "is free."
        )
    raise ConfigError(
        f"No port from {DEFAULT_PORT} to {DEFAULT_PORT + TRIES - 1} of {host} can be opened ({why}). Give a "
        "--host that is an address of this machine, or a --port."
    )


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Without what viser prints when it begins and ends."""
    with contextlib.redirect_stdout(io.StringIO()):
        yield
