"""Who may look at a model between two steps of its training, let it wait, and end it early."""

from pathlib import Path
from typing import Protocol, runtime_checkable

from plnerf.render.system import RadianceSystem
from plnerf.scene.scene import Scene
from plnerf.train.config import RunConfig


@runtime_checkable
class Visitor(Protocol):
    """Is called by the thread that trains.  `close` follows `begin`, come what may."""

    def begin(self, config: RunConfig, folder: Path, scene: Scene, model: RadianceSystem) -> None: ...

    def between_steps(self, step: int) -> bool:
        """After so many steps; whether to go on.  The time that it takes counts against no budget."""
        ...

    def close(self) -> None: ...


class Nobody:
    """Lets a run train to its end."""

    def begin(self, config: RunConfig, folder: Path, scene: Scene, model: RadianceSystem) -> None:
        """Does nothing."""

    def between_steps(self, step: int) -> bool:
        """Goes on."""
        return True

    def close(self) -> None:
        """Does nothing."""


NOBODY = Nobody()
