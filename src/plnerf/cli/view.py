"""The command that shows a run, a scene or a survey in a browser."""

import threading
import warnings
from importlib.util import find_spec
from pathlib import Path

import tyro

from plnerf.errors import ConfigError
from plnerf.terminal import Terminal

EXTRA = 'pip install "plnerf[view]"'


def require_viewer(command: str) -> None:
    """Raises ConfigError where the extra is not installed."""
    if find_spec("viser") is None:
        raise ConfigError(f"{command} shows things by viser, which is not installed. Run: {EXTRA}")
    # A browser may go while something is on its way to it.
    warnings.filterwarnings("ignore", "Queued a .* on a closed connection", UserWarning)


def view(
    source: tyro.conf.Positional[Path],
    *,
    scene: Path | None = None,
    host: str = "127.0.0.1",
    port: int | None = None,
    seconds: float | None = None,
) -> None:
    """Show a run, a scene or a survey in a browser (needs the extra plnerf[view]); Ctrl-C ends it.

    Args:
        source: Run folder, scene, or survey folder.
        scene: Run or scene that a survey was made of, for its photos; that of the folder which the survey's
            lies in when left out.
        host: Address of this machine to listen at; 0.0.0.0 shows it to the whole network, to anyone.
        port: Port to listen at; 8080, or the next one that is free, when left out.
        seconds: Ends by itself after so long.
    """
    require_viewer("plnerf view")
    if seconds is not None and not 0 <= seconds <= threading.TIMEOUT_MAX:
        raise ConfigError(f"--seconds must be 0 or more and finite, but got {seconds}.")
    from plnerf.console import say
    from plnerf.view.opened import open_source
    from plnerf.view.server import ViewServer

    console = Terminal()
    opened = open_source(source, scene)
    for note in opened.notes:
        say(console, note)
    server = ViewServer(opened, host, port)
    try:
        say(console, f"Open {server.address} in a browser. Ctrl-C ends it.")
        threading.Event().wait(seconds)
    except KeyboardInterrupt as stop:
        if type(stop) is not KeyboardInterrupt:  # SIGTERM
            raise
    finally:
        server.stop()
