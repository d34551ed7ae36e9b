"""Small inputs for the examples, made of what comes with plnerf: nothing is downloaded."""

import json
from pathlib import Path

from PIL import Image

import plnerf.pipeline


def few_photos(out: Path, every: int) -> Path:
    """A scene folder with every fourth (fifth, ...) photo of the bundled span, half as wide."""
    span = plnerf.pipeline.bundled_span()
    listing = json.loads((span / "transforms.json").read_text())
    listing["frames"] = listing["frames"][::every]
    listing["plnerf"].pop("truth")
    for name in ("fl_x", "fl_y", "cx", "cy"):
        listing[name] /= 2
    listing["w"], listing["h"] = listing["w"] // 2, listing["h"] // 2
    for frame in listing["frames"]:
        frame.pop("wire_mask_path")
        frame.pop("depth_path", None)
        photo = out / frame["file_path"]
        photo.parent.mkdir(parents=True, exist_ok=True)
        with Image.open(span / frame["file_path"]) as whole:
            whole.reduce(2).save(photo, quality=95)
    (out / "transforms.json").write_text(json.dumps(listing))
    return out
