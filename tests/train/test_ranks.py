"""Several processes train as one: shares of a batch, and real processes that end, die and go on."""

import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
import torch
from tests.support.changed import options
from tests.support.forked import LIMIT_S, ONE_THREAD, Forked
from tests.support.tiny_run import SMALL, Recorder, assert_same_bits, log_of, newest_tensors, tiny_config

from plnerf.errors import ConfigError
from plnerf.rays.jitter import SharedGenerator, ray_jitter
from plnerf.train.checkpoint import list_checkpoints
from plnerf.train.config import TrainConfig
from plnerf.train.loop import train
from plnerf.train.ranks import Ranks

STEPS, WARM_UP = 100, "train.warmup_steps=50"


@pytest.mark.parametrize("of", [2, 3])
def test_the_rays_of_a_batch_have_the_same_jitter_whoever_renders_them(of: int) -> None:
    whole = ray_jitter(6, 4, torch.Generator().manual_seed(3), torch.zeros(1))
    for rank in range(of):
        generator = SharedGenerator(torch.device("cpu"), rank, of).manual_seed(3)
        assert torch.equal(ray_jitter(6 // of, 4, generator, torch.zeros(1)), whole[rank::of])


def test_a_batch_is_shared_evenly_or_refused() -> None:
    shared = Ranks(1, 4).share_of(TrainConfig(rays=512, normal_rays=32))
    assert (shared.rays, shared.normal_rays) == (128, 8)
    with pytest.raises(ConfigError, match=r"train.rays must be a multiple of 3, but is 512"):
        Ranks(0, 3).share_of(TrainConfig())
    with pytest.raises(ConfigError, match=r"train.normal_rays must be a multiple of 64, but is 32"):
        Ranks(0, 64).share_of(TrainConfig())


# -- real processes


def arguments(scene: Path, out: Path) -> list[str]:
    settings = (*SMALL, WARM_UP, "train.checkpoints=10")
    return ["train", str(scene), "-o", str(out), "--steps", str(STEPS), *options(settings)]


def start_two(*arguments: str | Path) -> list[Forked]:
    """Two ranks as torchrun starts them, without torchrun, which would end one when the other has ended."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = str(free.getsockname()[1])
    of_all: dict[str, Any] = {
        "TORCHELASTIC_RUN_ID": "test", "WORLD_SIZE": "2", "LOCAL_WORLD_SIZE": "2",
        "MASTER_ADDR": "127.0.0.1", "MASTER_PORT": port,
    }  # fmt: skip
    return [Forked(*arguments, RANK=rank, LOCAL_RANK=rank, **of_all) for rank in "01"]


@pytest.fixture(scope="module")
def by_one(built_tiny_scene: Path, tmp_path_factory: pytest.TempPathFactory) -> Recorder:
    """What a run of this process alone reports."""
    report = Recorder()
    train(tiny_config(built_tiny_scene, WARM_UP, steps=STEPS), tmp_path_factory.mktemp("one") / "run", report)
    return report


@pytest.fixture(scope="module")
def by_two(
    by_one: Recorder, built_tiny_scene: Path, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, str]:
    """A run of two processes that torchrun started, and what they printed.  Kernels are compiled by then."""
    folder = tmp_path_factory.mktemp("ranks") / "run"
    torchrun = [sys.executable, "-m", "torch.distributed.run", "--nproc-per-node", "2", "-m", "plnerf"]
    done = subprocess.run(
        [*torchrun, *arguments(built_tiny_scene, folder)], env={**os.environ, **ONE_THREAD}, text=True,
        capture_output=True, timeout=LIMIT_S, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return folder, done.stdout + done.stderr


@pytest.mark.slow
def test_two_processes_train_as_one_does(by_one: Recorder, by_two: tuple[Path, str]) -> None:
    """After some steps to the order in which floats are summed, which training amplifies from then on."""
    folder, printed = by_two
    assert printed.count(f"{STEPS} steps in") == 1  # rank 0 alone prints
    losses = {line["step"]: line["loss"] for line in log_of(folder) if "loss" in line}
    assert losses[20] == pytest.approx(sum(by_one.terms[19].values()), rel=5e-4)
    held_out = [line["held_out_psnr_db"] for line in log_of(folder) if "held_out_psnr_db" in line]
    assert held_out == pytest.approx(by_one.held_out_db, abs=0.6)


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs a system with SIGKILL")
def test_one_process_killed_ends_the_other_and_both_go_on_to_the_same_bits(
    by_two: tuple[Path, str], built_tiny_scene: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "run"
    zero, one = start_two(*arguments(built_tiny_scene, folder))
    give_up = time.monotonic() + LIMIT_S
    while not list_checkpoints(folder / "checkpoints"):
        assert zero.status() is None, zero.wait()
        assert time.monotonic() < give_up
        time.sleep(0.005)
    one.kill()
    status, _, err = zero.wait()
    assert status == 1
    assert "TrainingError: Another process of this training has ended" in err and "--resume" in err
    assert not (folder / ".lock").exists()
    both = start_two("train", built_tiny_scene, "-o", folder, "--resume")
    for process in both:
        status, out, err = process.wait()
        assert status == 0, err
        assert ("resumed at step" in out) == (process is both[0])
    assert_same_bits(newest_tensors(folder), newest_tensors(by_two[0]))
    assert [line["step"] for line in log_of(folder)] == [line["step"] for line in log_of(by_two[0])]


@pytest.mark.slow
def test_uneven_shares_are_refused_by_rank_0(built_tiny_scene: Path, tmp_path: Path) -> None:
    both = start_two("train", built_tiny_scene, "-o", tmp_path / "run", "--train.rays", "33")
    (status, _, err), (other, _, late) = (process.wait() for process in both)
    assert (status, other) == (1, 1)
    assert "ConfigError: 2 processes" in err and "train.rays must be a multiple of 2, but is 33" in err
    assert late.startswith("TrainingError (rank 1): Another process of this training has ended")
