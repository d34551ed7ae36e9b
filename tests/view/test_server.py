"""The server as browsers meet it: what they are sent, what their clicks do, and who else is there."""

import http.client
import socket
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("viser", reason="plnerf[view] is not installed")

from tests.support.surveys import short
from tests.support.tiny_run import small
from tests.support.viewer_client import ViewerClient

from plnerf.errors import ConfigError
from plnerf.line.survey import Survey
from plnerf.pipeline import train_scene, write_survey
from plnerf.train.report import SilentReport
from plnerf.view.display_frame import DisplayFrame
from plnerf.view.field_pictures import FieldPictures
from plnerf.view.opened import Opened, open_source
from plnerf.view.origins import own_page
from plnerf.view.server import ViewServer, free_port

pytestmark = pytest.mark.filterwarnings("ignore:Queued a .* on a closed connection")
"""Of viser, where a browser is gone while something is on its way to it."""
ORIGIN, AT = np.array([0.0, -3.0, 1.0]), np.array([0.0, 0.0, 0.2])


@pytest.fixture(scope="module")
def survey() -> Survey:
    return short(0.05)


@pytest.fixture(scope="module")
def survey_folder(survey: Survey, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("surveyed")
    write_survey(survey, folder)
    return folder


@pytest.fixture(scope="module")
def run_folder(built_tiny_scene: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("trained") / "run"
    return train_scene(built_tiny_scene, folder, steps=3, device="cpu", report=SilentReport(), **small())


@pytest.fixture(scope="module")
def of_survey(survey_folder: Path) -> Iterator[ViewServer]:
    server = ViewServer(open_source(survey_folder), port=0)
    yield server
    server.stop()


@pytest.fixture(scope="module")
def of_run(run_folder: Path) -> Iterator[ViewServer]:
    server = ViewServer(open_source(run_folder), port=0)
    yield server
    server.stop()


def get(port: int, path: str) -> tuple[int, bytes]:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=10)
    connection.request("GET", path)
    answer = connection.getresponse()
    return answer.status, answer.read()


def test_the_page_is_served_and_no_file_beside_it(of_survey: ViewServer, survey_folder: Path) -> None:
    assert of_survey.address == f"http://127.0.0.1:{of_survey.port}"
    status, page = get(of_survey.port, "/")
    assert status == 200 and b"<html" in page[:2000].lower()
    here = str(survey_folder / "survey.json")
    for path in (
        "/survey.json", "/../../__init__.py", "/%2e%2e/%2e%2e/__init__.py", "/..%5c..%5c__init__.py",
        "/" + here, "//etc/passwd", "/%2fetc%2fpasswd", here, "/../../../../../../../../etc/passwd",
    ):  # fmt: skip
        assert get(of_survey.port, path)[0] == 404, path


def test_it_listens_at_loopback_alone(of_survey: ViewServer) -> None:
    socket.create_connection(("127.0.0.1", of_survey.port), timeout=5).close()
    with pytest.raises(OSError):  # another address of this machine
        socket.create_connection(("127.0.0.2", of_survey.port), timeout=5).close()


def test_nobody_can_have_it_published(of_survey: ViewServer, monkeypatch: pytest.MonkeyPatch) -> None:
    import viser._viser

    asked: list[object] = []
    monkeypatch.setattr(viser._viser, "ViserTunnel", lambda *given: asked.append(given))
    with ViewerClient(of_survey.port) as client:
        client.look(ORIGIN, AT)
        client.send("ShareUrlRequest")
        client.control("Clear")
        time.sleep(0.1)
    assert asked == []


@pytest.mark.parametrize(
    ("origin", "host", "own"),
    [
        (None, "127.0.0.1:8080", True),
        ("http://127.0.0.1:8080", "127.0.0.1:8080", True),
        ("http://localhost:8080", "localhost:8080", True),
        ("http://[::1]:8080", "[::1]:8080", True),
        ("http://192.168.1.7:8080", "192.168.1.7:8080", True),
        ("https://evil.example", "127.0.0.1:8080", False),
        ("http://127.0.0.1:9000", "127.0.0.1:8080", False),
        ("http://evil.example:8080", "evil.example:8080", False),  # a name that points here
        ("null", "127.0.0.1:8080", False),
        (None, "", False),
    ],
)
def test_pages_of_others_are_told_apart(origin: str | None, host: str, own: bool) -> None:
    headers = {"Host": host} | ({} if origin is None else {"Origin": origin})
    assert own_page(headers, "127.0.0.1") is own


def test_a_page_of_somebody_else_sees_nothing(of_survey: ViewServer) -> None:
    with ViewerClient(of_survey.port, Origin="https://evil.example") as other:
        other.look(ORIGIN, AT)
        with ViewerClient(of_survey.port, Origin=of_survey.address) as client:
            client.look(ORIGIN, AT)
            client.wait(lambda: "/points" in client.nodes(), "points")
        assert not {name for name in other.nodes() if name.startswith(("/line", "/points", "/cameras"))}
        assert "wire" not in other.texts()


def test_a_browser_gets_the_line_and_its_points(of_survey: ViewServer, survey: Survey) -> None:
    with ViewerClient(of_survey.port) as client:
        client.look(ORIGIN, AT)
        client.wait(lambda: "/points" in client.nodes(), "points")
        cloud = next(one for one in client.of("PointCloudMessage") if one["name"] == "/points")["props"]
        wires = {one["name"]: one["props"] for one in client.of("LineSegmentsMessage")}
    assert cloud["precision"] == "float32" and cloud["points"].dtype == np.float32
    frame = frame_of(of_survey)
    places = frame.to_line(cloud["points"].reshape(-1, 3))
    assert len(places) == len(survey.cloud.xyz)
    assert np.abs(np.sort(places, 0) - np.sort(survey.cloud.xyz, 0)).max() < 1e-3  # the file's CRS and back
    for wire in survey.wires:
        drawn = frame.to_line(wires[f"/line/wires/{wire.id}"]["points"].reshape(-1, 3))
        s = wire.base.local(drawn)[:, 0]
        assert np.abs(wire.points(s) - drawn).max() < 1e-3
        assert s.min() < 0.01 and s.max() > wire.base.length_m - 0.01
    text = client.texts()
    assert "wire 1 · sag 1.21" in text and "structure 1 · suspension · 15.3\xa0m high" in text
    assert "5 wires" in text and "closer than required" in text


def frame_of(server: ViewServer) -> DisplayFrame:
    return server._shared.opened.frame


def test_a_click_on_a_wire_says_what_is_known_of_it(of_survey: ViewServer, survey: Survey) -> None:
    frame, wire = frame_of(of_survey), survey.wires[2]
    at = frame.to_viewer(wire.points(np.array([17.3])))[0].astype(float)
    with ViewerClient(of_survey.port) as client:
        client.look(ORIGIN, AT)
        client.click(ORIGIN, (at - ORIGIN) / np.linalg.norm(at - ORIGIN))
        client.wait(lambda: "**Wire 3**" in client.texts(), "figures of wire 3")
        marked = [one for one in client.of("SceneNodeUpdateMessage") if "colors" in one["updates"]]
        assert [one["name"] for one in marked] == ["/line/wires/3"]
        text = client.texts()
    assert "phase conductor" in text and "1,203 points, 55" in text and "0.012" in text


def test_two_clicks_measure(of_survey: ViewServer, survey: Survey) -> None:
    frame = frame_of(of_survey)
    ends = [survey.wires[k].points(np.array([20.0]))[0] for k in (0, 2)]
    with ViewerClient(of_survey.port) as client:
        client.look(ORIGIN, AT)
        client.choose("measure by clicks", True)
        client.wait(lambda: "Click the first place" in client.texts(), "the ruler")
        for k, end in enumerate(ends):
            to = frame.to_viewer(end).astype(float) - ORIGIN
            client.click(ORIGIN, to / np.linalg.norm(to))
            words = ("From wire 1", "to wire 3")[k]
            client.wait(lambda words=words: words in client.texts(), words)  # type: ignore[misc]
        expected = np.linalg.norm(ends[1] - ends[0])
        assert f"**{expected:.2f}" in client.texts()
        assert "(95 %) by the fitted wires" in client.texts()
        assert "/measured/0" in client.nodes()


def moves(client: ViewerClient) -> list[dict[str, Any]]:
    """What moved its camera, after the first view."""
    return [one for one in client.of("SetCameraPositionMessage") if not one["initial"]]


def test_a_slider_flies_along_the_line(of_survey: ViewServer, survey: Survey) -> None:
    frame, places = frame_of(of_survey), []
    with ViewerClient(of_survey.port) as client:
        client.look(ORIGIN, AT)
        for share in (10.0, 90.0):
            before = len(moves(client))
            client.choose("along, %", share)
            client.wait(lambda n=before: len(moves(client)) > n, "a move")  # type: ignore[misc]
            places.append(frame.to_line(np.array(moves(client)[-1]["position"])))
    along = survey.wires[0].base.u
    assert 0.75 * 40 < (places[1] - places[0])[:2] @ along < 0.85 * 42


def photos_on(client: ViewerClient) -> set[str]:
    """The cameras that have a photo."""
    updates = client.of("SceneNodeUpdateMessage")
    return {one["name"] for one in updates if "_image_data" in one["updates"]}


def test_the_field_comes_coarse_and_then_fine_to_two_browsers(of_run: ViewServer) -> None:
    with ViewerClient(of_run.port) as one, ViewerClient(of_run.port) as two:
        for client in (one, two):
            client.look(ORIGIN / 10, AT / 10)
        for client in (one, two):
            client.wait(lambda c=client: "96 × 64 px" in c.texts(), "the finest picture")  # type: ignore[misc]
            pictures = client.of("BackgroundImageMessage")
            assert pictures[-1]["rgb_data"] is not None and pictures[-1]["depth_data"] is not None
        one.choose("layer", "depth")
        one.wait(lambda: "grey: no surface" in one.texts(), "depths")
        assert "grey: no surface" not in two.texts()  # each has a view of its own
        two.wait(lambda: len(photos_on(two)) == 12, "a photo on each camera")
        one.choose("layer", "off")
        one.wait(lambda: one.of("BackgroundImageMessage")[-1]["rgb_data"] is None, "an empty background")


def test_a_browser_that_vanishes_in_mid_render_leaves_the_other_its_pictures(of_run: ViewServer) -> None:
    lost = ViewerClient(of_run.port)
    lost.look(ORIGIN / 10, AT / 10, 1600, 1000)
    lost.wait(lambda: bool(lost.of("BackgroundImageMessage")), "a first picture")
    lost.vanish()
    with ViewerClient(of_run.port) as client:
        client.look(ORIGIN / 10, AT / 10)
        client.wait(lambda: "96 × 64 px" in client.texts(), "the finest picture")
        client.wait(lambda: not (of_run._browsers.keys() - {max(of_run._browsers)}), "the end of the other")


def test_a_picture_that_fails_is_told_and_the_next_move_draws(
    of_run: ViewServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    tried: list[object] = []

    def fails(*given: object, **__: object) -> None:
        tried.append(given)
        raise MemoryError("no *room* for it")

    with ViewerClient(of_run.port) as client:
        client.look(ORIGIN / 10, AT / 10)
        client.wait(lambda: "96 × 64 px" in client.texts(), "the finest picture")
        with monkeypatch.context() as failing:
            failing.setattr(FieldPictures, "render", fails)
            for step in range(1, 4):  # as of a camera that is dragged
                client.look(ORIGIN / 10 * (1 + step / 10), AT / 10)
                client.wait(lambda n=step: len(tried) >= n, "a picture that fails")  # type: ignore[misc]
            client.wait(lambda: "no &#42;room&#42; for it" in client.texts(), "the error in the panel")
            client.wait(lambda: client.of("BackgroundImageMessage")[-1]["rgb_data"] is None, "no old picture")
            client.wait(lambda: of_run._renders.idle, "the end of the pictures")
        notes = [one["props"] for one in client.of("NotificationShowMessage")]
        assert [(one["title"], one["body"], one["color"]) for one in notes] == [
            ("The field cannot be rendered", "no *room* for it", "red")
        ]
        seen = len(client.of("BackgroundImageMessage"))
        client.look(ORIGIN / 10 * 1.5, AT / 10)
        client.wait(lambda: len(client.of("BackgroundImageMessage")) > seen, "a picture after the error")
        assert client.of("BackgroundImageMessage")[-1]["rgb_data"] is not None


def test_a_still_is_downloaded(of_run: ViewServer) -> None:
    with ViewerClient(of_run.port) as client:
        client.look(ORIGIN / 10, AT / 10)
        client.choose("layer", "normals")
        client.choose("width", "320 px")
        client.choose("Still of the field", True)
        client.wait(lambda: bool(client.of("FileTransferPart")), "a download", 60.0)
        name = client.of("FileTransferStartDownload")[0]["filename"]
        data = b"".join(bytes(one["content"]) for one in client.of("FileTransferPart"))
    assert name.startswith("plnerf-field-normals-") and name.endswith(".png") and data[1:4] == b"PNG"


def test_a_photo_is_wiped_over_the_field(of_run: ViewServer) -> None:
    with ViewerClient(of_run.port) as client:
        client.look(ORIGIN / 10, AT / 10)
        client.choose("photo", 4)
        client.wait(lambda: "5 of 12" in client.texts(), "the name of the photo")
        client.choose("wipe, %", 40)
        client.wait(lambda: bool(moves(client)), "the place of the photo")
        place = np.array(moves(client)[-1]["position"])
    views = of_run._shared.opened.views
    assert views is not None
    there = of_run._shared.opened.frame.to_viewer(views.cameras.centre[4].numpy())
    assert np.abs(place - there).max() < 1e-5


def test_a_click_on_a_camera_goes_there(of_run: ViewServer) -> None:
    views = of_run._shared.opened.views
    assert views is not None
    there = frame_of(of_run).to_viewer(views.cameras.centre[7].numpy()).astype(float)
    origin = there + np.array([0.3, -0.2, 0.9])
    with ViewerClient(of_run.port) as client:
        client.look(ORIGIN / 10, AT / 10)
        client.click(origin, (there - origin) / np.linalg.norm(there - origin))
        client.wait(lambda: bool(moves(client)), "a move")
        assert np.abs(np.array(moves(client)[-1]["position"]) - there).max() < 1e-5


def test_a_free_port_where_the_default_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        monkeypatch.setattr("plnerf.view.server.DEFAULT_PORT", port)
        assert port < free_port("127.0.0.1", None) < port + 100
        with pytest.raises(ConfigError, match=f"The port {port} of 127.0.0.1 cannot be opened"):
            free_port("127.0.0.1", port)
    with pytest.raises(ConfigError, match="--host that is an address of this machine"):
        free_port("192.0.2.1", None)
    with pytest.raises(ConfigError, match="from 0"):
        free_port("127.0.0.1", 70_000)


def test_texts_of_others_are_no_markup(of_survey: ViewServer) -> None:
    opened: Opened = of_survey._shared.opened
    bad = replace(opened, title="<img src=x onerror=alert(1)>", notes=("[a](javascript:b) **c**",))
    server = ViewServer(bad, port=0)
    try:
        with ViewerClient(server.port) as client:
            client.look(ORIGIN, AT)
            client.wait(lambda: "onerror" in client.texts(), "the title")
            text = client.texts()
    finally:
        server.stop()
    assert "<img" not in text and "[a]" not in text and "**c**" not in text
