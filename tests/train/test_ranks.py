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
from tests.support.tiny_run import SMALL, Recorder, assert_same_bits, log_of, newest_tensors, tiny_config

from plnerf.errors import ConfigError
from plnerf.rays.jitter import SharedGenerator, ray_jitter
from plnerf.train.checkpoint import list_checkpoints
from plnerf.train.config import TrainConfig
from plnerf.train.loop import train
from plnerf.train.ranks import Ranks

STEPS, WARM_UP = 200, "train.warmup_steps=50"


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


def start(command: list[str], **environment: str) -> subprocess.Popen[str]:
    one = {"COLUMNS": "100", "NO_COLOR": "1", "NUMBA_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    return subprocess.Popen(
        [sys.executable, "-m", *command], env={**os.environ, **one, **environment}, text=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip


def start_two(command: list[str]) -> list[subprocess.Popen[str]]:
    """Two ranks as torchrun starts them, without torchrun, which would end one when the other has ended."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = str(free.getsockname()[1])
    of_all: dict[str, Any] = {
        "TORCHELASTIC_RUN_ID": "test", "WORLD_SIZE": "2", "LOCAL_WORLD_SIZE": "2",
        "MASTER_ADDR": "127.0.0.1", "MASTER_PORT": port,
    }  # fmt: skip
    return [start(command, RANK=rank, LOCAL_RANK=rank, **of_all) for rank in "01"]


def wait(process: subprocess.Popen[str]) -> tuple[int, str, str]:
    try:
        out, err = process.communicate(timeout=100)
    finally:
        process.kill()
    return process.returncode, out, err


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
    torchrun = ["torch.distributed.run", "--nproc-per-node", "2", "-m", "plnerf"]
    status, out, err = wait(start([*torchrun, *arguments(built_tiny_scene, folder)]))
    assert status == 0, err
    return folder, out + err


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
    zero, one = start_two(["plnerf", *arguments(built_tiny_scene, folder)])
    give_up = time.monotonic() + 100
    while not list_checkpoints(folder / "checkpoints"):
        assert zero.poll() is None, zero.communicate()
        assert time.monotonic() < give_up
        time.sleep(0.005)
    one.kill()
    status, _, err = wait(zero)
    wait(one)
    assert status == 1
    assert "TrainingError: Another process of this training has ended" in err and "--resume" in err
    assert not (folder / ".lock").exists()
    both = start_two(["plnerf", "train", str(built_tiny_scene), "-o", str(folder), "--resume"])
    for process in both:
        status, out, err = wait(process)
        assert status == 0, err
        assert ("resumed at step" in out) == (process is both[0])
    assert_same_bits(newest_tensors(folder), newest_tensors(by_two[0]))
    assert [line["step"] for line in log_of(folder)] == [line["step"] for line in log_of(by_two[0])]


def test_uneven_shares_are_refused_by_rank_0(built_tiny_scene: Path, tmp_path: Path) -> None:
    uneven = ["plnerf", "train", str(built_tiny_scene), "-o", str(tmp_path / "run"), "--train.rays", "33"]
    (status, _, err), (other, _, late) = map(wait, start_two(uneven))
    assert (status, other) == (1, 1)
    assert "ConfigError: 2 processes" in err and "train.rays must be a multiple of 2, but is 33" in err
    assert late.startswith("TrainingError (rank 1): Another process of this training has ended")
