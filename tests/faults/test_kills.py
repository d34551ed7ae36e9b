"""Killed, terminated or interrupted at any moment, the same command again ends as if nothing had been."""

import random
import signal
from pathlib import Path

import pytest
from tests.faults.changes import FAULTS, Fault
from tests.faults.conftest import Undisturbed
from tests.faults.small_reconstruct import stages_of

pytestmark = pytest.mark.faults

TRAINED = ("train", "eval", "render", "survey")
STAGES = {"posed": TRAINED, "photos": ("capture", *TRAINED)}
KILLS = {"posed": 10, "photos": 12}
"""In each stage: 100 in all."""
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
    assert what in FAULTS
    whole = undisturbed[source]
    begun = whole.until(stage, out)
    for fault in moments(whole, stage, what, 2):
        status, printed = whole.disturbed(out, fault, begun=begun)
        assert status in {expected, 0} and (status or fault.after_s), (fault, printed)
        assert "Traceback" not in printed and "***" not in printed, printed
        assert not status or "The same command goes on from what is done." in printed
        whole.check_again(out)
