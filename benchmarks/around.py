"""A scene of what stands around one place: only the pixels around it are learnt, in all photos that show it.

    plnerf capture PHOTOS -o SCENE
    python benchmarks/around.py SCENE -o POLE --at EAST NORTH UP [--radius 24] [--held-out IMG_0509.jpg]
    plnerf train POLE -o RUN --preset nerfacto --steps 16000 ...

A field of a whole flight spends its pixels on fields and roads; a support is a few thousandths of them.
"""

import json
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import torch
import tyro
from PIL import Image, ImageDraw

from plnerf.render.picture_files import write_text
from plnerf.scene.cameras import project
from plnerf.scene.formats import read_listing
from plnerf.scene.orientation import frames_for
from plnerf.scene.scene import load_scene

LEAST_SHARE = 0.02
"""Of a photo, how much the circle must fill."""


@dataclass(frozen=True)
class Arguments:
    """Photos and masks of a circle on the ground."""

    scene: tyro.conf.Positional[Path]
    """A posed scene with a transforms.json."""
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """Folder to write."""
    at: tuple[float, float, float]
    """Middle of the circle, on the ground, in the scene's world."""
    radius: float = 24.0
    """Of the circle, in the world's unit."""
    held_out: str | None = None
    """A photo that is not trained on."""


def main(arguments: Arguments) -> None:
    """Writes the scene."""
    data = json.loads((arguments.scene / "transforms.json").read_text())
    scene = load_scene(arguments.scene, store=arguments.out / "pixels")
    at, angle = np.array(arguments.at), np.linspace(0, 2 * np.pi, 72, endpoint=False)
    circle = at + arguments.radius * np.stack([np.cos(angle), np.sin(angle), 0 * angle], 1)
    pixels, depths = project(scene.cameras, torch.from_numpy(scene.frames.to_scene(circle)).float())
    kept = []
    for frame in data["frames"]:
        i = scene.names.index(frame["file_path"])
        width, height = (int(v) for v in scene.cameras.size_px[i])
        mask = Image.new("L", (width, height), 0)
        if (depths[i] > 0).all():
            ImageDraw.Draw(mask).polygon([(float(u), float(v)) for u, v in pixels[i]], fill=255)
        share = float((np.asarray(mask) > 0).mean())
        if share < LEAST_SHARE:
            continue
        photo, name = arguments.out / frame["file_path"], f"masks/{Path(frame['file_path']).stem}.png"
        for path in (photo, arguments.out / name):
            path.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(arguments.scene / frame["file_path"], photo)
        mask.save(arguments.out / name)
        kept.append({**frame, "mask_path": name})
        print(f"{frame['file_path']}: {100 * share:.0f} % of it")
    names = [frame["file_path"] for frame in kept]
    held = [name for name in names if Path(name).name == arguments.held_out]
    ours = {key: value for key, value in data.get("plnerf", {}).items() if key != "order"}
    data |= {"plnerf": ours, "frames": kept}
    if held:
        data |= {"train_filenames": [name for name in names if name not in held], "val_filenames": held}
    write_text(arguments.out / "transforms.json", json.dumps(data, indent=1))
    print(f"{len(kept)} of {len(scene.names)} photos: {arguments.out}")
    listing = read_listing(arguments.out)
    poses = np.stack([shot.T_world_camera for shot in listing.shots])
    frames = frames_for(poses, up=listing.up, unit=listing.unit, crs=listing.crs)
    away = np.linalg.norm(frames.to_scene(poses[:, :3, 3]) - frames.to_scene(at), axis=1)
    print(
        f"In its scene frame the circle's radius is {frames.length_to_scene(arguments.radius):.3g}, and "
        f"the cameras are {away.min():.3g} to {away.max():.3g} from its middle: choose near and far by them."
    )


if __name__ == "__main__":
    main(tyro.cli(Arguments))
