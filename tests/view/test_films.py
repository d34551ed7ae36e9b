"""Films: as many frames as asked for, one at a time, of what the way shows, and given up when asked."""

import threading
from collections.abc import Iterator
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest

pytest.importorskip("viser", reason="plnerf[view] is not installed")

from tests.support.oracle import oracle_run

from plnerf.line.frame import LineFrame
from plnerf.scene.scene import Scene, load_scene
from plnerf.view import films
from plnerf.view.display_frame import DisplayFrame
from plnerf.view.eye import Eye, looking
from plnerf.view.field_pictures import FieldPictures, Layer
from plnerf.view.films import FilmPlan, FilmRoom
from plnerf.view.flights import Flight
from plnerf.view.render_thread import RenderThread

FRAMES = 5


@pytest.fixture
def scene(tiny_scene: Path, tmp_path: Path) -> Scene:
    return load_scene(tiny_scene, store=tmp_path / "store")


@pytest.fixture
def room(scene: Scene, tmp_path: Path) -> Iterator[FilmRoom]:
    run = oracle_run(scene, tmp_path / "run")
    frame = DisplayFrame(LineFrame.of_scene(scene.frames), np.zeros(3))
    renders = RenderThread()
    renders.start()
    yield FilmRoom(FieldPictures(run, frame), renders)
    renders.stop()


def plan(layer: Layer = "rgb", frames: int = FRAMES) -> FilmPlan:
    """From above the floor, nearer and nearer to the ball."""

    def at(share: float, aspect: float) -> Eye:
        return looking(np.array([0.0, -4.0 + 2.0 * share, 1.5]), np.array([0.0, 0.0, 0.5]), 0.9, aspect)

    return FilmPlan(Flight("way", 2.0, at), layer, frames, 96, 1.5)


class End:
    """What a film ended with."""

    def __init__(self) -> None:
        self.film: bytes | None = None
        self.error: Exception | None = None
        self.came = threading.Event()

    def __call__(self, film: bytes | None, error: Exception | None) -> None:
        assert not self.came.is_set()
        self.film, self.error = film, error
        self.came.set()


def test_a_film_has_its_frames_and_shows_the_way(room: FilmRoom) -> None:
    end, done = End(), list[int]()
    assert room.begin(plan(), lambda: True, done.append, end)
    assert end.came.wait(30) and end.error is None and end.film is not None
    assert done == [1, 2, 3, 4, 5] and room.progress is None
    frames = iio.imread(end.film, extension=".mp4").astype(float)
    assert frames.shape == (FRAMES, 64, 96, 3)
    red = (frames[..., 0] > frames[..., 1] + 60).sum((1, 2))  # the ball
    assert (np.diff(red) > 0).all()


def test_one_film_is_made_at_a_time(room: FilmRoom) -> None:
    inside, goes = threading.Event(), threading.Event()

    def waits() -> bool:
        inside.set()
        return goes.wait(5)

    first, second = End(), End()
    assert room.begin(plan(), waits, lambda done: None, first)
    assert inside.wait(5)
    assert room.progress == (0, FRAMES)
    assert not room.begin(plan(), lambda: True, lambda done: None, second)
    goes.set()
    assert first.came.wait(30) and first.film is not None and not second.came.is_set()
    assert room.begin(plan(frames=2), lambda: True, lambda done: None, second)
    assert second.came.wait(30) and second.film is not None


def test_a_film_is_given_up(room: FilmRoom) -> None:
    end, done = End(), list[int]()
    assert room.begin(plan(), lambda: len(done) < 2, done.append, end)
    assert end.came.wait(30)
    assert end.film is None and end.error is None and done == [1, 2] and room.progress is None


def test_what_goes_wrong_is_reported_and_the_next_film_can_be_made(
    room: FilmRoom, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> None:
        raise OSError("no space left on device")

    end = End()
    with monkeypatch.context() as patch:
        patch.setattr(films, "write_png", broken)
        assert room.begin(plan(), lambda: True, lambda done: None, end)
        assert end.came.wait(30)
    assert isinstance(end.error, OSError) and room.progress is None


def test_all_frames_of_lengths_share_one_range(room: FilmRoom, monkeypatch: pytest.MonkeyPatch) -> None:
    ranges = []
    legend = films.with_legend

    def noted(picture, shown, colours):  # type: ignore[no-untyped-def]
        ranges.append(shown)
        return legend(picture, shown, colours)

    monkeypatch.setattr(films, "with_legend", noted)
    end = End()
    assert room.begin(plan("depth"), lambda: True, lambda done: None, end)
    assert end.came.wait(30) and end.film is not None
    assert len(ranges) == FRAMES and len({(one.near, one.far) for one in ranges}) == 1
    whole = plan("depth")
    own = [room._field.render(whole.eye(k), "depth", whole.rays) for k in range(FRAMES)]
    nearest = [one.shown.near for one in own if one is not None and one.shown is not None]
    assert ranges[0].near == pytest.approx(min(nearest), rel=0.05) and max(nearest) > 1.2 * min(nearest)
