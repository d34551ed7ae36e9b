"""A kernel's work is shared by threads: all of it is done, once, and what goes wrong is told."""

import os
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from plnerf.ops.threads import share


def add_one(out: np.ndarray, start: int, stop: int) -> None:
    out[start:stop] += 1


@pytest.mark.parametrize(("of", "threads"), [(0, 3), (1, 3), (2, 3), (7, 1), (7, 3), (1000, 8)])
def test_everything_is_computed_once(of: int, threads: int) -> None:
    out = np.zeros(of, np.int64)
    share(add_one, out, of=of, threads=threads)
    assert (out == 1).all()


def test_stretches_are_computed_at_the_same_time() -> None:
    """Each waits for the others: one after the other they would wait for ever."""
    together = threading.Barrier(3, timeout=60)
    found: list[tuple[int, int]] = []

    def wait(start: int, stop: int) -> None:
        together.wait()
        found.append((start, stop))

    share(wait, of=8, threads=3)
    assert sorted(found) == [(0, 2), (2, 5), (5, 8)]


@pytest.mark.parametrize("place", [0, 1, 2])
def test_an_error_in_any_stretch_is_raised_after_all_have_ended(place: int) -> None:
    out = np.zeros(3, np.int64)

    def fail(start: int, stop: int) -> None:
        add_one(out, start, stop)
        if start == place:
            raise ValueError(f"stretch {place}")

    for _ in range(3):  # the threads go on
        with pytest.raises(ValueError, match=f"stretch {place}"):
            share(fail, of=3, threads=3)
    assert (out == 3).all()


def test_several_threads_may_call_at_once() -> None:
    """As one that renders does beside one that trains."""

    def total(seed: int) -> int:
        out = np.zeros(64 + seed, np.int64)
        for _ in range(50):
            share(add_one, out, of=len(out), threads=3)
        return int(out.sum())

    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(total, range(8))) == [50 * (64 + seed) for seed in range(8)]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not fork processes")
@pytest.mark.filterwarnings("ignore:This process:DeprecationWarning")
def test_a_forked_process_shares_work_too() -> None:
    out = np.zeros(8, np.int64)
    share(add_one, out, of=8, threads=2)  # so that there are threads, which the other process lacks
    child = os.fork()
    if child == 0:
        share(add_one, out, of=8, threads=2)
        os._exit(0 if (out == 2).all() else 1)
    assert os.waitpid(child, 0)[1] == 0
