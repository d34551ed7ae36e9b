"""A disk that is full, read-only or too small ends the command with what to do; then the same one goes on."""

import json
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from tests.faults.changes import Fault
from tests.faults.conftest import SOURCES, Undisturbed
from tests.faults.small_reconstruct import log_of, run, stages_of

pytestmark = pytest.mark.faults

STAGES = [
    ("posed", "start", 1), ("posed", "train", 1), ("posed", "eval", 1), ("posed", "render", 1),
    ("posed", "survey", 1), ("photos", "start", 1), ("photos", "capture", 1), ("photos", "train", 20),
    ("photos", "eval", 20), ("photos", "render", 20), ("photos", "survey", 20), ("posed", "first", 20),
    ("photos", "first", 20),
]  # fmt: skip
"""From each change of files on, or from one of so many, the disk is full."""
READ_ONLY_EVERY = 20
FILE_LIMITS = (100, 1_000, 5_000, 20_000, 60_000, 200_000)
FREE_KB = (4, 16, 64, 128, 256, 400, 600, 800, 1_200)


@pytest.mark.parametrize(("source", "stage", "every"), STAGES)
def test_a_disk_that_refuses_changes(
    source: str, stage: str, every: int, undisturbed: dict[str, Undisturbed], out: Path
) -> None:
    whole = undisturbed[source]
    begun = None if stage == "start" else whole.until(stage, out)
    end = len(whole.stages[stage]) + 1
    faults = [Fault(at, "full", stage=stage) for at in range(1, end, every)]
    faults += [Fault(at, "read-only", stage=stage) for at in range(1, end, READ_ONLY_EVERY)]
    for fault in faults:
        status, printed = whole.disturbed(out, fault, begun=begun)
        # What cannot be written may also be what nobody needs: who holds the folder.
        assert status in {0, 1} and "Traceback" not in printed, (fault, printed)
        assert stage in stages_of(out)
        whole.check_again(out)


@pytest.mark.parametrize("source", SOURCES)
@pytest.mark.parametrize("limit", FILE_LIMITS)
def test_files_that_may_not_get_so_large(
    limit: int, source: str, undisturbed: dict[str, Undisturbed], out: Path
) -> None:
    """A write ends in the middle: also those of COLMAP, of ffmpeg and of SQLite."""
    status, printed = undisturbed[source].disturbed(out, Fault(0), RLIMIT_FSIZE=limit)
    assert status == 1 and "Traceback" not in printed, printed
    undisturbed[source].check_again(out)


def test_a_report_on_the_machine_is_whole_or_the_earlier_one(out: Path) -> None:
    command = ["doctor", "--machine", "-o", str(out / "machine.json")]
    out.mkdir()
    (out / "machine.json").write_text("earlier")
    status = run(out, out, command=command, RLIMIT_FSIZE=100)
    assert status == 1 and "Traceback" not in log_of(out).read_text(), log_of(out).read_text()
    assert [(path.name, path.read_text()) for path in out.iterdir()] == [("machine.json", "earlier")]
    assert run(out, out, command=command) == 0, log_of(out).read_text()
    assert json.loads((out / "machine.json").read_text())["usable_cores"]


@contextmanager
def disk(folder: Path, options: str) -> Iterator[Callable[[str], object]]:
    """Mounts a file system in memory; yields what mounts it anew with other options."""
    folder.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", options, "tmpfs", str(folder)]
    if subprocess.run(command, capture_output=True, check=False).returncode:
        pytest.skip("needs a user who may mount a file system (root)")
    try:
        yield lambda other: subprocess.run(["mount", "-o", f"remount,{other}", folder], check=True)
    finally:
        subprocess.run(["umount", folder], check=True)


@pytest.mark.parametrize("free", FREE_KB)
@pytest.mark.parametrize("source", SOURCES)
def test_a_full_disk(source: str, free: int, undisturbed: dict[str, Undisturbed], out: Path) -> None:
    with disk(out, f"size={free}k") as mount_again:
        status = run(undisturbed[source].source, out)
        assert status in {0, 1} and "Traceback" not in log_of(out).read_text()
        mount_again("size=50m")
        undisturbed[source].check_again(out)


@pytest.mark.parametrize("source", SOURCES)
def test_a_read_only_disk(source: str, undisturbed: dict[str, Undisturbed], out: Path) -> None:
    with disk(out, "size=50m,ro") as mount_again:
        status = run(undisturbed[source].source, out)
        assert status == 1 and "out is read-only. Name another place" in log_of(out).read_text()
        mount_again("rw")
        undisturbed[source].check_again(out)
