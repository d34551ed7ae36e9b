"""Scenes of a few kilobytes, and what `reconstruct` makes of them where nothing disturbs it."""

import shutil
import signal
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import pytest
from tests.capture.test_capture import photos_with_positions
from tests.conftest import write_tiny_scene
from tests.faults.changes import NONE, Fault
from tests.faults.results import differing, result
from tests.faults.small_reconstruct import log_of, run, stages_of

SOURCES = ("posed", "photos")


@dataclass(frozen=True)
class Undisturbed:
    """A source, and what the command makes of it."""

    source: Path
    stages: dict[str, range]
    """With the numbers of the changes that each makes to files."""
    result: dict[str, bytes]

    def check_again(self, out: Path) -> None:
        """Gives the command again and compares its result."""
        status = run(self.source, out)
        assert status == 0, f"the same command again ended with {status}: {log_of(out).read_text()}"
        assert differing(result(out), self.result) == []

    def disturbed(
        self,
        out: Path,
        fault: Fault,
        *,
        begun: Path | None = None,
        command: Sequence[str] = (),
        **limits: int,
    ) -> tuple[int, str]:
        """Exit status and output of a command with a fault: in a new folder, or a copy of one begun.

        command, limits: as of `start`.
        """
        shutil.rmtree(out, ignore_errors=True)
        if begun is not None:
            shutil.copytree(begun, out)
        status = run(self.source, out, fault, command, **limits)
        return status, log_of(out).read_text()

    def until(self, stage: str | None, out: Path) -> Path:
        """A folder with all that a command in `out` makes before a stage; None: with its result."""
        status, printed = self.disturbed(out, Fault(1, stage=stage) if stage else NONE)
        assert status == (-signal.SIGKILL if stage else 0), printed
        return out.rename(out.with_name(f"until-{stage}"))


@pytest.fixture(scope="session")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Undisturbed]:
    """By the source's name: a scene with poses, and photos with positions."""
    made = {}
    for name in SOURCES:
        folder = tmp_path_factory.mktemp(name)
        if name == "posed":
            write_tiny_scene(folder / name)
        else:
            photos_with_positions(folder / name)
            shutil.rmtree(folder / name / "png")
        assert run(folder / name, folder / "out") == 0, log_of(folder / "out").read_text()
        made[name] = Undisturbed(folder / name, stages_of(folder / "out"), result(folder / "out"))
    return made


@pytest.fixture
def out(tmp_path: Path) -> Iterator[Path]:
    """A folder to write, which is not there yet."""
    yield tmp_path / "out"
    shutil.rmtree(tmp_path, ignore_errors=True)
