"""Where the output is no terminal, a plain line every few seconds says how far a stage is."""

import io
import threading
import time

from plnerf.console import bars
from plnerf.progress_lines import ProgressLines
from plnerf.terminal import Terminal


def test_a_line_has_stage_share_rate_and_time_left() -> None:
    now = [100.0]
    lines = ProgressLines(lambda text: None, clock=lambda: now[0])
    assert lines.line() == ""
    lines.count("survey", 0, 60)
    now[0] += 20
    assert lines.line() == "survey: 0%, 0 of 60, 20 s"
    lines.count("survey", 15, 60)
    assert lines.line() == "survey: 25%, 15 of 60, 0.75 a second, 20 s, about 60 s left"
    lines.count("photos", 3, 0)
    assert lines.line() == "photos: 0 s"


def test_a_stage_that_goes_on_is_extrapolated_from_where_it_began() -> None:
    now = [0.0]
    lines = ProgressLines(lambda text: None, clock=lambda: now[0])
    lines.show("train", 0.5)
    now[0] = 30
    lines.show("train", 0.75, "9,000 rays/s")
    assert lines.line() == "train: 75%, 9,000 rays/s, 30 s, about 30 s left"


def test_lines_come_during_a_long_step_and_end_with_the_stage() -> None:
    written: list[str] = []
    two = threading.Event()

    def write(text: str) -> None:
        written.append(text)
        if len(written) == 2:
            two.set()

    with ProgressLines(write, every_s=0.01) as lines:
        lines.count("render", 1, 4)
        assert two.wait(10)
    count = len(written)
    time.sleep(0.05)
    assert len(written) == count and all(one.startswith("render: 25%, 1 of 4") for one in written)


def test_a_reader_that_is_gone_does_not_end_the_work() -> None:
    def write(text: str) -> None:
        raise BrokenPipeError

    with ProgressLines(write, every_s=0.001) as lines:
        lines.show("train", 0.1)
        time.sleep(0.05)


def test_bars_are_lines_where_there_is_no_terminal() -> None:
    out = io.StringIO()
    with bars(Terminal(file=out)) as report:
        report("match", 1, 2)
    assert out.getvalue() == ""  # it took less than ten seconds
