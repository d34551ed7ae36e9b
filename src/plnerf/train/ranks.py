"""Several processes that train one model, each on its share of every batch.

    torchrun --nproc-per-node 2 -m plnerf train SCENE -o RUN

A *rank* is the number of a process.  Rank r of n renders the rays r, r + n, r + 2n, ... of the batch that one
process would have drawn, with the random numbers that these rays would have had; the gradients are averaged,
and every rank takes the same step.  So n processes train as one does at the same batch, up to the order in
which floats are summed.  Rank 0 alone writes files.
"""

import hashlib
import os
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, replace
from datetime import timedelta
from pathlib import Path
from textwrap import shorten
from typing import Any

import torch
import torch.distributed as dist
from torch import Generator, Tensor, nn

from plnerf.errors import ConfigError, TrainingError
from plnerf.ops.cpu_arrays import usable_cores
from plnerf.rays.jitter import SharedGenerator
from plnerf.scene.only_writer import only_writer
from plnerf.train.config import TrainConfig

ANSWER_S = 300.0
"""Seconds that a rank may be late in a step: rank 0 validates and saves meanwhile.  Then all of them end."""
PREPARE = timedelta(days=7)
"""How long other ranks wait while rank 0 reads photos and detects wires; torchrun ends them if it ends."""
ALIGNED = 16
"""Numbers to whose multiples gradients are moved in their row: a line of the cache."""
TERMS = 16
"""Loss terms at most, and so many numbers at the end of that row."""


@dataclass(frozen=True)
class Ranks:
    """This process among those that train a model together; alone by default."""

    rank: int = 0
    of: int = 1
    patient: Any = None
    """The process group that waits long, for what rank 0 prepares."""

    @property
    def first(self) -> bool:
        """Whether this process writes the files."""
        return self.rank == 0

    @property
    def rays(self) -> slice:
        """Which rays of a batch this process renders."""
        return slice(self.rank, None, self.of)

    def generator(self, device: torch.device) -> Generator:
        """A generator whose numbers for rays are those of this process's rays."""
        return Generator(device) if self.of == 1 else SharedGenerator(device, self.rank, self.of)

    def share_of(self, config: TrainConfig) -> TrainConfig:
        """The settings of this process's share of a step.

        Raises ConfigError where its rays cannot be shared evenly.
        """
        for name, rays in (("rays", config.rays), ("normal_rays", config.normal_rays)):
            if rays % self.of:
                raise ConfigError(
                    f"{self.of} processes share the rays of a step evenly: train.{name} must be a multiple "
                    f"of {self.of}, but is {rays}. Give another number, or start another number of processes."
                )
        return replace(config, rays=config.rays // self.of, normal_rays=config.normal_rays // self.of)

    @contextmanager
    def first_alone(self) -> Iterator[None]:
        """Rank 0 runs the block before the others do, who find the files that it wrote."""
        if self.of == 1:
            yield
            return
        if not self.first:
            with _answered():
                dist.barrier(self.patient)
        yield
        if self.first:
            with _answered():
                dist.barrier(self.patient)

    @contextmanager
    def only_writer(self, folder: Path) -> Iterator[None]:
        """Rank 0 holds the folder while the block runs."""
        with only_writer(folder) if self.first else nullcontext():
            yield

    def same(self, value: float) -> float:
        """The value of rank 0, on all ranks."""
        if self.of == 1:
            return value
        shared = torch.tensor(value, dtype=torch.float64)
        with _answered():
            dist.broadcast(shared, 0)
        return shared.item()

    def require_same(self, model: nn.Module, step: int) -> None:
        """Raises TrainingError where the ranks' weights are no longer the same bits."""
        if self.of == 1:
            return
        digest = hashlib.blake2b(str(step).encode(), digest_size=16)
        for value in model.state_dict().values():
            digest.update(value.detach().cpu().numpy().tobytes())
        own = torch.tensor(list(digest.digest()))
        each = [torch.empty_like(own) for _ in range(self.of)]
        with _answered():
            dist.all_gather(each, own)
        if others := [rank for rank, one in enumerate(each) if not torch.equal(one, each[0])]:
            raise TrainingError(
                f"After step {step} the ranks {others} have other weights than rank 0. Start all processes "
                "with the same arguments, the same version of plnerf and the same files, on processors of "
                "the same kind, then go on from the last checkpoint with --resume."
            )


ALONE = Ranks()


class SharedGradients:
    """The gradients of all parameters in one row, which one sum over the ranks averages."""

    def __init__(self, parameters: Iterable[Tensor], ranks: Ranks) -> None:
        """The parameters' gradients, which are there, become parts of the row."""
        values = list(parameters)
        firsts = [0]
        for value in values:
            firsts.append(firsts[-1] + -(-value.numel() // ALIGNED) * ALIGNED)
        self._of = ranks.of
        self.row = values[0].new_zeros(firsts[-1] + TERMS).requires_grad_(False)
        self._terms = self.row[-TERMS:]
        for value, first in zip(values, firsts[:-1], strict=True):
            value.grad = self.row[first : first + value.numel()].view_as(value)

    def backward(self, terms: Mapping[str, Tensor]) -> dict[str, Tensor]:
        """Adds the gradients of the terms' sum, averages both over the ranks, and returns the means."""
        (torch.stack(list(terms.values())).sum() / self._of).backward()
        values = torch.stack([term.detach() for term in terms.values()]) / self._of
        self._terms[: len(values)] = values
        with _answered():
            dist.all_reduce(self.row)
        return dict(zip(terms, self._terms[: len(values)].clone(), strict=True))


@contextmanager
def join_ranks(device: str) -> Iterator[Ranks]:
    """The processes that torchrun started, or `ALONE`.  They share the cores of their machine evenly."""
    if not started_by_torchrun():
        yield ALONE
        return
    import numba  # takes time, and few processes come here

    threads = max(1, usable_cores() // processes_here())
    torch.set_num_threads(threads)
    numba.set_num_threads(min(threads, numba.get_num_threads()))
    if device == "cuda":
        torch.cuda.set_device(int(os.environ["LOCAL_RANK"]))
    with _answered():
        dist.init_process_group(
            "cpu:gloo,cuda:nccl" if device == "cuda" else "gloo", timeout=timedelta(seconds=ANSWER_S)
        )
        patient = dist.new_group(backend="gloo", timeout=PREPARE)
    yield Ranks(dist.get_rank(), dist.get_world_size(), patient)
    dist.destroy_process_group()  # after an error it could wait for those that have ended


def started_by_torchrun() -> bool:
    """Whether this process is one of several."""
    return "TORCHELASTIC_RUN_ID" in os.environ and int(os.environ.get("WORLD_SIZE", "1")) > 1


def processes_here() -> int:
    """How many of the processes run on this machine."""
    return int(os.environ["LOCAL_WORLD_SIZE"]) if started_by_torchrun() else 1


@contextmanager
def _answered() -> Iterator[None]:
    """Raises TrainingError where another rank has ended or does not answer."""
    try:
        yield
    except RuntimeError as error:
        # gloo writes where in its sources, what happened, and sentences on what that may mean.
        why = re.sub(r"^\[[^]]*\] *", "", str(error)).partition(". ")[0]
        raise TrainingError(
            "Another process of this training has ended, or has not answered in time, so this one ends, too "
            f"({shorten(why, 120)}). The run goes on from its last checkpoint with --resume."
        ) from error
