"""An export of a run is whole or not there, whatever ends it, and an earlier one stays until then."""

import random
import signal
from pathlib import Path

import pytest
from tests.faults.changes import FAULTS, Fault
from tests.faults.conftest import Undisturbed
from tests.faults.results import differing, inside, result
from tests.faults.small_reconstruct import log_of, run, stages_of

from plnerf.scene.whole_result import COMPLETE

pytestmark = pytest.mark.faults

FOLDER = "run/export/"
SMALL = ["--splats.degree", "1", "--splats.steps", "3", "--splats.views", "2"]
STATUS = {"kill": -signal.SIGKILL, "terminate": 143, "interrupt": 130, "full": 1, "read-only": 1}
MOMENTS = 4
"""Of each kind, over the whole command."""


def export(out: Path, count: int, *formats: str) -> list[str]:
    return ["export", str(out / "run"), "--formats", *formats, "--splats.count", str(count), *SMALL]


@pytest.mark.parametrize("what", FAULTS)
def test_an_export_is_whole_or_not_there(
    what: str, undisturbed: dict[str, Undisturbed], out: Path, tmp_path: Path
) -> None:
    whole, command = undisturbed["posed"], export(out, 120, "ply", "splat", "html")
    plain = whole.until(None, out)
    assert whole.disturbed(out, Fault(0), begun=plain, command=export(out, 60, "ply", "html"))[0] == 0
    earlier, begun = inside(FOLDER, result(out)), out.rename(tmp_path / "earlier")
    status, printed = whole.disturbed(out, Fault(0), begun=begun, command=command)
    assert status == 0, printed
    wanted, changes = inside(FOLDER, result(out)), len(stages_of(out)["start"])
    assert differing(earlier, wanted) and changes > MOMENTS
    draw, ended = random.Random(what), set()
    for at in sorted(draw.sample(range(1, changes), MOMENTS)):
        status, printed = whole.disturbed(out, Fault(at, what), begun=begun, command=command)
        assert status in {STATUS[what], 0} and "Traceback" not in printed, (at, printed)
        ended.add(status)
        left = {name: one for name, one in inside(FOLDER, result(out)).items() if "/." not in name}
        in_exchange = (out / FOLDER / COMPLETE).is_dir()
        assert in_exchange or not differing(left, earlier) or not differing(left, wanted), (at, sorted(left))
        assert run(whole.source, out, command=command) == 0, log_of(out).read_text()
        assert differing(inside(FOLDER, result(out)), wanted) == [], at
    assert STATUS[what] in ended
