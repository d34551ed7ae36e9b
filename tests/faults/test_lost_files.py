"""Files that are removed, cut or emptied after a stage: made again, or named with what to do about them."""

import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from tests.faults.conftest import SOURCES, Undisturbed
from tests.faults.results import differing, result
from tests.faults.small_reconstruct import log_of, run

pytestmark = pytest.mark.faults


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


LOSSES: dict[str, Callable[[Path], object]] = {"removed": Path.unlink, "cut": cut}
OUTPUTS = re.compile(r"run/(eval|renders|survey)/|^survey/|scene/capture\.json")
"""What no stage reads: where it is damaged, and not absent, it is left as it is."""
SPARE = re.compile(r"run/checkpoints/step-18\.|run/metrics\.jsonl|scene/sfm/pairs\.txt|/?\.lock")
"""The log, the checkpoint before the newest one and the pairs last matched: nothing needs them any more."""


@pytest.mark.parametrize("source", SOURCES)
@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize("after", ["train", "render"])
def test_a_lost_file(
    after: str, loss: str, source: str, undisturbed: dict[str, Undisturbed], out: Path
) -> None:
    """After all stages; and after training, where all that follows is to be made of what is left."""
    whole = undisturbed[source]
    kept = whole.until({"train": "survey", "render": None}[after], out)
    for name in sorted(result(kept)):
        shutil.rmtree(out, ignore_errors=True)
        shutil.copytree(kept, out)
        LOSSES[loss](out / name)
        status, printed = run(whole.source, out), log_of(out).read_text()
        assert status in {0, 1} and "Traceback" not in printed, (name, printed)
        if status:
            assert Path(name).stem in printed, f"{name} is not named: {printed}"
            continue
        different = [one for one in differing(result(out), whole.result) if not SPARE.search(one)]
        if loss == "cut" and OUTPUTS.search(name):
            different = [one for one in different if one != name]
        assert different == [], (name, printed)
