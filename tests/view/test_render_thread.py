"""Clients get a coarse picture at once and finer ones while they rest, whatever the others do."""

import threading
import time
from collections.abc import Callable, Iterator

import pytest

from plnerf.view import render_thread
from plnerf.view.render_thread import FEWEST_RAYS, RenderThread, Wish

MOST = 100_000


@pytest.fixture
def renders(monkeypatch: pytest.MonkeyPatch) -> Iterator[RenderThread]:
    monkeypatch.setattr(render_thread, "RATE_MEMORY", 1.0)  # these pictures take no time, whatever their size
    thread = RenderThread(rays_per_s=100_000.0)
    thread.start()
    yield thread
    thread.stop()


def waits(done: Callable[[], bool], seconds: float = 5.0) -> bool:
    end = time.monotonic() + seconds
    while not done() and time.monotonic() < end:
        time.sleep(0.002)
    return done()


def test_pictures_get_finer_until_the_finest(renders: RenderThread) -> None:
    drawn: list[int] = []

    def draw(rays: int, goes_on: Callable[[], bool]) -> bool:
        drawn.append(rays)
        return True

    renders.wish(Wish(1, draw, MOST))
    assert waits(lambda: renders.idle)
    assert drawn == sorted(set(drawn)) and drawn[-1] == MOST
    assert len(drawn) > 1 and drawn[0] <= 0.2 * MOST
    time.sleep(0.02)
    assert drawn.count(MOST) == 1  # and then it rests


def test_a_slow_machine_draws_fewer_rays_at_first() -> None:
    assert RenderThread(rays_per_s=100.0)._levels(MOST)[0] == FEWEST_RAYS
    assert RenderThread(rays_per_s=1e9)._levels(MOST) == [MOST]
    assert RenderThread(rays_per_s=50_000.0)._levels(MOST) == [6_000, 45_000, MOST]


def test_the_first_picture_follows_the_speed_that_is_measured() -> None:
    thread, sizes = RenderThread(rays_per_s=30_000.0), list[int]()

    def draw(rays: int, goes_on: Callable[[], bool]) -> bool:
        time.sleep(0.02)  # a machine that takes as long for any picture
        sizes.append(rays)
        return True

    thread.start()
    thread.wish(Wish(1, draw, MOST))
    assert waits(lambda: thread.idle)
    thread.wish(Wish(1, draw, MOST))
    assert waits(lambda: thread.idle)
    thread.stop()
    assert sizes[0] == 3600 and sizes[-1] == MOST and sizes[-2] > 2 * 3600


def test_a_move_gives_up_the_fine_picture_and_not_the_coarse_one(renders: RenderThread) -> None:
    told: list[tuple[str, int, bool]] = []
    inside, moved = threading.Event(), threading.Event()

    def first(rays: int, goes_on: Callable[[], bool]) -> bool:
        if rays == MOST:
            inside.set()
            moved.wait(5)
        told.append(("first", rays, goes_on()))
        return told[-1][2]

    def second(rays: int, goes_on: Callable[[], bool]) -> bool:
        told.append(("second", rays, goes_on()))
        return True

    renders.wish(Wish(1, first, MOST))
    assert inside.wait(5)
    renders.wish(Wish(1, second, MOST))
    moved.set()
    assert waits(lambda: renders.idle)
    given_up = [one for one in told if not one[2]]
    assert given_up == [("first", MOST, False)]
    assert told[-1] == ("second", MOST, True)
    after = told[told.index(given_up[0]) + 1]
    assert after[0] == "second" and after[1] < MOST  # coarse again, at once

    # While the camera keeps moving, each coarse picture is finished.
    def coarse(rays: int, goes_on: Callable[[], bool]) -> bool:
        renders.wish(Wish(1, second, MOST))
        told.append(("coarse", rays, goes_on()))
        return True

    renders.wish(Wish(1, coarse, MOST))
    assert waits(lambda: renders.idle)
    assert [one[2] for one in told if one[0] == "coarse"] == [True]


def test_another_client_does_not_wait_for_a_fine_picture(renders: RenderThread) -> None:
    order: list[int] = []
    inside, asked = threading.Event(), threading.Event()

    def slow(rays: int, goes_on: Callable[[], bool]) -> bool:
        if rays == MOST and not asked.is_set():
            inside.set()
            asked.wait(5)
            if not goes_on():
                return False
        order.append(1)
        return True

    def quick(rays: int, goes_on: Callable[[], bool]) -> bool:
        order.append(2)
        return True

    renders.wish(Wish(1, slow, MOST))
    assert inside.wait(5)
    begun = len(order)
    renders.wish(Wish(2, quick, MOST))
    asked.set()
    assert waits(lambda: renders.idle)
    assert order[begun] == 2 and order.count(1) == begun + 1  # and the first still gets its finest


def test_a_client_that_vanishes_in_mid_render_leaves_the_others_theirs(renders: RenderThread) -> None:
    inside, gone = threading.Event(), threading.Event()
    told: list[object] = []

    def vanishing(rays: int, goes_on: Callable[[], bool]) -> bool:
        inside.set()
        gone.wait(5)
        raise ConnectionError("the client is gone")

    def staying(rays: int, goes_on: Callable[[], bool]) -> bool:
        told.append(rays)
        return True

    errors: list[Exception] = []
    renders.wish(Wish(1, vanishing, MOST, errors.append))
    assert inside.wait(5)
    renders.wish(Wish(2, staying, MOST))
    renders.forget(1)
    gone.set()
    assert waits(lambda: renders.idle) and told[-1] == MOST
    assert [str(one) for one in errors] == ["the client is gone"]


def test_a_client_that_cannot_be_told_leaves_the_others_theirs(
    renders: RenderThread, capsys: pytest.CaptureFixture[str]
) -> None:
    told: list[object] = []

    def fails(rays: int, goes_on: Callable[[], bool]) -> bool:
        raise ZeroDivisionError("of the picture")

    def nobody(error: Exception) -> None:
        raise ConnectionError("of the note")

    def staying(rays: int, goes_on: Callable[[], bool]) -> bool:
        told.append(rays)
        return True

    renders.wish(Wish(1, fails, MOST, nobody))
    assert waits(lambda: renders.idle)
    renders.wish(Wish(2, staying, MOST))
    assert waits(lambda: renders.idle) and told[-1] == MOST
    printed = capsys.readouterr().err
    assert "ZeroDivisionError: of the picture" in printed and "ConnectionError: of the note" in printed


def test_calls_come_back_with_what_they_return_or_raise(renders: RenderThread) -> None:
    assert renders.call(threading.current_thread).result(5).name == "plnerf-view-render"
    with pytest.raises(ZeroDivisionError):
        renders.call(lambda: 1 // 0).result(5)
    assert renders.call(lambda: 7).result(5) == 7
    renders.stop()
    assert renders.call(lambda: 7).cancelled()


def test_what_can_wait_runs_when_no_window_waits(renders: RenderThread) -> None:
    order: list[str] = []
    inside, asked = threading.Event(), threading.Event()

    def long() -> str:
        inside.set()
        asked.wait(5)
        order.append("first")
        return "strip"

    def draw(rays: int, goes_on: Callable[[], bool]) -> bool:
        order.append(f"window {rays}")
        return True

    first = renders.later(long)
    second = renders.later(lambda: order.append("second"))
    inside.wait(5)
    renders.wish(Wish(1, draw, MOST))
    asked.set()
    second.result(timeout=5)
    assert first.result() == "strip"
    assert order[0] == "first" and order[-1] == "second" and f"window {MOST}" in order


def test_what_can_wait_is_given_up_at_the_end() -> None:
    thread = RenderThread()
    waiting = thread.later(lambda: None)
    thread.start()
    assert waiting.result(timeout=5) is None
    thread.stop()
    assert thread.later(lambda: None).cancelled()
