"""`plnerf synth`: one span of known geometry, filmed, as a scene folder with its exact truth.

Folder: images/NNNN.jpg, wire_masks/NNNN.png, depth/NNNN.png (held-out images only), transforms.json,
truth.json.
"""

import json
import re
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from jaxtyping import Float
from PIL import Image

from plnerf.errors import SceneError
from plnerf.synth.capture import View, plan_flight
from plnerf.synth.config import CaptureConfig, SceneConfig
from plnerf.synth.parts import span_parts
from plnerf.synth.render import Studio, open_studio, require_mitsuba
from plnerf.synth.span import Span, build_span
from plnerf.synth.truth import MASK_COVERAGE, truth_of

HOLD_OUT_EVERY = 8  # the scene folder's default rule: every 8th by name is held out


def synthesize(
    out: Path, config: SceneConfig | None = None, *, progress: Callable[[int, int], None] | None = None
) -> Path:
    """Render a span into the new scene folder `out` and return it.

    `progress(done, total)` is called after each image.  Raises ConfigError when Mitsuba is missing and
    SceneError when `out` is there already and is not an empty folder.
    """
    config = config or SceneConfig()
    if out.exists() and not (out.is_dir() and not any(out.iterdir())):
        raise SceneError(f"plnerf synth makes a new folder, but {out} exists and is not empty. Name another.")
    require_mitsuba()
    out.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=f".{out.name}-", dir=out.parent) as scratch:
        folder = Path(scratch) / "scene"
        for name in ("images", "wire_masks", "depth", "meshes"):
            (folder / name).mkdir(parents=True)
        span = build_span(config.span)
        views = plan_flight(span, config.capture)
        studio = open_studio(list(span_parts(span)), config.capture, config.image, folder / "meshes")
        shutil.rmtree(folder / "meshes")
        for i, view in enumerate(views):
            _film(studio, view, i, folder)
            if progress is not None:
                progress(i + 1, len(views))
        _write_json(folder / "truth.json", truth_of(span, config, len(views)))
        _write_json(folder / "transforms.json", transforms_of(span, config.capture, views))
        if out.exists():
            out.rmdir()
        folder.rename(out)
    return out


def transforms_of(span: Span, capture: CaptureConfig, views: tuple[View, ...]) -> dict[str, object]:
    """The content of transforms.json: nerfstudio's keys, and ours under `plnerf`."""
    low, high = span_box(span)
    frames: list[dict[str, object]] = []
    for i, view in enumerate(views):
        frame: dict[str, object] = {
            "file_path": f"images/{view.name}.jpg",
            "wire_mask_path": f"wire_masks/{view.name}.png",
            "transform_matrix": view.T_world_camera_opengl().tolist(),
        }
        if i % HOLD_OUT_EVERY == 0:
            frame["depth_path"] = f"depth/{view.name}.png"
        frames.append(frame)
    return {
        "camera_model": "OPENCV",
        "w": capture.width_px,
        "h": capture.height_px,
        "fl_x": capture.focal_px,
        "fl_y": capture.focal_px,
        "cx": capture.width_px / 2,
        "cy": capture.height_px / 2,
        "k1": 0.0,
        "k2": 0.0,
        "p1": 0.0,
        "p2": 0.0,
        "plnerf": {
            "format_version": 1,
            "unit": "m",
            "crs": None,
            "up": [0.0, 0.0, 1.0],
            "line_axis": [*span.along, 0.0],
            "span_min": low.tolist(),
            "span_max": high.tolist(),
            "truth": "truth.json",
        },
        "frames": frames,
    }


def span_box(span: Span) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """World box around towers, conductors and the ground below them, with 1 m to spare at the sides."""
    points = [wire.curve.polyline(0.25) for wire in span.conductors]
    for tower in span.towers:
        x, y, z = tower.foot
        points.append(np.array([[x - 1.2, y - 1.2, z], [x + 1.2, y + 1.2, z + tower.height_m]]))
    cloud = np.concatenate(points)
    margin = np.array([1.0, 1.0, 0.0])
    return cloud.min(axis=0) - margin - [0, 0, 0.5], cloud.max(axis=0) + margin + [0, 0, 0.5]


def _film(studio: Studio, view: View, index: int, folder: Path) -> None:
    photo = Image.fromarray(studio.photo(view, index))
    photo.save(
        folder / "images" / f"{view.name}.jpg",
        quality=studio.image.jpeg_quality,
        subsampling=0,
        optimize=True,
    )
    mask = np.where(studio.wire_coverage(view) >= MASK_COVERAGE, 255, 0).astype(np.uint8)
    Image.fromarray(mask).save(folder / "wire_masks" / f"{view.name}.png", optimize=True)
    if index % HOLD_OUT_EVERY == 0:
        millimetres = np.rint(1000 * studio.depth_m(view))
        stored = np.where(millimetres > 65535, 0, millimetres).astype(np.uint16)  # 16 bits end at 65.5 m
        Image.fromarray(stored).save(folder / "depth" / f"{view.name}.png", optimize=True)


def _write_json(path: Path, content: dict[str, object]) -> None:
    """Indented, but with each list of numbers on one line."""
    text = json.dumps(content, indent=1)
    text = re.sub(r"\[[-+.\deE,\s]+\]", lambda numbers: " ".join(numbers[0].split()), text)
    path.write_text(text + "\n", encoding="utf-8")
