"""The page that is handed on, as somebody without Python has it: a file opened in a browser."""

import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from tests.support.chromium import chromium
from tests.support.surveys import short
from tests.support.tiny_run import small

from plnerf.exporting import export_source
from plnerf.line.frame import LineFrame
from plnerf.pipeline import train_scene, write_survey
from plnerf.render.picture_files import write_png
from plnerf.render.write_video import write_video
from plnerf.report.handout import VIDEO
from plnerf.train.run import open_run

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as found:
        yield found


@pytest.fixture(scope="module")
def handout(browser: Any, built_tiny_scene: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of a run with a survey and a film."""
    folder = tmp_path_factory.mktemp("handed on")
    run = train_scene(built_tiny_scene, folder / "run", steps=3, **small())
    survey, frame = short(0.05), LineFrame.of_scene(open_run(run).record.frames)
    write_survey(type(survey)(frame, survey.lines, survey.cloud, "a run"), run / "survey")
    (run / VIDEO).parent.mkdir()
    frames = [folder / f"{k}.png" for k in range(6)]
    for k, path in enumerate(frames):
        write_png(path, np.full((48, 64, 3), 40 * k, np.uint8))
    write_video(run / VIDEO, frames, 6.0)
    export_source(run, ("html",), folder / "out")
    return folder / "out" / "handout.html"


@pytest.fixture(scope="module")
def bad() -> list[str]:
    """What went wrong in it, and what it asked for beyond itself."""
    return []


@pytest.fixture(scope="module")
def page(browser: Any, handout: Path, bad: list[str]) -> Any:
    page = browser.new_page(viewport={"width": 1000, "height": 800})
    page.on("console", lambda one: bad.append(f"{one.type}: {one.text}"))
    page.on("pageerror", lambda error: bad.append(str(error)))
    page.on("request", lambda one: None if own(one.url, handout) else bad.append(one.url))
    page.goto(handout.as_uri())
    return page


def own(url: str, handout: Path) -> bool:
    return url == handout.as_uri() or url.startswith("data:")


def shot(element: Any) -> np.ndarray:
    picture = Image.open(io.BytesIO(element.screenshot()))
    return np.asarray(picture.convert("RGB")).astype(float)


def test_the_film_plays(page: Any) -> None:
    film = page.locator("video")
    film.evaluate("film => film.play()")
    for _ in range(50):
        page.wait_for_timeout(100)
        if film.evaluate("film => film.currentTime") > 0.1:
            break
    assert film.evaluate("film => film.currentTime") > 0.1
    assert film.evaluate("film => film.duration") == pytest.approx(1.0, abs=0.2)


def test_the_wiper_shows_the_photo_on_the_left_and_the_render_on_the_right(page: Any) -> None:
    wipe = page.locator(".wipe").first
    wipe.scroll_into_view_if_needed()
    box, seen = wipe.bounding_box(), []
    for share in (0.02, 0.98):
        page.mouse.click(box["x"] + share * box["width"], box["y"] + box["height"] / 2)
        page.wait_for_timeout(200)
        seen.append(shot(wipe)[20:-60, 40:-40])
    assert np.abs(seen[0] - seen[1]).mean() > 3.0
    page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.wait_for_timeout(200)
    half, middle = shot(wipe)[20:-60, 40:-40], seen[0].shape[1] // 2
    sides = ((slice(None, middle - 20), seen[1], seen[0]), (slice(middle + 20, None), seen[0], seen[1]))
    for columns, shown, hidden in sides:
        # Chromium does not always round an enlarged picture alike: one pixel has been one grey level off.
        assert np.abs(half - shown)[:, columns].max() <= 1
        assert np.abs(half - hidden)[:, columns].mean() > 3.0


def test_wires_and_points_are_drawn_and_turn(page: Any) -> None:
    canvas = page.locator("canvas")
    canvas.scroll_into_view_if_needed()
    page.wait_for_timeout(300)
    before, box = shot(canvas), canvas.bounding_box()
    assert before.std() > 3.0
    page.mouse.move(box["x"] + 200, box["y"] + 200)
    page.mouse.down()
    page.mouse.move(box["x"] + 320, box["y"] + 230, steps=5)
    page.mouse.up()
    page.wait_for_timeout(300)
    assert np.abs(shot(canvas) - before).mean() > 0.5


def test_nothing_went_wrong_and_nothing_was_asked_of_a_server(page: Any, bad: list[str]) -> None:
    assert bad == []
