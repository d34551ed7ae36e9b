"""Batches drawn ahead are those drawn in the loop; mistakes come to light; nothing is left running."""

import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from tests.support.tiny_run import Recorder, assert_same_bits, newest_tensors, open_tiny, tiny_config
from torch import Tensor

from plnerf.scene import images
from plnerf.train import loop
from plnerf.train.batches import Ahead, pinned, to_device
from plnerf.train.loop import step_generator, train
from plnerf.train.pixels import PixelBatch, PixelSampler, detail_pools

CPU = torch.device("cpu")


def fields_of(batch: PixelBatch) -> list[Tensor]:
    return [batch.camera, batch.pixel_px, batch.colour, batch.importance]


@pytest.mark.parametrize(("first", "ahead"), [(0, 2), (7, 2), (7, 0)])
def test_batches_are_those_drawn_in_the_loop(
    first: int, ahead: int, tiny_scene: Path, tmp_path: Path
) -> None:
    """Whichever step a run goes on from."""
    scene = open_tiny(tiny_scene, tmp_path)
    sampler = PixelSampler(scene.images, scene.train, detail_pools(scene.images, scene.train, 0.5, 0.1))

    def draw(step: int) -> PixelBatch:
        return sampler.draw(64, step_generator(3, step, CPU))

    with Ahead(draw, first, ahead) as batches:
        found = [next(batches) for _ in range(5)]
    for step, batch in enumerate(found, first):
        for a, b in zip(fields_of(batch), fields_of(draw(step)), strict=True):
            assert torch.equal(a, b)
    assert not torch.equal(found[0].colour, found[1].colour)


@pytest.mark.parametrize("ahead", [1, 2])
def test_it_is_never_further_ahead_than_allowed(ahead: int) -> None:
    begun: list[int] = []
    with Ahead(lambda step: begun.append(step) or step, 0, ahead) as values:
        for asked in range(4):
            wait_until(lambda n=asked + ahead: len(begun) >= n)  # it does get ahead
            time.sleep(0.02)  # and would go on, if it did
            assert begun == list(range(asked + ahead))
            assert next(values) == asked


def test_pixels_that_are_read_from_the_disk_are_drawn_ahead_and_train_alike(
    tiny_scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ahead of the step they are drawn only where the file is larger than what may be mapped."""
    drawn_ahead: list[int] = []

    def ahead(draw: Callable[[int], Any], first: int, count: int) -> Ahead[Any]:
        drawn_ahead.append(count)
        return Ahead(draw, first, count)

    monkeypatch.setattr(loop, "Ahead", ahead)
    mapped, read = tmp_path / "mapped", tmp_path / "read"
    train(tiny_config(tiny_scene), mapped, Recorder())
    monkeypatch.setattr(images, "RESIDENT_BYTES", 1000)
    train(tiny_config(tiny_scene), read, Recorder())
    assert drawn_ahead == [0, 2]
    assert_same_bits(newest_tensors(read), newest_tensors(mapped))


def test_nothing_ahead_means_no_thread() -> None:
    with Ahead(lambda step: threading.current_thread(), 0, 0) as values:
        assert [next(values), next(values)] == [threading.main_thread()] * 2


def test_it_works_while_the_loop_does() -> None:
    """The second value is made while the loop is busy with the first."""
    made = threading.Event()
    with Ahead(lambda step: made.set() if step == 1 else None, 0) as values:
        next(values)
        assert made.wait(10)


def test_what_is_raised_is_raised_for_its_step() -> None:
    def draw(step: int) -> int:
        if step == 2:
            raise OSError("the disk has gone")
        return step

    with Ahead(draw, 0) as values:
        assert [next(values), next(values)] == [0, 1]
        with pytest.raises(OSError, match="the disk has gone"):
            next(values)
    assert_no_thread_is_left()


def test_closing_waits_for_what_has_begun_and_drops_the_rest() -> None:
    begun: list[int] = []
    go_on = threading.Event()

    def draw(step: int) -> None:
        begun.append(step)
        go_on.wait(10)

    values = Ahead(draw, 0)
    wait_until(lambda: begun == [0])
    threading.Timer(0.05, go_on.set).start()
    values.close()
    assert go_on.is_set()
    assert begun == [0]
    assert_no_thread_is_left()


def test_a_batch_on_the_same_device_is_the_same_batch() -> None:
    batch = PixelBatch(torch.arange(3), torch.rand(3, 2), torch.rand(3, 3), torch.ones(3))
    for a, b in zip(fields_of(to_device(batch, CPU)), fields_of(batch), strict=True):
        assert a is b


@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
def test_a_pinned_batch_arrives() -> None:
    batch = PixelBatch(torch.arange(3), torch.rand(3, 2), torch.rand(3, 3), torch.ones(3))
    locked = pinned(batch)
    assert all(value.is_pinned() for value in fields_of(locked))
    for a, b in zip(fields_of(to_device(locked, torch.device("cuda"))), fields_of(batch), strict=True):
        assert a.is_cuda
        assert torch.equal(a.cpu(), b)


def wait_until(true: object) -> None:
    """Up to ten seconds."""
    assert callable(true)
    end = time.monotonic() + 10
    while not true():
        assert time.monotonic() < end
        time.sleep(0.001)


def assert_no_thread_is_left() -> None:
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("plnerf-batches")]
