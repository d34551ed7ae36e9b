"""Two commands at once, and limits of memory: nothing is mixed, nothing is lost."""

import time
from pathlib import Path

import pytest
from tests.faults.changes import Fault
from tests.faults.conftest import SOURCES, Undisturbed
from tests.faults.small_reconstruct import LIMIT_S, log_of, start

pytestmark = pytest.mark.faults

GB = 1 << 30
MEMORY = tuple(int(share * GB) for share in (0.5, 1, 1.5, 2, 2.5, 3, 4, 6))


@pytest.mark.parametrize("source", SOURCES)
@pytest.mark.parametrize("later_s", [0.0, 0.05, 0.5, 1.0])
def test_two_at_once(later_s: float, source: str, undisturbed: dict[str, Undisturbed], out: Path) -> None:
    whole = undisturbed[source]
    one = start(whole.source, out)
    time.sleep(later_s)
    other = start(whole.source, out)
    for process in (one, other):
        process.join(LIMIT_S)
    ended = {one.exitcode, other.exitcode}
    assert ended <= {0, 1} and 0 in ended, log_of(out).read_text()
    whole.check_again(out)


@pytest.mark.parametrize("source", SOURCES)
@pytest.mark.parametrize("limit", MEMORY)
def test_too_little_memory(limit: int, source: str, undisturbed: dict[str, Undisturbed], out: Path) -> None:
    """Native libraries may end the process themselves; the same command with more memory goes on."""
    status, printed = undisturbed[source].disturbed(out, Fault(0), RLIMIT_AS=limit)
    assert status != 70 and (status < 0 or "Traceback" not in printed), (status, printed)
    undisturbed[source].check_again(out)
