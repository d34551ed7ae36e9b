"""Whenever a process is killed, a folder holds the earlier result or the new one, never parts of both."""

import errno
import itertools
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from plnerf.errors import PlnerfError
from plnerf.scene.whole_result import COMPLETE, LIST, finish_exchange, whole_result

PATTERNS = ("*.txt", "pictures/*.png")
OLD = {"a.txt": "old", "b.txt": "old", "pictures/0.png": "old", "pictures/1.png": "old"}
NEW = {"b.txt": "new", "c.txt": "new", "pictures/0.png": "new", "more/2.txt": "new"}
OTHERS = {"notes.md": "mine", "pictures/mine.jpg": "mine"}


class Killed(BaseException):
    """A SIGKILL: nothing that runs afterwards does anything to the disk."""


def write(folder: Path, files: dict[str, str]) -> None:
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)


def files_in(folder: Path) -> dict[str, str]:
    return {str(path.relative_to(folder)): path.read_text() for path in folder.rglob("*") if path.is_file()}


def replace_result(folder: Path) -> None:
    with whole_result(folder, PATTERNS) as new:
        write(new, NEW)


def killed_at(
    step: int,
    monkeypatch: pytest.MonkeyPatch,
    call: Callable[[], None],
    end: type[BaseException] = Killed,
) -> bool:
    """Whether the call was ended before its k-th change of the disk.

    A kill lets all later changes fail as well; Ctrl-C (KeyboardInterrupt) comes once.
    """
    done = itertools.count()

    def guarded(change: Callable[..., Any]) -> Callable[..., Any]:
        def one(*args: Any, **kwargs: Any) -> Any:
            if (number := next(done)) == step or (number > step and end is Killed):
                raise end
            return change(*args, **kwargs)

        return one

    with monkeypatch.context() as patch:
        for name in ("mkdir", "write_text", "rename", "replace", "unlink"):
            patch.setattr(Path, name, guarded(getattr(Path, name)))
        patch.setattr(shutil, "rmtree", guarded(shutil.rmtree))
        try:
            call()
        except end:
            return True
    return False


def test_killed_at_any_moment_it_is_one_result_or_the_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = []
    for step in itertools.count():
        folder = tmp_path / str(step)
        write(folder, OLD | OTHERS)
        killed = killed_at(step, monkeypatch, lambda folder=folder: replace_result(folder))
        again = step % 5  # and the clearing up is killed too
        killed_at(again, monkeypatch, lambda folder=folder: finish_exchange(folder))
        finish_exchange(folder)
        found = {name: text for name, text in files_in(folder).items() if not name.startswith(".new")}
        assert found in (OLD | OTHERS, NEW | OTHERS), step
        seen.append(found == NEW | OTHERS)
        replace_result(folder)
        assert files_in(folder) == NEW | OTHERS
        assert not [path for path in folder.iterdir() if path.name.startswith(".")]
        if not killed:
            break
    assert len(seen) > 20 and seen == sorted(seen) and 5 < sum(seen) < len(seen) - 5


def test_interrupted_at_any_moment_no_file_is_between_two_places(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ctrl-C lets a process put things in order."""
    seen = []
    for step in itertools.count():
        folder = tmp_path / str(step)
        write(folder, OLD | OTHERS)
        interrupted = killed_at(
            step, monkeypatch, lambda folder=folder: replace_result(folder), KeyboardInterrupt
        )
        found = {name: text for name, text in files_in(folder).items() if not name.startswith(".new")}
        assert found in (OLD | OTHERS, NEW | OTHERS), step
        seen.append(found == NEW | OTHERS)
        if not interrupted:
            break
    assert len(seen) > 20 and seen == sorted(seen) and 5 < sum(seen) < len(seen) - 5


@pytest.mark.parametrize(
    ("patterns", "files", "said"),
    [
        (["../*.txt"], [], "mine.txt, which is not inside"),
        ([], ["../mine.txt"], "mine.txt, which is not inside"),
        (["link/*.txt"], [], "mine.txt, which is not inside"),
        ([], ["link/mine.txt"], "mine.txt, which is not inside"),
        (["/etc/*"], [], "is damaged"),
        ([""], [], "is damaged"),
        ([1], [], r"patterns\.0"),
    ],
)
def test_a_result_of_others_moves_nothing_outside_its_folder(
    patterns: list[Any], files: list[Any], said: str, tmp_path: Path
) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    (tmp_path / "theirs" / COMPLETE / "link").mkdir(parents=True)
    (tmp_path / "theirs" / "link").symlink_to(tmp_path)
    (tmp_path / "theirs" / COMPLETE / "link" / "mine.txt").write_text("theirs")
    listed = json.dumps({"patterns": patterns, "files": files})
    (tmp_path / "theirs" / COMPLETE / LIST).write_text(listed)
    with pytest.raises(PlnerfError, match=said):
        finish_exchange(tmp_path / "theirs")
    assert (tmp_path / "mine.txt").read_text() == "mine"


def test_a_full_disk_leaves_the_earlier_result(tmp_path: Path) -> None:
    write(tmp_path, OLD | OTHERS)
    with pytest.raises(OSError, match="No space left"), whole_result(tmp_path, PATTERNS) as new:
        write(new, {"b.txt": "new"})
        raise OSError(errno.ENOSPC, "No space left on device")
    assert files_in(tmp_path) == OLD | OTHERS


def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: Any, **__: Any) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    write(tmp_path, OLD)
    monkeypatch.setattr(Path, "rename", full)
    with pytest.raises(PlnerfError, match=f"result in {tmp_path} cannot be written .*No space left"):
        replace_result(tmp_path)
    assert files_in(tmp_path) == OLD and not (tmp_path / COMPLETE).exists()
