"""Every call of a graphed step is one step, with the batch, exponent and random draws of that call."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest
import torch
from torch import Tensor

from plnerf.train import graph
from plnerf.train.graph import WARM_UP, GraphedStep
from plnerf.train.pixels import PixelBatch


def batch_of(value: float) -> PixelBatch:
    return PixelBatch(
        torch.arange(4), torch.full((4, 2), value), torch.full((4, 3), value), torch.full((4,), value)
    )


class Trace:
    """A step that keeps what it was called with, and a weight that moves by it."""

    def __init__(self, device: str) -> None:
        self.total = torch.zeros((), device=device)
        self.calls = 0

    def __call__(self, batch: PixelBatch, anneal: Tensor, generator: torch.Generator) -> dict[str, Tensor]:
        self.calls += 1
        draw = torch.rand((), generator=generator, device=generator.device)
        part = batch.colour.mean() + 10 * anneal + 100 * draw
        self.total.add_(part)
        return {"part": part, "total": self.total.clone()}


class FakeGraph:
    """Stands for a CUDA graph on a machine without one: "replaying" calls the recorded step again."""

    def __init__(self) -> None:
        self.generator: torch.Generator | None = None
        self.replays = 0

    def register_generator_state(self, generator: torch.Generator) -> None:
        self.generator = generator

    def replay(self) -> None:
        self.replays += 1


@pytest.fixture
def fake_cuda(monkeypatch: pytest.MonkeyPatch) -> list[FakeGraph]:
    """torch.cuda with graphs that record nothing; the graphs made."""
    made: list[FakeGraph] = []

    class Stream:
        def __init__(self, device: object = None) -> None: ...
        def wait_stream(self, other: object) -> None: ...

    class Event:
        def __init__(self, blocking: bool = False) -> None: ...
        def record(self) -> None: ...
        def synchronize(self) -> None: ...

    @contextmanager
    def recording(graph: FakeGraph, **options: Any) -> Iterator[None]:
        assert graph.generator is not None  # registered before
        assert options["capture_error_mode"] == "thread_local"
        yield

    @contextmanager
    def on_stream(stream: object) -> Iterator[None]:
        yield

    def new_graph() -> FakeGraph:
        made.append(FakeGraph())
        return made[-1]

    monkeypatch.setattr(graph.torch.cuda, "Stream", Stream)
    monkeypatch.setattr(graph.torch.cuda, "Event", Event)
    monkeypatch.setattr(graph.torch.cuda, "current_stream", Stream)
    monkeypatch.setattr(graph.torch.cuda, "stream", on_stream)
    monkeypatch.setattr(graph.torch.cuda, "CUDAGraph", new_graph)
    monkeypatch.setattr(graph.torch.cuda, "graph", recording)
    return made


def test_every_call_is_one_step(fake_cuda: list[FakeGraph]) -> None:
    """Some run, one recording, the others replayed; the one recorded is replayed as well."""
    step = Trace("cpu")
    graphed = GraphedStep(step, torch.Generator())
    for call in range(10):
        graphed(batch_of(1.0), 0.5, call)
    assert step.calls == WARM_UP + 1
    assert len(fake_cuda) == 1
    assert fake_cuda[0].replays == 10 - WARM_UP


def test_inputs_are_copied_to_where_the_graph_reads_them(fake_cuda: list[FakeGraph]) -> None:
    seen: list[PixelBatch] = []

    def step(batch: PixelBatch, anneal: Tensor, generator: torch.Generator) -> dict[str, Tensor]:
        seen.append(batch)
        return {"anneal": anneal, "seed": torch.tensor(generator.initial_seed())}

    graphed = GraphedStep(step, torch.Generator())
    given = [batch_of(float(call)) for call in range(6)]
    for call, batch in enumerate(given):
        terms = graphed(batch, call / 10, 100 + call)
        assert all(one is seen[0] for one in seen)
        assert seen[0].colour.data_ptr() != batch.colour.data_ptr()  # the first batch stays the caller's
        assert torch.equal(seen[0].colour, batch.colour)
        assert torch.equal(seen[0].pixel_px, batch.pixel_px)
        assert terms["anneal"].item() == pytest.approx(call / 10)
        if call < WARM_UP:
            assert terms["seed"].item() == 100 + call
    assert torch.equal(given[0].colour, batch_of(0.0).colour)


def test_a_batch_of_another_size_is_refused(fake_cuda: list[FakeGraph]) -> None:
    graphed = GraphedStep(Trace("cpu"), torch.Generator())
    graphed(batch_of(1.0), 0.5, 0)
    other = PixelBatch(torch.arange(3), torch.rand(3, 2), torch.rand(3, 3), torch.ones(3))
    with pytest.raises(RuntimeError, match="size"):
        graphed(other, 0.5, 1)


@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
def test_replays_are_the_steps_they_replace() -> None:
    """Bit for bit, for a step without atomic additions: batch, exponent and draws of each call."""
    eager, recorded = Trace("cuda"), Trace("cuda")
    generator = torch.Generator("cuda")
    graphed = GraphedStep(recorded, torch.Generator("cuda"))
    for call in range(10):
        batch = batch_of(float(call))
        on_device = PixelBatch(
            batch.camera.cuda(), batch.pixel_px.cuda(), batch.colour.cuda(), batch.importance.cuda()
        )
        truth = eager(on_device, torch.tensor(call / 10, device="cuda"), generator.manual_seed(call))
        found = graphed(batch, call / 10, call)
        for name, value in truth.items():
            assert torch.equal(found[name], value), (call, name)
    assert recorded.calls == WARM_UP + 1
