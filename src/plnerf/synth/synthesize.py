"""`plnerf synth`: lines of known geometry, filmed, as a scene folder with its exact truth.

Folder: images/NNNN.jpg, wire_masks/NNNN.png, depth/NNNN.png (held-out images only), transforms.json,
truth.json.
"""

import json
import re
import tempfile
from collections.abc import Callable
from pathlib import Path

from plnerf.errors import SceneError
from plnerf.synth.build import build_site
from plnerf.synth.capture import View, plan_flight, written_views
from plnerf.synth.check import check_cameras
from plnerf.synth.config import SceneConfig
from plnerf.synth.film import HOLD_OUT_EVERY, Studio, film
from plnerf.synth.flight_config import CaptureConfig
from plnerf.synth.near_plants import filmed_plants, near_plants
from plnerf.synth.parts import site_parts
from plnerf.synth.render import open_studio, require_mitsuba
from plnerf.synth.seen import MIN_IMAGES, observable_stretches, seen_stretches
from plnerf.synth.site import Site
from plnerf.synth.truth import Shows, truth_of


def synthesize(
    out: Path, config: SceneConfig | None = None, *, progress: Callable[[int, int], None] | None = None
) -> Path:
    """Render a scene into the new scene folder `out` and return it.

    `progress(done, total)` is called after each image.  Raises ConfigError when Mitsuba is missing and
    SceneError when `out` is there already and is not an empty folder.
    """
    config = config or SceneConfig()
    if out.exists() and not (out.is_dir() and not any(out.iterdir())):
        raise SceneError(f"plnerf synth makes a new folder, but {out} exists and is not empty. Name another.")
    require_mitsuba()
    out.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=f".{out.name}-", dir=out.parent) as scratch:
        folder, meshes = Path(scratch) / "scene", Path(scratch) / "meshes"
        meshes.mkdir()
        site = build_site(config.span)
        views = plan_flight(site, config.capture)
        check_cameras(site, views)
        studio = open_studio(list(site_parts(site)), config.capture, config.image, meshes)
        write_scene(folder, site, views, studio, config, progress)
        if out.exists():
            out.rmdir()
        folder.rename(out)
    return out


def write_scene(
    folder: Path,
    site: Site,
    views: tuple[View, ...],
    studio: Studio,
    config: SceneConfig,
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Film a site into a new folder: all that a scene folder holds, with its truth."""
    masks = film(studio, site, views, config, folder, progress)
    seen = seen_stretches(site.wires, views, masks, config.capture, site.route.stations_of)
    shows = Shows(seen, observable_stretches(site.wires, views, masks, config.capture))
    plants = filmed_plants(near_plants(site), views, studio.depth_m, config.capture)
    _write_json(folder / "truth.json", truth_of(site, config, views, plants, shows))
    written = written_views(views, config.capture, config.seed)
    _write_json(folder / "transforms.json", transforms_of(config.capture, written))


def transforms_of(capture: CaptureConfig, views: tuple[View, ...]) -> dict[str, object]:
    """The content of transforms.json: nerfstudio's keys, and ours under `plnerf`.

    Nothing in it says where the line is: what is known of that stands in truth.json.
    """
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
            "truth": "truth.json",
        },
        "frames": frames,
    }


def summary(folder: Path) -> str:
    """What a rendered scene folder holds, in a line."""
    truth = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
    content = json.loads((folder / "transforms.json").read_text(encoding="utf-8"))
    wires = truth["conductors"]
    whole = sum(wire["span_m"] for wire in wires)
    shown = sum(end - start for wire in wires for start, end in wire["seen_m"])
    held_out = sum("depth_path" in frame for frame in content["frames"])
    return (
        f"{truth['scene']}: {truth['images']} images of {content['w']} x {content['h']} px, {held_out} of "
        f"them held out; {len(wires)} conductors, {shown:.0f} of {whole:.0f} m in {MIN_IMAGES} images or more"
    )


def _write_json(path: Path, content: dict[str, object]) -> None:
    """Indented, but with each list of numbers on one line."""
    text = json.dumps(content, indent=1)
    text = re.sub(r"\[[-+.\deE,\s]+\]", lambda numbers: " ".join(numbers[0].split()), text)
    path.write_text(text + "\n", encoding="utf-8")
