"""Wires drawn into pictures: wires, cameras to both sides of them, and scenes in memory.

The scenes are metric and at scale 1: their LineFrame is their scene frame.
"""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import torch

from plnerf.line.base import Base
from plnerf.line.ends import Evidence, Open
from plnerf.line.frame import LineFrame
from plnerf.line.wire import Wire
from plnerf.scene.cameras import Cameras, project
from plnerf.scene.images import ImageStore
from plnerf.scene.scene import Scene
from plnerf.scene.transforms import Frames

WIDTH, HEIGHT, FOCAL = 240, 180, 150.0
HALF = 0.9
"""Of the span's length."""
FRAMES = Frames(np.eye(3), 1.0, np.zeros(3), "m", None, "file")
FRAME = LineFrame.of_scene(FRAMES)
BOX = np.array([[-HALF, -0.16, -0.12], [HALF, 0.16, 0.14]])


class InMemory:
    """Pictures in memory."""

    has_masks = False

    def __init__(self, pictures: list[np.ndarray]) -> None:
        self.pictures = pictures

    def image(self, i: int) -> np.ndarray:
        return self.pictures[i]

    def valid(self, i: int) -> np.ndarray:
        return np.ones(self.pictures[i].shape[:2], np.bool_)


def hanging(
    y: float, z: float, sag: float = 0.04, *, askew: float = 0.0, climb: float = 0.0, reach: float = 0.02
) -> Wire:
    """A wire from end to end of the box, `sag` below its chord: what a search finds, and certain."""
    theta = [y - askew * HALF, y + askew * HALF, z - climb * HALF, z + climb * HALF, sag, 0.0]
    evidence = Evidence("a drawing", 1, reach_m=reach)
    base = Base(np.array([-HALF, 0.0]), np.array([HALF, 0.0]))
    known = np.diag([0.001**2] * 5 + [0.0])
    return Wire(1, base, np.array(theta), known, (Open("drawn"), Open("drawn")), evidence)


def resized(wire: Wire, factor: float) -> Wire:
    """The wire with all lengths times a factor, as in a frame of another unit."""
    assert wire.evidence.reach_m is not None
    units = np.array([factor] * 5 + [1.0])
    return replace(
        wire,
        base=Base(factor * wire.base.a, factor * wire.base.b),
        theta=units * wire.theta,
        covariance=np.outer(units, units) * wire.covariance,
        evidence=replace(wire.evidence, reach_m=factor * wire.evidence.reach_m),
    )


def uncertain(wire: Wire) -> Wire:
    """The same wire, its place not fixed by the views."""
    return replace(wire, evidence=replace(wire.evidence, certain=False))


def at_x(wire: Wire, x: np.ndarray) -> np.ndarray:
    """Points at x of a wire that runs along x."""
    return wire.points(x - wire.base.a[0])


def pinhole_cameras(centres: np.ndarray, targets: np.ndarray) -> Cameras:
    """Level cameras that look from centres to targets."""
    forward = (targets - centres) / np.linalg.norm(targets - centres, axis=1, keepdims=True)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    axes = np.stack([right, np.cross(forward, right), forward], axis=2)
    n = len(centres)
    return Cameras(
        torch.from_numpy(axes).float(),
        torch.from_numpy(centres).float(),
        torch.full((n, 2), FOCAL),
        torch.tensor([[WIDTH / 2, HEIGHT / 2]]).repeat(n, 1),
        torch.zeros(n, 5),
        torch.tensor([[WIDTH, HEIGHT]]).repeat(n, 1),
    )


def two_passes(count: int = 8, distance: float = 0.45, wobble: float = 0.1) -> Cameras:
    """A pass to either side of the span, looking at its middle line, weaving up and down by `wobble`.

    From a track that is straight, all views of a wire along it lie in one plane: two such tracks see nine
    crossings of the planes of three wires.
    """
    x = np.linspace(-0.75, 0.75, count)
    weave = wobble * np.tile([-1.0, 1.0, 0.3], count)[:count]
    sides = [(-distance, 0.05 + weave), (distance, 0.2 - weave)]
    centres = np.concatenate([np.stack([x, 0 * x + y, z], 1) for y, z in sides])
    return pinhole_cameras(centres, np.stack([centres[:, 0], 0 * centres[:, 0], 0 * centres[:, 0]], 1))


def draw(
    cameras: Cameras,
    lines: list[np.ndarray],
    *,
    seed: int = 0,
    colour: int = 30,
    thick: int = 2,
    noise: float = 4.0,
) -> list[np.ndarray]:
    """What cameras see of polylines (scene frame) before a noisy, slowly changing background."""
    rng = np.random.default_rng(seed)
    pictures = []
    seen = [project(cameras, torch.from_numpy(line).float()) for line in lines]
    for i in range(len(cameras)):
        w, h = (int(side) for side in cameras.size_px[i])
        ground = 150 + 25 * np.sin(np.arange(h) / 40 + i)[:, None] + 15 * np.cos(np.arange(w) / 55)[None]
        picture = np.ascontiguousarray(ground.astype(np.uint8))
        for pixels, depths in seen:
            at, ahead = pixels[i].double().numpy() - 0.5, depths[i].numpy() > 0.02
            for k in np.flatnonzero(ahead[1:] & ahead[:-1]):
                if (np.abs(at[k : k + 2]) < 4000).all():
                    a, b = (tuple(int(v) for v in np.round(16 * at[j])) for j in (k, k + 1))
                    cv2.line(picture, a, b, colour, thick, cv2.LINE_AA, 4)
        picture = np.clip(picture + rng.normal(0, noise, picture.shape), 0, 255).astype(np.uint8)
        pictures.append(np.repeat(picture[..., None], 3, -1))
    return pictures


def scene_of(folder: Path, cameras: Cameras, pictures: list[np.ndarray], box: np.ndarray = BOX) -> Scene:
    """A scene of these pictures, all but the last for training."""
    folder.mkdir(parents=True, exist_ok=True)
    np.concatenate([picture.reshape(-1, 3) for picture in pictures]).tofile(folder / "images.u8")
    n = len(cameras)
    images = ImageStore(folder, cameras.size_px.numpy())
    return Scene(
        root=folder,
        names=tuple(f"{i:04d}.png" for i in range(n)),
        cameras=cameras,
        frames=FRAMES,
        box=box,
        images=images,
        photos=images,
        photo_sizes_px=cameras.size_px.numpy(),
        train=tuple(range(n)),
        test=(n - 1,),
        wire_masks={},
        depths={},
        truth=None,
        format="nerfstudio",
        left_out=(),
    )


def polyline(wire: Wire, count: int = 400) -> np.ndarray:
    return wire.points(np.linspace(0.0, wire.base.length_m, count))
