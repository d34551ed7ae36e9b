"""Detected wires that are kept in a file, for whoever needs them of the same images, poses and settings."""

import hashlib
import json
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from plnerf.detect.config import DetectConfig
from plnerf.detect.detect import Progress, detect_wires
from plnerf.errors import PlnerfError
from plnerf.line.files import read_wires, write_wires
from plnerf.line.frame import LineFrame
from plnerf.line.wire import Wire
from plnerf.scene.scene import Scene
from plnerf.scene.strict_json import read_json

KEY = "fingerprint"
"""In the settings of the file: of the scene, the settings, the program's version."""


@dataclass(frozen=True)
class KeptWires:
    """`detect_wires` of one scene; its result is read from a file where that is of the same inputs."""

    path: Path
    scene_sha256: str
    """Fingerprint of all that decides what the scene shows: `listing_sha256`."""

    def __call__(
        self, scene: Scene, config: DetectConfig, progress: Progress | None = None
    ) -> tuple[Wire, ...]:
        """The wires of the scene in its LineFrame, to the last bit the same whether read or detected.

        Detects them, and writes the file, where it is absent, damaged or of other inputs.  Errors as of
        `detect_wires`; raises PlnerfError where the file cannot be written.
        """
        frame, settings = LineFrame.of_scene(scene.frames), self._settings(config, scene)
        if self._written_with(settings):
            wires, written = read_wires(self.path)
            if written.same_as(frame):
                return wires
        wires = detect_wires(scene, config, progress)
        write_wires(self.path, wires, frame, settings)
        return wires

    def readable(self) -> bool:
        """Whether the file is whole, or not there at all."""
        if not self.path.exists():
            return True
        try:
            read_wires(self.path)
        except PlnerfError:
            return False
        return True

    def _settings(self, config: DetectConfig, scene: Scene) -> dict[str, Any]:
        plain: dict[str, Any] = json.loads(json.dumps(asdict(config), default=str))
        cameras = scene.cameras  # their poses may have been adjusted
        poses = [part.tolist() for part in (cameras.R_scene_camera, cameras.centre)]
        whole = json.dumps([self.scene_sha256, poses, plain, version("plnerf")])
        return plain | {KEY: hashlib.sha256(whole.encode()).hexdigest()}

    def _written_with(self, settings: dict[str, Any]) -> bool:
        if not self.path.exists() or not self.readable():
            return False
        content = read_json(self.path, PlnerfError, "Remove it.")
        found = content.get("settings") if isinstance(content, dict) else None
        return isinstance(found, dict) and found.get(KEY) == settings[KEY]
