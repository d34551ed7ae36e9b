"""`plnerf train --view`: a server that shows a field while it is trained, and ends with it."""

import time
from collections.abc import Callable
from pathlib import Path

from plnerf.render.system import RadianceSystem
from plnerf.scene.scene import Scene
from plnerf.train.config import RunConfig
from plnerf.train.report import RunLog
from plnerf.train.run import TrainedRun
from plnerf.train.scene_record import SceneRecord
from plnerf.view.opened import open_training
from plnerf.view.server import ViewServer
from plnerf.view.training_progress import TrainingProgress

RENEW_S = 3.0
"""Between two pictures of a field in training, as long as the camera rests."""


class WatchedTraining:
    """A `Visitor`.  Nothing is rendered as long as no browser is connected."""

    def __init__(self, log: RunLog, say: Callable[[str], None], port: int | None = None) -> None:
        """log: of the same run.  say: prints a line.  port: None: 8080 or the next that is free."""
        self._log, self._say, self._port = log, say, port
        self._server: ViewServer | None = None
        self._progress: TrainingProgress | None = None
        self._folder = Path()
        self._renew_at = 0.0

    def begin(self, config: RunConfig, folder: Path, scene: Scene, model: RadianceSystem) -> None:
        """Starts the server and prints its address."""
        run = TrainedRun(folder, config, SceneRecord.of(scene), model, 0, 0.0)
        opened = open_training(run)
        for note in opened.notes:
            self._say(note)
        self._folder, self._progress = folder, TrainingProgress(config, self._log)
        self._server = ViewServer(opened, port=self._port, progress=self._progress)
        self._say(f"Open {self._server.address} in a browser to watch.")

    def between_steps(self, step: int) -> bool:
        """Renders what browsers wait for; whether none of them has stopped the training."""
        assert self._server is not None and self._progress is not None
        self._progress.note(step)
        if self._server.watched and time.monotonic() >= self._renew_at:
            self._server.renew()
            self._renew_at = time.monotonic() + RENEW_S
        return self._progress.turns.between_steps()

    def close(self) -> None:
        """Ends the server."""
        if self._progress is not None:
            self._progress.turns.end()
            if self._progress.turns.stopped:
                self._say(
                    f"Stopped in the browser at step {self._progress.step}. Go on: plnerf train "
                    f"{self._progress.config.scene} -o {self._folder} --resume"
                )
        if self._server is not None:
            self._server.stop()
