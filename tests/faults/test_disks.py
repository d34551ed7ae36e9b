"""A disk that is full, read-only or too small ends the command with what to do; then the same one goes on."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest
from tests.faults.changes import Fault
from tests.faults.conftest import SOURCES, Undisturbed
from tests.faults.small_reconstruct import log_of, run

pytestmark = pytest.mark.faults

EVERY = {"full": 7, "read-only": 23}
"""From one of so many changes of files on, the disk refuses them."""
FILE_LIMITS = (100, 1_000, 5_000, 20_000, 60_000, 200_000)
FREE_KB = (4, 16, 64, 128, 256, 400, 600, 800, 1_200)


@pytest.mark.parametrize("source", SOURCES)
@pytest.mark.parametrize("what", EVERY)
def test_a_disk_that_refuses_changes(
    what: str, source: str, undisturbed: dict[str, Undisturbed], out: Path
) -> None:
    last = max(changes.stop for changes in undisturbed[source].stages.values())
    for at in range(1, last, EVERY[what]):
        status, printed = undisturbed[source].disturbed(out, Fault(at, what))
        # What cannot be written may also be what nobody needs: who holds the folder.
        assert status in {0, 1} and "Traceback" not in printed, (at, printed)
        undisturbed[source].check_again(out)


@pytest.mark.parametrize("source", SOURCES)
@pytest.mark.parametrize("limit", FILE_LIMITS)
def test_files_that_may_not_get_so_large(
    limit: int, source: str, undisturbed: dict[str, Undisturbed], out: Path
) -> None:
    """A write ends in the middle: also those of COLMAP, of ffmpeg and of SQLite."""
    status, printed = undisturbed[source].disturbed(out, Fault(0), RLIMIT_FSIZE=limit)
    assert status == 1 and "Traceback" not in printed, printed
    undisturbed[source].check_again(out)


@pytest.mark.parametrize("source", SOURCES)
def test_a_full_disk(source: str, undisturbed: dict[str, Undisturbed], tmp_path: Path) -> None:
    """A file system in memory, of a size; then of enough."""
    disk = tmp_path / "disk"
    disk.mkdir()
    for free in FREE_KB:
        mounted = subprocess.run(
            ["mount", "-t", "tmpfs", "-o", f"size={free}k", "tmpfs", disk], capture_output=True, check=False
        )
        if mounted.returncode:
            pytest.skip("needs a user who may mount a file system (root)")
        try:
            status = run(undisturbed[source].source, disk / "out")
            assert status in {0, 1} and "Traceback" not in log_of(disk / "out").read_text()
            subprocess.run(["mount", "-o", "remount,size=50m", disk], check=True)
            undisturbed[source].check_again(disk / "out")
        finally:
            subprocess.run(["umount", disk], check=True)


@pytest.mark.skipif(os.access("/", os.W_OK), reason="needs a user who may not write everywhere")
def test_a_folder_that_may_not_be_written(undisturbed: dict[str, Undisturbed], out: Path) -> None:
    out.mkdir()
    out.chmod(0o500)
    status = run(undisturbed["posed"].source, out)
    assert status == 1 and "read-only" in log_of(out).read_text()
    out.chmod(0o700)
    shutil.rmtree(out)
    undisturbed["posed"].check_again(out)
