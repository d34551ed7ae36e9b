"""Killed, terminated or interrupted at any moment, the same command again ends as if nothing had been."""

import random
import signal
from pathlib import Path

import pytest
from tests.faults.changes import Fault
from tests.faults.conftest import Undisturbed
from tests.faults.results import differing, inside, result
from tests.faults.small_reconstruct import log_of, run, stages_of

pytestmark = pytest.mark.faults

POSED = ("first", "train", "survey", "eval", "render")
STAGES = {"posed": POSED, "photos": ("capture", *POSED)}
KILLS = {"posed": 8, "photos": 10}
"""In each stage: 100 in all."""
SAID = {"terminate": "Terminated.", "interrupt": "Interrupted."}
STOPS = 3
"""Of each kind, in each stage."""
LATEST_S = 0.2
"""Of half of the signals, after a change of files; the others come with it."""


def moments(undisturbed: Undisturbed, stage: str, what: str, count: int) -> list[Fault]:
    """Drawn moments of a stage."""
    draw, changes = random.Random(f"{stage} {what}"), len(undisturbed.stages[stage])
    return [
        Fault(1 + draw.randrange(changes), what, draw.uniform(0, LATEST_S) * (i % 2), stage)
        for i in range(count)
    ]


@pytest.mark.parametrize(("source", "stage"), [(name, stage) for name in STAGES for stage in STAGES[name]])
def test_a_killed_command_is_given_again(
    source: str, stage: str, undisturbed: dict[str, Undisturbed], out: Path
) -> None:
    whole = undisturbed[source]
    begun = whole.until(stage, out)
    for fault in moments(whole, stage, "kill", KILLS[source]):
        status, printed = whole.disturbed(out, fault, begun=begun)
        assert status in {-signal.SIGKILL, 0} and (status or fault.after_s), (fault, printed)
        assert stage in stages_of(out)
        whole.check_again(out)


@pytest.mark.parametrize(("what", "expected"), [("terminate", 143), ("interrupt", 130)])
@pytest.mark.parametrize(("source", "stage"), [(name, stage) for name in STAGES for stage in STAGES[name]])
def test_a_command_that_is_stopped_says_so_and_goes_on(
    what: str, expected: int, source: str, stage: str, undisturbed: dict[str, Undisturbed], out: Path
) -> None:
    whole = undisturbed[source]
    begun = whole.until(stage, out)
    for fault in moments(whole, stage, what, STOPS):
        status, printed = whole.disturbed(out, fault, begun=begun)
        assert status in {expected, 0} and (status or fault.after_s), (fault, printed)
        assert "Traceback" not in printed and "***" not in printed, printed
        assert not status or "The same command goes on from what is done." in printed
        whole.check_again(out)


@pytest.mark.parametrize(("what", "expected"), [("terminate", 143), ("interrupt", 130)])
@pytest.mark.parametrize("stage", ["capture", "render", "survey"])
def test_one_stage_by_itself_is_stopped(
    what: str, expected: int, stage: str, undisturbed: dict[str, Undisturbed], out: Path
) -> None:
    """Pictures and surveys are then whole or not there; captures go on from what is done."""
    whole, goes_on = undisturbed["photos"], stage == "capture"
    command, folder, status_at_end = {
        "capture": (["capture", str(whole.source), "-o", str(out / "scene")], "scene/", 0),
        "render": (["render", str(out / "run"), "--frames", "2"], "run/renders/", 0),
        "survey": (["survey", str(out / "run")], "run/survey/", 3),  # no wire is found
    }[stage]
    wanted = inside(folder, whole.result)
    begun, stopped = whole.until(stage, out), 0
    for fault in moments(whole, stage, what, STOPS):
        status, printed = whole.disturbed(out, fault, begun=begun, command=command)
        assert status in {expected, status_at_end}, (fault, printed)  # it may have ended before
        assert "Traceback" not in printed and "***" not in printed, printed
        if status == expected:
            stopped += 1
            more = " The same command goes on from what is done." if goes_on else ""
            assert f"{SAID[what]}{more}" in printed.splitlines(), printed
            left = inside(folder, result(out))
            assert goes_on or not left or differing(left, wanted) == [], (fault, sorted(left))
        assert run(whole.source, out, command=command) == status_at_end, log_of(out).read_text()
        assert differing(inside(folder, result(out)), wanted) == [], fault
    assert stopped
