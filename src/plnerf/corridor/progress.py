"""How far the blocks of a corridor are: one table of all, or a line for whatever changed."""

import time
from collections.abc import Sequence

from rich.table import Table

from plnerf.corridor.ledger import KINDS, Ledger, Record, Task
from plnerf.doctor.cost import in_words

SIGNS = {"waiting": "·", "running": "...", "done": "done", "failed": "failed"}
HEAD_LINES = 6
"""Lines of the table that are no blocks."""


class Progress:
    """What is known of all tasks so far, by stage."""

    def __init__(self) -> None:
        self._records: dict[tuple[str, str], Record] = {}
        self._begun: dict[str, tuple[float, int]] = {}
        """By stage, when it was first heard of, and how many of its tasks were done then."""

    def heard(self, stage: str, tasks: Sequence[Task], ledger: Ledger) -> list[str]:
        """Reads the records of a stage; returns a line for each that ended since, and one for a new stage."""
        changed, new = [], stage not in self._begun
        for task in tasks:
            key, record = (stage, task.folder), ledger.record(task)
            before = self._records.get(key)
            self._records[key] = record
            if before is not None and before.state != record.state:
                changed.append((task, record))
        done = sum(self._records[stage, task.folder].state == "done" for task in tasks)
        if new:
            self._begun[stage] = time.monotonic(), done
            words = [f"{stage}: {len(tasks)} blocks" + (f", {done} of them done before" if done else "")]
            return words if tasks else []
        left = f"{done} of {len(tasks)}{self._left(stage, len(tasks), done)}"
        return [_line(stage, task, record, left) for task, record in changed]

    def table(self, height: int) -> Table:
        """A row for each block of the newest stages; of many, those that run or wait first."""
        table = Table(box=None, pad_edge=False)
        stages = [one for one in dict.fromkeys(KINDS.values()) if one in self._begun]
        for name in ("block", *stages):
            table.add_column(name)
        folders = list(dict.fromkeys(folder for _, folder in self._records))
        unfinished = [folder for folder in folders if not self._ended(folder)]
        shown = (unfinished + [one for one in folders if one not in unfinished])[
            : max(1, height - HEAD_LINES)
        ]
        for folder in sorted(shown):
            cells = []
            for stage in stages:
                record = self._records.get((stage, folder))
                cells.append("" if record is None else SIGNS[record.state])
            table.add_row(folder, *cells)
        table.add_row("", *(self._sum(stage) for stage in stages))
        return table

    def _sum(self, stage: str) -> str:
        records = [record for (its, _), record in self._records.items() if its == stage]
        if not records:
            return ""
        done = sum(record.state == "done" for record in records)
        return f"{done} of {len(records)}{self._left(stage, len(records), done)}"

    def _left(self, stage: str, count: int, done: int) -> str:
        """How long the rest will take, at the rate so far."""
        begin, before = self._begun[stage]
        if done <= before or done == count:
            return ""
        return f", about {in_words((time.monotonic() - begin) / (done - before) * (count - done))} left"

    def _ended(self, folder: str) -> bool:
        return all(
            record.state in {"done", "failed"} for (_, its), record in self._records.items() if its == folder
        )


def _line(stage: str, task: Task, record: Record, left: str) -> str:
    what = f"{stage} of {task.folder}"
    if record.state == "done":
        return f"{what}: done in {record.seconds:.0f} s; {left}"
    return f"{what}: {record.state} {record.error}".rstrip()
