"""The viewer as a person has it: a browser with the page, in which things are clicked, dragged and saved."""

import io
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import imageio.v3 as iio
import numpy as np
import pytest

pytest.importorskip("viser", reason="plnerf[view] is not installed")

from PIL import Image
from tests.support.chromium import Page, chromium
from tests.support.surveys import short
from tests.support.tiny_run import small

from plnerf.pipeline import train_scene, write_survey
from plnerf.train.report import SilentReport
from plnerf.view import film_panel
from plnerf.view.browser import Browser
from plnerf.view.opened import open_source
from plnerf.view.server import ViewServer

pytestmark = [
    pytest.mark.slow,
    pytest.mark.filterwarnings("ignore:Queued a .* on a closed connection"),
]
"""Of viser, where a browser is gone while something is on its way to it."""
FIRST_PICTURE_MS = 120_000
"""Its kernels are compiled first where none are kept on disk yet."""


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as found:
        yield found


@pytest.fixture(scope="module")
def server(
    browser: Any, built_tiny_scene: Path, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[ViewServer]:
    """A run and a survey beside it."""
    run = tmp_path_factory.mktemp("trained") / "run"
    train_scene(built_tiny_scene, run, steps=3, device="cpu", report=SilentReport(), **small())
    write_survey(short(0.05), run / "survey")
    found = ViewServer(open_source(run), port=0)
    yield found
    found.stop()


@pytest.fixture(scope="module")
def page(browser: Any, server: ViewServer) -> Page:
    return Page(browser, server.address)


def newest(server: ViewServer) -> Browser:
    """What the server knows of the window that was opened last."""
    return server._browsers[max(server._browsers)]


def picture(page: Page) -> np.ndarray:
    """What its window shows, without the panel and the notes."""
    data = page.page.screenshot(clip={"x": 0, "y": 200, "width": 560, "height": 320})
    return np.asarray(Image.open(io.BytesIO(data)).convert("RGB")).astype(float)


def drawn(page: Page, done: Callable[[], bool]) -> None:
    """Waits, at most 15 s, until the window shows something: WebGL in software is slow on a busy machine."""
    for _ in range(50):
        if done():
            return
        page.page.wait_for_timeout(300)
    raise AssertionError("the window does not show it")


def test_it_loads_and_shows_the_field(page: Page) -> None:
    page.text("px, ").wait_for(timeout=FIRST_PICTURE_MS)
    assert page.text("5 wires").is_visible() and page.text("12 cameras").is_visible()
    drawn(page, lambda: picture(page).std() > 3.0)  # no empty window


def test_layers_are_switched(page: Page) -> None:
    before = picture(page)
    page.choose("layer", "depth")
    page.text("grey: no surface").wait_for()
    drawn(page, lambda: np.abs(picture(page) - before).mean() > 3.0)
    page.choose("layer", "rgb")
    page.text("grey: no surface").wait_for(state="hidden")


def test_the_slider_moves_along_the_line(page: Page, server: ViewServer) -> None:
    page.choose("way", "beside the line")
    places = []
    for share in (20, 70):
        page.number("along, %", share)
        page.page.wait_for_timeout(300)
        places.append(newest(server).eye.centre)
    along = short(0.05).wires[0].base.u
    assert 0.45 * 40 < (places[1] - places[0])[:2] @ along < 0.55 * 42


def test_a_click_on_a_wire_shows_its_figures(page: Page, server: ViewServer) -> None:
    eye, wire = newest(server).eye, short(0.05).wires[2]
    seen = (wire.points(np.linspace(5.0, 35.0, 61)) - eye.centre) @ eye.R_line_camera
    canvas = page.page.locator("canvas").first.bounding_box()
    focal = canvas["height"] / 2 / np.tan(eye.fov_rad / 2)
    pixels = seen[:, :2] / seen[:, 2:] * focal + [canvas["width"] / 2, canvas["height"] / 2]
    x, y = next(
        one for one, z in zip(pixels, seen[:, 2], strict=True)
        if z > 1 and 60 < one[0] < 500 and 200 < one[1] < canvas["height"] - 40
    )  # fmt: skip
    page.page.mouse.click(canvas["x"] + x, canvas["y"] + y)
    page.text("Wire 3").wait_for()
    assert page.text("phase conductor").is_visible()


def test_a_still_is_downloaded(page: Page) -> None:
    page.unfold("Save")
    page.choose("width", "320 px")
    with page.page.expect_download() as download:
        page.press("Still of the field")
    assert download.value.suggested_filename.startswith("plnerf-field-rgb-")
    with Image.open(download.value.path()) as still:
        assert still.format == "PNG" and still.width == pytest.approx(320, abs=2)
    with page.page.expect_download() as download:
        page.press("Still of the window")
    with Image.open(download.value.path()) as still:
        assert still.width > 400 and np.asarray(still.convert("L")).std() > 3.0


def test_uncertainty_has_a_bar_with_its_unit(page: Page) -> None:
    page.choose("layer", "uncertainty")
    page.text("Standard deviation of where rays end").wait_for()
    bar = page.page.locator(".mantine-Paper-root img:visible").first
    bar.wait_for()
    assert bar.bounding_box()["width"] > 150
    page.choose("layer", "rgb")
    page.text("Standard deviation of where rays end").wait_for(state="hidden")
    drawn(page, lambda: page.page.locator(".mantine-Paper-root img:visible").count() == 0)


def test_a_film_is_downloaded_and_one_is_made_at_a_time(
    browser: Any, page: Page, server: ViewServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(film_panel, "FPS", 2)  # four frames
    page.choose("film's length", "2 s")
    with page.page.expect_download() as download:
        page.press("Film along the way")
        page.text("The processors limit it").wait_for()
    assert download.value.suggested_filename.startswith("plnerf-film-rgb-")
    frames = iio.imread(download.value.path(), extension=".mp4")
    assert len(frames) == 4 and frames.shape[2] == pytest.approx(320, abs=2)
    assert np.abs(frames[0].astype(float) - frames[-1]).mean() > 1  # it moves
    page.text("The processors limit it").wait_for(state="hidden")  # what is read next is of the next film
    monkeypatch.setattr(film_panel, "FPS", 1000)
    page.press("Film along the way")
    page.text("The processors limit it").wait_for()
    films = server._shared.films
    assert films is not None
    drawn(page, lambda: films.progress is not None)
    other = Page(browser, server.address)
    other.unfold("Save")
    other.press("Film along the way")
    other.text("One film is made at a time").wait_for()
    before = newest(server).eye.centre
    other.number("along, %", 12)  # meanwhile a window moves and gets its pictures
    drawn(other, lambda: not np.array_equal(newest(server).eye.centre, before))
    other.text("s after the move").wait_for()
    page.press("Give the film up")
    page.text("It was given up.").wait_for()
    assert other.bad == []
    other.page.close()
    drawn(page, lambda: len(server._browsers) == 1)


def test_two_windows_do_not_move_each_other_and_one_that_vanishes_is_forgotten(
    browser: Any, page: Page, server: ViewServer
) -> None:
    first = newest(server)
    place = first.eye.centre
    other = Page(browser, server.address)
    other.text("px, ").wait_for()
    assert len(server._browsers) == 2
    other.number("along, %", 90)
    other.choose("layer", "accumulation")  # and is gone in the middle of its picture
    other.page.close(run_before_unload=False)
    page.page.wait_for_timeout(500)
    assert list(server._browsers.values()) == [first]
    assert np.array_equal(first.eye.centre, place)
    page.number("along, %", 40)
    page.page.wait_for_timeout(500)
    assert not np.array_equal(first.eye.centre, place)
    assert other.bad == []


def test_nothing_went_wrong_and_nothing_was_asked_of_others(page: Page, server: ViewServer) -> None:
    assert page.bad == [], json.dumps(page.bad, indent=1)
    others = {one for one in page.asked if not one.startswith(("blob:", "data:"))}
    assert others == {server.address, server.address.replace("http", "ws")}
