"""Train a preset with settings of your own, evaluate it, and render a flight along the cameras.

python examples/03_train_and_render.py RUN [--scene SCENE] [--quick]

The same on the command line:
    plnerf train SCENE -o RUN --preset pl-nerf --seconds 120 --train.rays 256 --model.field.damping
    plnerf eval RUN
    plnerf render RUN --frames 24
"""

import argparse
from dataclasses import replace
from pathlib import Path

from plnerf.pipeline import bundled_span, evaluate, render, train_scene
from plnerf.presets.pl_nerf import PRESET


def main(scene: Path, run: Path, seconds: float, downscale: int, frames: int) -> None:
    """RUN gets config.json, checkpoints, eval/ and renders/."""
    model = replace(PRESET.model, field=replace(PRESET.model.field, damping=True))
    train = replace(PRESET.train, rays=256, checkpoints=2)
    train_scene(
        scene, run, preset="pl-nerf", model=model, train=train, seconds=seconds, downscale=downscale, seed=1
    )
    mean = evaluate(run, progress=lambda done, total: print(f"view {done} of {total}"))["mean"]
    print(
        f"held-out views: {mean['psnr_db']:.2f} dB, on the wires' pixels {mean['wire_psnr_db'] or 0:.2f} dB"
    )
    folder = render(run, views="path", outputs=("rgb", "depth"), frames=frames, scale=0.5, video=False)
    print(f"pictures: {folder}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("run", type=Path, help="a new folder")
    parser.add_argument("--scene", type=Path, default=bundled_span())
    parser.add_argument("--quick", action="store_true", help="a second of training on small images")
    args = parser.parse_args()
    main(args.scene, args.run, *((1.0, 8, 2) if args.quick else (120.0, 1, 24)))
