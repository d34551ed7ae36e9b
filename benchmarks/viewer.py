"""How long a viewer's picture takes: `viewer.py RUN [--moves 9]`, a run folder of `plnerf train`.

A client that speaks the viewer's protocol moves along the way that was filmed and rests at each place until
the finest picture, 640 pixels wide, is there.  Given are the times from sending the move to having received
the first and the last picture, so without what a browser then takes to draw it, and the seconds that
processors work meanwhile, which other processes disturb less: medians, and the range.
"""

import argparse
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from tests.support.viewer_client import ViewerClient

from plnerf.view.display_frame import DisplayFrame
from plnerf.view.eye import Eye
from plnerf.view.field_pictures import FieldPictures
from plnerf.view.opened import open_source
from plnerf.view.server import ViewServer

WIDTH, HEIGHT = 800, 640
REST_S = 60.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("run", type=Path)
    parser.add_argument("--moves", type=int, default=9, help="(default: 9)")
    options = parser.parse_args()
    server = ViewServer(open_source(options.run), port=0)
    opened, flight = server._shared.opened, server._shared.flights[0]
    assert isinstance(server._shared.field, FieldPictures)
    took = []
    with ViewerClient(server.port) as client:
        # The first place does not count: kernels are loaded there, and the speed is measured.
        for share in np.linspace(0.1, 0.9, options.moves + 1):
            took.append(moved(client, flight.at(float(share), WIDTH / HEIGHT), opened.frame))
    server.stop()
    for name, times in zip(("first", "finest"), np.array(took[1:]).transpose(1, 2, 0), strict=True):
        passed, worked = (f"{np.median(one):.2f} s ({one.min():.2f} to {one.max():.2f})" for one in times)
        print(f"move to the {name} picture: {passed}, processors work {worked}, {options.moves} moves")


def moved(client: ViewerClient, eye: Eye, frame: DisplayFrame) -> list[tuple[float, float]]:
    """Seconds from a move to its first and to its finest picture: that pass, and that processors work."""
    before = len(client.of("BackgroundImageMessage"))
    texts = len([one for one in client.texts().splitlines() if one.startswith("640 ×")])
    place = frame.to_viewer(eye.centre).astype(float)
    began, worked = time.perf_counter(), time.process_time()
    client.look(place, place + eye.R_line_camera[:, 2], WIDTH, HEIGHT)
    client.wait(lambda: len(client.of("BackgroundImageMessage")) > before, "a first picture", REST_S)
    first = time.perf_counter() - began, time.process_time() - worked

    def finest() -> bool:
        return len([one for one in client.texts().splitlines() if one.startswith("640 ×")]) > texts

    client.wait(finest, "the finest picture", REST_S)
    return [first, (time.perf_counter() - began, time.process_time() - worked)]


if __name__ == "__main__":
    main()
