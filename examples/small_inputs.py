"""Small inputs for the examples, made of what comes with plnerf: nothing is downloaded."""

import json
import shutil
from pathlib import Path

import plnerf.pipeline


def few_photos(out: Path, every: int) -> Path:
    """A scene folder with every fourth (fifth, ...) photo of the bundled span."""
    span = plnerf.pipeline.bundled_span()
    listing = json.loads((span / "transforms.json").read_text())
    listing["frames"] = listing["frames"][::every]
    listing["plnerf"].pop("truth")
    for frame in listing["frames"]:
        frame.pop("wire_mask_path")
        frame.pop("depth_path", None)
        photo = out / frame["file_path"]
        photo.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(span / frame["file_path"], photo)
    (out / "transforms.json").write_text(json.dumps(listing))
    return out
