"""The ledger of a corridor: which tasks are done, on disk, so that who comes next does the others.

A task is done where its record says so and is of the same inputs, and the files that it wrote are there.
Records are written by the process that did the work, after its result: one that dies leaves a task to be
done again.
"""

import hashlib
import json
import os
import socket
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from plnerf.errors import PlnerfError
from plnerf.scene.files import write_text
from plnerf.scene.strict_json import read_json

Kind = Literal["find", "lines", "train", "survey", "finish"]
KINDS: dict[Kind, str] = {
    "find": "wires", "lines": "lines", "train": "field", "survey": "survey", "finish": "survey",
}  # fmt: skip
"""What a task makes, in the order of the stages: of images find, train, survey; of clouds lines, finish."""
State = Literal["waiting", "running", "done", "failed"]
RECORDS = "ledger"
"""The folder of the records."""


@dataclass(frozen=True, eq=False)
class Task:
    """A piece of work on one block, which one process does."""

    kind: Kind
    folder: str
    """Of the block, below that of the corridor: what is read and written lies in it."""
    inputs: Mapping[str, Any]
    """JSON values that decide its result: settings, and fingerprints of the files that it reads."""

    @property
    def name(self) -> str:
        """Of its record."""
        return f"{self.folder.replace('/', '-')}-{self.kind}"

    @property
    def sha256(self) -> str:
        """Fingerprint of its inputs."""
        return hashlib.sha256(json.dumps(self.inputs, sort_keys=True).encode()).hexdigest()


@dataclass(frozen=True)
class Record:
    """What is known of a task."""

    state: State
    seconds: float = 0.0
    processor_seconds: float = 0.0
    """Seconds for which cores worked on it, added up."""
    peak_mb: float = 0.0
    """Greatest memory of the process that did it, until it was done."""
    error: str = ""
    host: str = ""
    process: int = 0


class Ledger:
    """The records of a corridor's folder."""

    def __init__(self, out: Path) -> None:
        self.out = out

    def record(self, task: Task) -> Record:
        """What is known of a task with these inputs."""
        try:
            data = read_json(self._path(task), PlnerfError)
            if data["sha256"] != task.sha256:
                return Record("waiting")
            state: State = data["state"]
            if state == "done" and not all((self.out / name).is_file() for name in data["files"]):
                return Record("waiting")
            return Record(
                state, float(data["seconds"]), float(data["processor_seconds"]), float(data["peak_mb"]),
                str(data["error"]), str(data["host"]), int(data["process"]),
            )  # fmt: skip
        except (PlnerfError, LookupError, TypeError, ValueError):
            return Record("waiting")

    def done(self, task: Task) -> bool:
        """Whether nothing is left to do."""
        return self.record(task).state == "done"

    def write(
        self, task: Task, state: State, *, seconds: float = 0.0, processor_seconds: float = 0.0,
        peak_mb: float = 0.0, error: str = "", files: tuple[Path, ...] = (),
    ) -> None:  # fmt: skip
        """Writes a task's record.  files: what it wrote, without which it is not done."""
        content = {
            "task": task.name, "state": state, "sha256": task.sha256, "seconds": round(seconds, 2),
            "processor_seconds": round(processor_seconds, 2), "peak_mb": round(peak_mb, 1), "error": error,
            "host": socket.gethostname(), "process": os.getpid(),
            "files": [path.relative_to(self.out).as_posix() for path in files],
        }  # fmt: skip
        write_text(self._path(task), json.dumps(content, indent=1) + "\n")

    def _path(self, task: Task) -> Path:
        return self.out / RECORDS / f"{task.name}.json"
