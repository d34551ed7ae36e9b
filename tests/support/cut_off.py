"""A folder as a command leaves it that is killed when its result is complete, and not yet in its place."""

import json
from pathlib import Path

from plnerf.scene.whole_result import COMPLETE, LIST


def cut_off(folder: Path) -> None:
    """Moves all files of a folder back to where an exchange takes them from."""
    files = [path.name for path in folder.iterdir()]
    (folder / COMPLETE).mkdir()
    for name in files:
        (folder / name).rename(folder / COMPLETE / name)
    (folder / COMPLETE / LIST).write_text(json.dumps({"patterns": [], "files": files}))
