"""What a run reports: a log without gaps or doubles, events, and a console that is given back."""

import json
import math
import time
from pathlib import Path

import pytest
import torch
from rich.console import Console
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from tests.support.tiny_run import log_of, open_tiny, tiny_config

from plnerf.console import RunConsole
from plnerf.scene.scene import Scene
from plnerf.train.report import LOG_EVERY, Report, RunLog, SilentReport, read_log
from plnerf.train.schedule import HeldOut


def terms_of(step: int) -> dict[str, torch.Tensor]:
    return {"colour": torch.tensor(1.0 / step), "interlevel": torch.tensor(0.5)}


@pytest.fixture
def scene(tiny_scene: Path, tmp_path: Path) -> Scene:
    return open_tiny(tiny_scene, tmp_path)


def play(folder: Path, scene: Scene, first: int, last: int, total: int = 100) -> str:
    """A run from one step to another, half a second each, validated at full tens; its console's text."""
    console = Console(record=True, width=100, file=(folder.parent / "console.txt").open("w"))
    report = RunConsole(folder, console)
    report.begin(tiny_config(Path("/s"), steps=total), scene, first)
    for step in range(first + 1, last + 1):
        report.step(step, step / 2, step / total, terms_of(step))
        if step % 10 == 0:
            report.validation(step, step / 2, HeldOut(20 + step / 10))
    if last == total:
        report.end(last, last / 2)
    report.close()
    return console.export_text()


def test_the_log_of_a_run(tmp_path: Path, scene: Scene) -> None:
    text = play(tmp_path / "run", scene, 0, 100)
    log = log_of(tmp_path / "run")
    steps = [line for line in log if "loss" in line]
    assert [line["step"] for line in steps] == list(range(LOG_EVERY, 101, LOG_EVERY))
    assert [line["step"] for line in log if "held_out_psnr_db" in line] == list(range(10, 101, 10))
    for line in steps:
        assert line["seconds"] == line["step"] / 2
        assert line["colour"] == pytest.approx(1 / line["step"])
        assert line["loss"] == pytest.approx(line["colour"] + line["interlevel"])
        assert line["train_psnr_db"] == pytest.approx(-10 * math.log10(line["colour"]))
        assert line["rays_per_s"] == pytest.approx(128 * 2)
    assert "10 training and 2 held-out images of 48x32, backend numba on cpu, seed 0\n" in text
    assert "100 steps in 50 s of training, held out 30.00 dB" in text


def test_the_last_step_is_always_in_the_log(tmp_path: Path, scene: Scene) -> None:
    play(tmp_path / "run", scene, 0, 33, total=33)
    assert [line["step"] for line in log_of(tmp_path / "run") if "loss" in line] == [20, 33]


def test_lines_after_the_checkpoint_are_written_anew(tmp_path: Path, scene: Scene) -> None:
    """A run is killed at step 90, its last checkpoint is that of step 50."""
    play(tmp_path / "run", scene, 0, 90)
    with (tmp_path / "run/metrics.jsonl").open("a") as log:
        log.write('{"step": 91, "sec')  # the kill came in the middle of a line
    text = play(tmp_path / "run", scene, 50, 100)
    play(tmp_path / "whole", scene, 0, 100)
    assert [strip(line) for line in log_of(tmp_path / "run")] == [
        strip(line) for line in log_of(tmp_path / "whole")
    ]
    assert "resumed at step 50" in text


def test_a_log_with_lines_that_are_none_goes_on_without_them(tmp_path: Path, scene: Scene) -> None:
    play(tmp_path / "run", scene, 0, 90)
    path = tmp_path / "run/metrics.jsonl"
    whole = path.read_bytes()
    after = [bytes(40), b'{"step": 1e999}', b"[" * 9999, b""]
    path.write_bytes(b"garbage\n\xff\xfe\n[1]\n{}\n" + whole + b"\n".join(after))
    with pytest.warns(UserWarning, match=r"metrics\.jsonl: 7 of its lines cannot be read"):
        assert read_log(path) == [json.loads(line) for line in whole.splitlines()]
    with pytest.warns(UserWarning, match="7 of its lines"):
        play(tmp_path / "run", scene, 90, 100)
    assert [line["step"] for line in log_of(tmp_path / "run")][-1] == 100


def strip(line: dict[str, float]) -> dict[str, float]:
    return {key: value for key, value in line.items() if key != "rays_per_s"}


def test_events_are_those_of_the_log(tmp_path: Path, scene: Scene) -> None:
    play(tmp_path / "run", scene, 0, 90)
    # TensorBoard reads files in the order of their names: the second of opening, then a counter that counts
    # on as text, "10" before "9".  Two files of one process and one second may be read the wrong way round.
    time.sleep(1.1)
    play(tmp_path / "run", scene, 60, 100)
    events = EventAccumulator(str(tmp_path / "run"))
    events.Reload()
    log = log_of(tmp_path / "run")
    for name in ("loss", "colour", "train_psnr_db", "held_out_psnr_db"):
        shown = {event.step: event.value for event in events.Scalars(name)}
        assert shown == pytest.approx({line["step"]: line[name] for line in log if name in line})


def test_a_failed_run_gives_the_console_and_the_log_back(tmp_path: Path, scene: Scene) -> None:
    console = Console(force_terminal=True, file=(tmp_path / "console.txt").open("w"))
    report = RunConsole(tmp_path / "run", console)
    report.begin(tiny_config(Path("/s"), steps=40), scene, 0)
    report.step(1, 0.5, 1 / 40, terms_of(1))
    report.close()
    report.close()
    console.file.close()
    text = (tmp_path / "console.txt").read_text()
    assert text.rindex("\x1b[?25h") > text.rindex("\x1b[?25l")  # the cursor is shown again
    with pytest.raises(ValueError, match="closed file"):
        report.validation(1, 0.5, HeldOut(20.0, 18.0))


def test_nothing_left_of_a_run_that_settled(tmp_path: Path) -> None:
    console = Console(record=True, width=100)
    report = RunConsole(tmp_path / "run", console)
    report.nothing_left(tiny_config(Path("/s"), "until=settled", steps=90), 40, 12.6)
    assert console.export_text() == "Nothing left to train: the run had settled after 40 steps.\n"


@pytest.mark.parametrize(
    ("budget", "words"), [({"steps": 40}, "40 of 40 steps"), ({"seconds": 12.0}, "13 of 12 s")]
)
def test_nothing_left(budget: dict[str, float], words: str, tmp_path: Path) -> None:
    console = Console(record=True, width=100)
    report = RunConsole(tmp_path / "run", console)
    report.nothing_left(tiny_config(Path("/s"), **budget), 40, 12.6)
    assert (
        console.export_text() == f"Nothing left to train: {words} are done. Give a larger budget to go on.\n"
    )
    assert not (tmp_path / "run").exists()


def test_all_reports_are_reports(tmp_path: Path) -> None:
    assert isinstance(SilentReport(), Report)
    assert isinstance(RunLog(tmp_path), Report)
    assert isinstance(RunConsole(tmp_path, Console()), Report)
