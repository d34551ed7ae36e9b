"""A training step as a CUDA graph: recorded once, then replayed with a single launch.

A step is some hundreds of small kernels; launched one by one they cost more time than they take.  The graph
reads its inputs from tensors that stay where they are; each call copies a batch there and replays it.
Randomness stays a function of the run's seed and the step: the generator is registered with the graph and
seeded before every replay.  A call waits for the step before its own, so that the GPU always has work while
a clock beside it is never wrong by more than a step.
"""

from collections.abc import Callable
from dataclasses import fields

import torch
from jaxtyping import Float
from torch import Generator, Tensor

from plnerf.train.batches import to_device
from plnerf.train.pixels import PixelBatch

Step = Callable[[PixelBatch, Float[Tensor, ""], Generator], dict[str, Tensor]]
WARM_UP = (
    3  # steps outside of the graph: kernels are compiled, the optimiser's state and gradients come to be
)


class GraphedStep:
    """Calls a step the first few times, then records it, then replays the record.  Every call is one step.

    The step must be like `step.Training.step`: batches of one size, the same kernels every time, nothing that
    waits for the device or copies to it, gradients and the optimiser's state kept in place, learning rates in
    tensors.  For other kernels (refined poses) make another one.
    """

    def __init__(self, step: Step, generator: Generator) -> None:
        """`generator` is the CUDA device's that the step draws from."""
        self._step, self._generator = step, generator
        self._device = generator.device
        self._stream = torch.cuda.Stream(self._device)
        self._anneal = torch.zeros((), device=self._device)
        self._batch: PixelBatch | None = None
        self._graph = torch.cuda.CUDAGraph()
        self._terms: dict[str, Tensor] = {}
        self._done = torch.cuda.Event(blocking=True)
        self._calls = 0

    def __call__(self, batch: PixelBatch, anneal: float, seed: int) -> dict[str, Tensor]:
        """One step on a batch; from page-locked memory it is copied without waiting.

        Returns the step's tensors, which the next call overwrites.
        """
        static = self._fill(batch)
        self._anneal.fill_(anneal)
        self._generator.manual_seed(seed)
        self._calls += 1
        if self._calls <= WARM_UP:
            self._run_aside(static)
        else:
            if self._calls == WARM_UP + 1:
                self._record(static)
            self._graph.replay()
        before, self._done = self._done, torch.cuda.Event(blocking=True)
        self._done.record()
        before.synchronize()  # returns at once where it was never recorded
        return self._terms

    def _fill(self, batch: PixelBatch) -> PixelBatch:
        if self._batch is None:
            moved = to_device(batch, self._device)
            self._batch = PixelBatch(*(getattr(moved, field.name).clone() for field in fields(batch)))
        else:
            for field in fields(batch):
                getattr(self._batch, field.name).copy_(getattr(batch, field.name), non_blocking=True)
        return self._batch

    def _run_aside(self, static: PixelBatch) -> None:
        """On the stream that records later, so that autograd's nodes belong to it."""
        here = torch.cuda.current_stream(self._device)
        self._stream.wait_stream(here)
        with torch.cuda.stream(self._stream):
            self._terms = self._step(static, self._anneal, self._generator)
        here.wait_stream(self._stream)

    def _record(self, static: PixelBatch) -> None:
        """Records a step without taking it."""
        self._graph.register_generator_state(self._generator)
        # Other threads, such as the one that draws batches, may go on using CUDA meanwhile.
        with torch.cuda.graph(self._graph, stream=self._stream, capture_error_mode="thread_local"):
            self._terms = self._step(static, self._anneal, self._generator)
