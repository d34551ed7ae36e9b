"""What NeRF 2020's fine look gains, at equal evaluations of its networks, on a small closed scene.

    python benchmarks/coarse_fine.py -o runs/coarse-fine [--scene posts] [--steps 2000] [--width 128]

A room is drawn exactly: one with chequered walls, three balls and a thin post, or one with plain walls and
six thin posts, whose rays lie in empty space almost everywhere.  `nerf` learns it with a coarse look of so
many intervals (32) and a fine one of those and as many more, 96 evaluations a ray in all, and with one look
of as many evaluations.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import tyro
from jaxtyping import Float, UInt8
from PIL import Image
from rich.console import Console

from plnerf.cli.options import settings_from
from plnerf.console import RunConsole
from plnerf.pipeline import evaluate, train_scene
from plnerf.render.picture_files import write_text

SIZE, FINER, FOCAL, VIEWS, EVERY = 96, 3, 80.0, 48, 8
RING = 0.8
"""Radius of the cameras' ring, which is 1 in the scene frame."""
FAR = 4 / RING
"""More than the room's diagonal, in the scene frame."""


@dataclass(frozen=True)
class Room:
    """From -1 to 1, with what stands in it."""

    contrast: float
    """Of the squares on its walls."""
    balls: tuple[tuple[float, float, float, float], ...]
    """Centre and radius."""
    posts: tuple[tuple[float, float, float], ...]
    """Place on the floor and radius; they reach the ceiling."""


ROOMS = {
    "room": Room(
        0.45,
        ((0.35, 0.3, -0.75, 0.25), (-0.4, 0.1, -0.8, 0.2), (0.05, -0.45, -0.7, 0.3)),
        ((-0.15, 0.45, 0.03),),
    ),
    "posts": Room(0.0, (), tuple((0.4 * np.cos(k), 0.4 * np.sin(k), 0.02) for k in range(6))),
}


@dataclass(frozen=True)
class Arguments:
    """Coarse and fine looks against one look, at equal evaluations."""

    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """Folder for the scenes, the runs and table.md."""
    scene: Literal["room", "posts"] = "room"
    """A chequered room with balls, or an empty one with thin posts."""
    steps: int = 2000
    """Steps of each run, of 256 rays."""
    width: int = 128
    """Of the networks' layers; NeRF's own are 256."""
    intervals: int = 32
    """Of the coarse look; a third of all evaluations of a ray."""
    seeds: tuple[int, ...] = (0, 1)


def main(arguments: Arguments) -> None:
    """Trains and measures both, and writes the table."""
    scene, console = arguments.out / arguments.scene, Console()
    if not (scene / "transforms.json").exists():
        write_room(scene, ROOMS[arguments.scene])
    lines = ["| looks | seed | PSNR dB | SSIM | training s |", "| --- | ---: | ---: | ---: | ---: |"]
    for name, looks in looks_of(arguments.intervals).items():
        for seed in arguments.seeds:
            run = arguments.out / f"{name.replace(' ', '-')}-{seed}"
            if not (run / "eval/metrics.json").exists():
                settings = (
                    *looks,
                    f"--model.field.width {arguments.width}",
                    f"--model.sampler.far {FAR}",
                    f"--model.sampler.knee {FAR}",
                    "--train.rays 256",
                )
                made = settings_from("nerf", " ".join(settings))
                train_scene(
                    scene, run, preset="nerf", model=made.model, train=made.train, steps=arguments.steps,
                    seed=seed, report=RunConsole(run, console),
                )  # fmt: skip
                evaluate(run)
            metrics = json.loads((run / "eval/metrics.json").read_text())
            mean, seconds = metrics["mean"], metrics["protocol"]["training_seconds"]
            lines.append(f"| {name} | {seed} | {mean['psnr_db']:.2f} | {mean['ssim']:.3f} | {seconds:.0f} |")
    write_text(arguments.out / "table.md", "\n".join(lines) + "\n")
    print("\n".join(lines))


def looks_of(intervals: int) -> dict[str, tuple[str, ...]]:
    """Settings of the two, by their names."""
    return {
        f"{intervals} coarse, {intervals} + {intervals} fine": (
            f"--model.sampler.proposals {intervals}",
            f"--model.sampler.final {intervals}",
        ),
        f"one look of {3 * intervals}": (
            "--model.sampler.proposals ",
            f"--model.sampler.final {3 * intervals}",
            "--model.networks 1",
        ),
    }


def write_room(folder: Path, room: Room) -> None:
    """Cameras on a ring in the upper half of the room, each looking across it and down."""
    (folder / "images").mkdir(parents=True)
    frames = []
    for i in range(VIEWS):
        angle = 2 * np.pi * i / VIEWS
        centre = np.array([RING * np.cos(angle), RING * np.sin(angle), 0.25 + 0.3 * np.sin(5 * angle)])
        pose = look_at(centre, np.array([-0.2 * np.cos(angle), -0.2 * np.sin(angle), -0.5]))
        name = f"images/{i:03d}.png"
        Image.fromarray(picture(pose, room)).save(folder / name)
        opengl = pose @ np.diag([1.0, -1.0, -1.0, 1.0])
        frames.append({"file_path": name, "transform_matrix": opengl.tolist()})
    data = {
        "w": SIZE, "h": SIZE, "fl_x": FOCAL, "fl_y": FOCAL, "cx": SIZE / 2, "cy": SIZE / 2,
        "plnerf": {"format_version": 1, "unit": "m", "up": [0, 0, 1]},
        "frames": frames,
    }  # fmt: skip
    write_text(folder / "transforms.json", json.dumps(data))


def look_at(centre: Float[np.ndarray, "3"], target: Float[np.ndarray, "3"]) -> Float[np.ndarray, "4 4"]:
    """Camera to world, OpenCV axes, level."""
    z = (target - centre) / np.linalg.norm(target - centre)
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    pose = np.eye(4)
    pose[:3] = np.stack([x, np.cross(z, x), z, centre], 1)
    return pose


def picture(pose: Float[np.ndarray, "4 4"], room: Room) -> UInt8[np.ndarray, "h w 3"]:
    """What a camera sees: the mean over FINER^2 rays a pixel."""
    at = (np.arange(SIZE * FINER) + 0.5) / FINER - SIZE / 2
    x, y = np.meshgrid(at / FOCAL, at / FOCAL)
    d = np.stack([x, y, np.ones_like(x)], -1) @ pose[:3, :3].T
    colour = shade(room, pose[:3, 3], d / np.linalg.norm(d, axis=-1, keepdims=True))
    mean = colour.reshape(SIZE, FINER, SIZE, FINER, 3).mean((1, 3))
    return np.round(255 * mean).astype(np.uint8)


def shade(room: Room, o: Float[np.ndarray, "3"], d: Float[np.ndarray, "h w 3"]) -> Float[np.ndarray, "h w 3"]:
    """Colour of the nearest thing along unit directions from a point in the room."""
    t = np.where(d > 0, (1 - o) / np.maximum(d, 1e-9), (-1 - o) / np.minimum(d, -1e-9))
    side, nearest = t.argmin(-1), t.min(-1)
    at = o + nearest[..., None] * d
    squares = np.floor(4 * at + 1e-6)
    dark = (squares.sum(-1) - np.take_along_axis(squares, side[..., None], -1)[..., 0]) % 2
    walls = np.array([[0.8, 0.5, 0.4], [0.4, 0.7, 0.5], [0.5, 0.55, 0.8]])[side]
    colour = walls * (1 - room.contrast * (1 - dark))[..., None]
    for x, y, z, radius in room.balls:
        hit = first_hit(o - np.array([x, y, z]), d, radius)
        normal = (o + np.where(np.isfinite(hit), hit, 0)[..., None] * d - np.array([x, y, z])) / radius
        light = 0.6 + 0.4 * normal @ np.array([0.3, 0.4, 0.866])
        colour = np.where((hit < nearest)[..., None], light[..., None] * np.array([0.9, 0.75, 0.2]), colour)
        nearest = np.minimum(nearest, hit)
    level = np.linalg.norm(d[..., :2], axis=-1)
    flat = d[..., :2] / level[..., None].clip(1e-9)
    for x, y, radius in room.posts:
        hit = first_hit(o[:2] - np.array([x, y]), flat, radius) / level
        colour = np.where((hit < nearest)[..., None], np.array([0.1, 0.1, 0.12]), colour)
        nearest = np.minimum(nearest, hit)
    return colour


def first_hit(o: np.ndarray, d: np.ndarray, radius: float) -> np.ndarray:
    """Distance along unit directions to a ball, or in a plane to a circle, around 0; infinite for none."""
    b, c = d @ o, o @ o - radius**2
    root = b * b - c
    hit = -b - np.sqrt(np.maximum(root, 0))
    return np.where((root > 0) & (hit > 0), hit, np.inf)


if __name__ == "__main__":
    main(tyro.cli(Arguments))
