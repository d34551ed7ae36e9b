"""Two processes train together: what ends one ends the other, and both go on to the same bits."""

import random
import signal
import socket
import time
from pathlib import Path

import pytest
from tests.faults.changes import FAULTS, NONE, Fault
from tests.faults.conftest import Undisturbed
from tests.faults.results import differing, result
from tests.faults.small_reconstruct import LIMIT_S, STEPS, log_of, stages_of, start
from tests.support.changed import options
from tests.support.tiny_run import SMALL

pytestmark = pytest.mark.faults

SETTINGS = (*SMALL, "train.checkpoints=4", "train.rays=64", "train.find_wires=true")
STATUS = {"kill": -signal.SIGKILL, "terminate": 143, "interrupt": 130, "full": 1, "read-only": 1}
MOMENTS = 3
"""Of each kind, over the whole training."""


def both(source: Path, out: Path, fault: Fault = NONE) -> tuple[list[int | None], list[str]]:
    """Exit statuses and outputs of two ranks, as torchrun starts them; rank 0, which writes, meets the fault.

    They go on with the run, where it has its settings.
    """
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = str(free.getsockname()[1])
    of_all = {
        "TORCHELASTIC_RUN_ID": "test", "WORLD_SIZE": "2", "LOCAL_WORLD_SIZE": "2",
        "MASTER_ADDR": "127.0.0.1", "MASTER_PORT": port,
    }  # fmt: skip
    command = ["train", str(source), "-o", str(out)]
    goes_on = (out / "config.json").exists()
    command += ["--resume"] if goes_on else ["--steps", str(STEPS), *options(SETTINGS)]
    outs = [out, out.with_name("rank 1")]
    own = [of_all | {"RANK": rank, "LOCAL_RANK": rank} for rank in "01"]
    zero = start(source, outs[0], fault, command, own[0])
    ranks = [zero, start(source, outs[1], NONE, command, own[1])]
    last = time.monotonic() + LIMIT_S
    for process in ranks:
        process.join(max(0.0, last - time.monotonic()))
    ended = [process.exitcode for process in ranks]
    for process in ranks:
        process.kill()
    return ended, [log_of(place).read_text() for place in outs]


@pytest.fixture(scope="module")
def trained(
    undisturbed: dict[str, Undisturbed], tmp_path_factory: pytest.TempPathFactory
) -> tuple[dict[str, bytes], int]:
    """What two undisturbed ranks write, and the number of their changes to files."""
    out = tmp_path_factory.mktemp("ranks") / "run"
    ended, printed = both(undisturbed["posed"].source, out)
    assert ended == [0, 0], printed
    return result(out), len(stages_of(out)["start"])


@pytest.mark.parametrize("what", FAULTS)
def test_both_end_and_go_on(
    what: str, trained: tuple[dict[str, bytes], int], undisturbed: dict[str, Undisturbed], tmp_path: Path
) -> None:
    (wanted, changes), source, draw = trained, undisturbed["posed"].source, random.Random(what)
    statuses = set()
    for at in sorted(draw.sample(range(1, changes), MOMENTS)):
        out = tmp_path / str(at) / "run"
        out.parent.mkdir()
        (zero, one), printed = both(source, out, Fault(at, what))
        assert zero in {STATUS[what], 0} and one in {0, 1}, (at, zero, one, printed)
        statuses.add(zero)
        assert not any("Traceback" in text for text in printed), (at, printed)
        assert one == 0 or "Another process of this training has ended" in printed[1], (at, printed)
        ended, printed = both(source, out)
        assert ended == [0, 0], (at, printed)
        assert differing(result(out), wanted) == [], at
    assert STATUS[what] in statuses
