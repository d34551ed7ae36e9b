"""`train --view`: the field as it forms, its curves, pause, and a stop that loses nothing."""

import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("viser", reason="plnerf[view] is not installed")

from tests.support.tiny_run import Recorder, assert_same_bits, newest_tensors, small, tiny_config
from tests.support.viewer_client import ViewerClient

from plnerf.cli.main import main
from plnerf.pipeline import resume_run, train_scene
from plnerf.train.report import RunLog
from plnerf.view.training_progress import MOST_PLACES, TrainingProgress
from plnerf.view.watched_training import WatchedTraining

pytestmark = pytest.mark.filterwarnings("ignore:Queued a .* on a closed connection")
ORIGIN, AT = np.array([0.0, -0.3, 0.1]), np.array([0.0, 0.0, 0.02])


@contextmanager
def watched(scene: Path, run: Path, steps: int) -> Iterator[tuple[WatchedTraining, list[str]]]:
    """A training in a thread of its own."""
    said: list[str] = []
    log = RunLog(run)
    visitor = WatchedTraining(log, said.append, port=0)
    options: dict[str, Any] = {"device": "cpu", "report": log, "visitor": visitor, **small()}
    thread = threading.Thread(target=lambda: train_scene(scene, run, steps=steps, **options))
    thread.start()
    end = time.monotonic() + 60
    while not said:
        assert thread.is_alive() and time.monotonic() < end
        time.sleep(0.01)
    try:
        yield visitor, said
    finally:
        assert visitor._progress is not None
        visitor._progress.turns.stop()
        thread.join(60)
    assert not thread.is_alive()


@pytest.mark.slow
def test_it_is_watched_paused_and_stopped_and_resumed_to_the_same_bits(
    tiny_scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("plnerf.view.watched_training.RENEW_S", 0.2)
    run = tmp_path / "run"
    with watched(tiny_scene, run, 100_000) as (visitor, said):
        assert visitor._server is not None and visitor._progress is not None
        progress = visitor._progress
        assert said == [f"Open {visitor._server.address} in a browser to watch."]
        with ViewerClient(visitor._server.port) as client:
            client.look(ORIGIN, AT)
            client.wait(lambda: bool(client.of("BackgroundImageMessage")), "a picture while it trains")
            client.wait(lambda: "loss 0." in client.texts(), "the newest loss")
            client.wait(lambda: "renewed in" in client.texts(), "a picture of what has changed")
            pause = client.control("Pause")
            client.send("GuiUpdateMessage", uuid=pause, updates={"value": True})
            client.wait(lambda: "**Paused.**" in client.texts(), "a pause")
            time.sleep(0.2)
            step = progress.step
            seen = len(client.of("BackgroundImageMessage"))
            client.look(ORIGIN * 1.1, AT)
            client.wait(lambda: len(client.of("BackgroundImageMessage")) > seen, "a picture while it waits")
            assert progress.step == step
            client.send("GuiUpdateMessage", uuid=pause, updates={"value": True})
            client.wait(lambda: progress.step > step, "a step")
            client.choose("Stop and save", True)
            client.wait(lambda: progress.turns.stopped, "its end")
    stopped = progress.step
    assert said[-1] == (
        f"Stopped in the browser at step {stopped}. Go on: plnerf train {tiny_scene} -o {run} --resume"
    )
    assert (run / "checkpoints" / f"step-{stopped}.safetensors").is_file()
    resume_run(tiny_scene, run, steps=stopped + 3, report=Recorder())
    unwatched = tmp_path / "unwatched"
    train_scene(tiny_scene, unwatched, steps=100_000, device="cpu", visitor=Until(stopped), **small())
    resume_run(tiny_scene, unwatched, steps=stopped + 3, report=Recorder())
    assert_same_bits(newest_tensors(run), newest_tensors(unwatched))


class Until:
    """A visitor that stops at a step."""

    def __init__(self, step: int) -> None:
        self._step = step

    def begin(self, *_: object) -> None: ...

    def between_steps(self, step: int) -> bool:
        return step < self._step

    def close(self) -> None: ...


def test_curves_are_thinned_and_keep_the_newest(tmp_path: Path) -> None:
    log = RunLog(tmp_path)
    progress = TrainingProgress(tiny_config(tmp_path), log)
    assert progress.curves().shape == (3, 0) and not progress.note(1)
    for step in range(1000):
        log.latest = {"loss": 1.0 / (step + 1), "train_psnr_db": 20.0 + step}
        assert progress.note(step) and not progress.note(step)
    log.held_out_db.append(21.5)
    progress.note(1001)
    steps, loss, psnr = progress.curves()
    assert MOST_PLACES / 2 < len(steps) <= MOST_PLACES
    assert (steps[-1], loss[-1], psnr[-1]) == (999, 1e-3, 1019.0)
    assert progress.held_out().tolist() == [[1000.0], [21.5]]


def test_view_is_refused_without_the_extra_and_in_several_processes(
    monkeypatch: pytest.MonkeyPatch, tiny_scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def run() -> str:
        monkeypatch.setattr(
            sys, "argv", ["plnerf", "train", str(tiny_scene), "-o", str(tmp_path / "run"), "--view"]
        )
        with pytest.raises(SystemExit) as ended:
            main()
        assert ended.value.code == 1 and not (tmp_path / "run").exists()
        return " ".join(capsys.readouterr().err.split())

    monkeypatch.setattr("plnerf.train.ranks.processes_here", lambda: 2)
    assert "--view shows a training in one process" in run()
    monkeypatch.setattr("plnerf.cli.view.find_spec", lambda name: None)
    assert "plnerf train --view shows things by viser, which is not installed" in run()
