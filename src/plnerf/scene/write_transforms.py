"""A listing as transforms.json, with nerfstudio's keys and ours under `plnerf`."""

import json
from collections.abc import Mapping
from pathlib import Path

from plnerf.scene.files import write_text
from plnerf.scene.listing import Intrinsics, Listing
from plnerf.scene.transforms import flip_camera_axes

FORMAT_VERSION = 1


def write_transforms(listing: Listing, path: Path, ours: Mapping[str, object] | None = None) -> None:
    """Writes the images, poses and intrinsics; `ours` are further keys under `plnerf`.

    Images are named from the folder of `path`.  Intrinsics stand at the top where all images share them.
    """
    lenses = {shot.intrinsics for shot in listing.shots}
    shared = lenses.pop() if len(lenses) == 1 else None
    frames = []
    for shot in listing.shots:
        frame: dict[str, object] = {
            "file_path": shot.name,
            "transform_matrix": flip_camera_axes(shot.T_world_camera).tolist(),
        }
        if shot.mask is not None:
            frame["mask_path"] = shot.mask.relative_to(listing.root).as_posix()
        frames.append(frame if shared else {**frame, **_lens(shot.intrinsics)})
    section: dict[str, object] = {"format_version": FORMAT_VERSION, "unit": listing.unit, "crs": listing.crs}
    vectors = {"up": listing.up, "origin_lon_lat_height": listing.origin}
    for key, vector in vectors.items():
        if vector is not None:
            section[key] = vector.tolist()
    content = {
        "camera_model": "OPENCV",
        **(_lens(shared) if shared else {}),
        "plnerf": {**section, **(ours or {})},
        "frames": frames,
    }
    write_text(path, json.dumps(content, indent=1, allow_nan=False) + "\n")


def _lens(lens: Intrinsics) -> dict[str, object]:
    names = ("k1", "k2", "p1", "p2", "k3")
    return {
        "w": lens.width, "h": lens.height, "fl_x": lens.fl_x, "fl_y": lens.fl_y, "cx": lens.cx, "cy": lens.cy,
        **dict(zip(names, lens.distortion, strict=True)),
    }  # fmt: skip
