"""One thread renders for all clients: first coarse, then finer as long as their cameras rest.

Every client has at most one wish, its newest.  The coarse picture of a wish is always finished, so that a
moving camera sees something; finer ones are given up as soon as the client wishes for another or is gone.
Clients whose picture is coarsest come first, then those who have waited longest.  What nobody waits for at a
window, a film's frames, is rendered when no client wishes for a picture.
"""

import itertools
import threading
import time
import traceback
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass, field
from typing import Any

FIRST_S, SECOND_S = 0.12, 0.9
"""Seconds that the first and the second picture of a wish may take."""
FEWEST_RAYS = 1500
RATE_MEMORY = 0.6
"""Share of the measured rate that the next measurement leaves."""


@dataclass(eq=False)
class Wish:
    """What one client wants to see."""

    client: int
    draw: Callable[[int, Callable[[], bool]], bool]
    """Draws a picture of so many rays and shows it, asking between its parts whether to go on; whether it was
    finished."""
    most_rays: int
    """Of its last and finest picture."""
    failed: Callable[[Exception], None] = lambda error: None
    """Called with what drawing raised; the wish is then dropped."""
    drawn_rays: int = 0
    since: float = field(default_factory=time.monotonic)

    @property
    def done(self) -> bool:
        """Whether its finest picture is drawn."""
        return self.drawn_rays >= self.most_rays


class RenderThread:
    """The thread; begins with `start` and ends with `stop`."""

    def __init__(self, rays_per_s: float = 30_000.0) -> None:
        self._rays_per_s = rays_per_s
        self._wishes: dict[int, Wish] = {}
        self._calls: list[tuple[Callable[[], Any], Future[Any]]] = []
        self._later: list[tuple[Callable[[], Any], Future[Any]]] = []
        self._changed = threading.Condition()
        self._ends = False
        self._thread = threading.Thread(target=self._run, name="plnerf-view-render", daemon=True)

    def start(self) -> None:
        """Begins to render."""
        self._thread.start()

    def stop(self) -> None:
        """Ends it after the strip that is being rendered."""
        with self._changed:
            self._ends = True
            self._wishes.clear()
            for _, future in [*self._calls, *self._later]:
                future.cancel()
            self._calls.clear()
            self._later.clear()
            self._changed.notify_all()
        self._thread.join(timeout=10.0)

    def wish(self, wish: Wish) -> None:
        """Takes the place of the client's earlier wish."""
        with self._changed:
            if not self._ends:
                self._wishes[wish.client] = wish
                self._changed.notify_all()

    def forget(self, client: int) -> None:
        """Of a client that is gone, or wants no pictures any more."""
        with self._changed:
            self._wishes.pop(client, None)

    def call(self, function: Callable[[], Any]) -> "Future[Any]":
        """Runs a function in this thread, before other pictures; the future has what it returns or raises."""
        return self._queued(self._calls, function)

    def later(self, function: Callable[[], Any]) -> "Future[Any]":
        """As `call`, but as soon as no client waits for a picture."""
        return self._queued(self._later, function)

    def _queued(self, queue: list[Any], function: Callable[[], Any]) -> "Future[Any]":
        future: Future[Any] = Future()
        with self._changed:
            if self._ends:
                future.cancel()
            else:
                queue.append((function, future))
                self._changed.notify_all()
        return future

    def rests(self, client: int) -> bool:
        """Whether a client waits for no picture."""
        with self._changed:
            return client not in self._wishes or self._wishes[client].done

    @property
    def idle(self) -> bool:
        """Whether all wishes are drawn to their finest."""
        with self._changed:
            return not self._calls and all(wish.done for wish in self._wishes.values())

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(self._has_work)
                if self._ends:
                    return
                call, wish = self._calls.pop(0) if self._calls else None, self._next()
                if call is None and wish is None:
                    call = self._later.pop(0)
            if call is not None:
                _finish(*call)
            elif wish is not None:
                self._draw(wish)

    def _has_work(self) -> bool:
        """Whether there is something to do, be it to end; the lock is held."""
        return bool(self._ends or self._calls or self._later or self._next() is not None)

    def _next(self) -> Wish | None:
        """The wish whose turn it is; the lock is held."""
        waiting = [wish for wish in self._wishes.values() if not wish.done]
        return min(waiting, key=lambda wish: (wish.drawn_rays, wish.since), default=None)

    def _draw(self, wish: Wish) -> None:
        """Its next picture."""
        first = wish.drawn_rays == 0
        rays = next(rays for rays in self._levels(wish.most_rays) if rays > wish.drawn_rays)

        def goes_on() -> bool:
            with self._changed:
                asked = any(one.drawn_rays == 0 for one in self._wishes.values())
                return not self._ends and (first or (self._wishes.get(wish.client) is wish and not asked))

        began = time.perf_counter()
        try:
            finished = wish.draw(rays, goes_on)
        except Exception as error:  # whatever it is, the other clients' pictures go on
            with self._changed:
                if self._wishes.get(wish.client) is wish:
                    del self._wishes[wish.client]
            _tell(wish, error)
            return
        seconds = max(time.perf_counter() - began, 1e-6)
        if finished:
            self._rays_per_s += (1 - RATE_MEMORY) * (rays / seconds - self._rays_per_s)
            wish.drawn_rays, wish.since = rays, time.monotonic()

    def _levels(self, most: int) -> list[int]:
        """Rays of the pictures of a wish, from the coarsest to the finest."""
        coarse = [max(FEWEST_RAYS, int(self._rays_per_s * seconds)) for seconds in (FIRST_S, SECOND_S)]
        return [*itertools.takewhile(lambda rays: rays < 0.7 * most, coarse), most]


def _tell(wish: Wish, error: Exception) -> None:
    """Tells a client what drawing raised; where not even that can be done, the terminal has both errors."""
    try:
        wish.failed(error)
    except Exception:  # an error of this thread would leave all clients without pictures, and without a word
        traceback.print_exc()


def _finish(function: Callable[[], Any], future: "Future[Any]") -> None:
    if future.set_running_or_notify_cancel():
        try:
            future.set_result(function())
        except Exception as error:
            future.set_exception(error)
