"""How well poses come back from a video of known poses: `python benchmarks/video_capture.py SCENE -o OUT`.

The images of a scene that `plnerf synth` made become an H.264 video in their order, one in eight of its
pictures smeared sideways as a shaken camera smears them.  `plnerf capture` makes a scene of it, and its
camera centres are compared with the true ones after the best similarity.
"""

import argparse
import json
from pathlib import Path

import cv2
import numpy as np

from plnerf.capture.capture import CaptureConfig
from plnerf.capture.similarity import fit_similarity
from plnerf.pipeline import capture_scene
from plnerf.render.write_video import write_video
from plnerf.scene.formats import read_listing

EVERY, SMEAR_PX = 8, 13


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scene", type=Path, help="scene folder with exact poses")
    parser.add_argument("-o", "--out", type=Path, required=True)
    parser.add_argument("--fps", type=float, default=12.0)
    arguments = parser.parse_args()
    truth = read_listing(arguments.scene)
    smeared = [i for i in range(len(truth.shots)) if i % EVERY == EVERY - 2]
    video, folder = arguments.out / "flight.mp4", arguments.out / "pictures"
    folder.mkdir(parents=True, exist_ok=True)
    pictures = []
    for i, shot in enumerate(truth.shots):
        picture = cv2.imread(str(shot.path))
        pictures.append(folder / f"{i:04d}.png")
        cv2.imwrite(str(pictures[-1]), cv2.blur(picture, (SMEAR_PX, 1)) if i in smeared else picture)
    write_video(video, pictures, arguments.fps)
    scene = capture_scene(video, arguments.out / "scene", CaptureConfig())
    frames = json.loads((scene / "capture.json").read_text())["frames"]
    dropped = {int(one["name"]) for one in frames if one["reason"] == "blurred"}
    print(f"smeared: {len(smeared)}, of these called blurred: {len(dropped & set(smeared))}, wrongly so: "
          f"{len(dropped - set(smeared))}")  # fmt: skip
    found = read_listing(scene)
    at = np.array([int(shot.path.stem) for shot in found.shots])
    exact = np.stack([shot.T_world_camera[:3, 3] for shot in truth.shots])
    x = np.stack([shot.T_world_camera[:3, 3] for shot in found.shots])
    off = np.linalg.norm(fit_similarity(x, exact[at])(x) - exact[at], axis=1)
    track = np.linalg.norm(np.diff(exact, axis=0), axis=1).sum()
    print(f"{len(at)} centres, median {np.median(off):.3f} m off, worst {off.max():.3f} m, track "
          f"{track:.1f} m: worst {off.max() / track:.2%} of the track")  # fmt: skip


if __name__ == "__main__":
    main()
