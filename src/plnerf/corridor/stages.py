"""What the stages of a corridor share: they do what is left of some tasks, and say how far these are."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from plnerf.corridor.engine import Engine
from plnerf.corridor.ledger import KINDS, Kind, Ledger, Task
from plnerf.findings import Finding
from plnerf.line.frame import LineFrame

Heard = Callable[[str, Sequence[Task], Ledger], None]
"""Called with a stage, its tasks, and the ledger that knows how far they are."""


@dataclass(frozen=True)
class Stages:
    """Does the tasks of one corridor."""

    out: Path
    engine: Engine
    heard: Heard

    @property
    def ledger(self) -> Ledger:
        """That of the corridor's folder."""
        return Ledger(self.out)

    def do(self, kind: Kind, tasks: Sequence[Task]) -> list[Task]:
        """Does those that are not done yet; returns all that are then."""
        ledger = self.ledger
        left = [task for task in tasks if not ledger.done(task)]
        self.heard(KINDS[kind], tasks, ledger)
        self.engine.run(self.out, left, lambda task: self.heard(KINDS[kind], tasks, ledger))
        self.heard(KINDS[kind], tasks, ledger)
        return [task for task in tasks if ledger.done(task)]


@dataclass(frozen=True)
class Surveyed:
    """The blocks of a corridor, surveyed or not."""

    frame: LineFrame
    """Of the whole."""
    tasks: tuple[Task, ...]
    """All, stage by stage."""
    surveys: tuple[tuple[Task, tuple[int, ...]], ...]
    """Those of them that survey blocks, each with the numbers of the spans that are the block's own."""
    planned: tuple[int, ...]
    """Numbers of all spans."""
    about: str
    """The input, in words."""
    findings: tuple[Finding, ...] = ()
