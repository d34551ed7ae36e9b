r"""The race on a CPU against 3D Gaussian splatting: OpenSplat and plnerf in turn, for equal wall clock.

    python benchmarks/race_splats.py --opensplat BUILD/opensplat --scene src/plnerf/data/span -o RACE

OpenSplat (AGPL-3.0) is a program of its own, built for the CPU; nothing of it is linked or kept.  Both have
the scene's true poses and every 8th image held out.  It begins with points that pycolmap triangulates with
these poses, whose seconds count for neither.  plnerf trains for --seconds, of which its search for wires is a
part; how long its whole process took is OpenSplat's time, of which the last that it saved counts.  It trains
at the photos' size from the start (--num-downscales 0).  A held-out image is rendered by itself after ten
more steps, which it takes for that.

Over the held-out images: PSNR, SSIM, PSNR in the wires' masks.  Wires: the share of the true conductors
within 10 cm of a wire of plnerf's, or of the centre of a Gaussian with opacity above 0.5.  Photos that are
distorted are undistorted first, for both.  About 11 minutes a scene and round at the default of 240 s.
"""

import argparse
import json
import os
import re
import shutil
import statistics
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pycolmap
from scipy.spatial import cKDTree

from plnerf.bench.machine import circumstances
from plnerf.scene.scene import Scene, load_scene
from plnerf.survey.posed_photos import photos_of
from plnerf.train.evaluate import measure
from plnerf.train.metrics import Lpips
from plnerf.train.run import open_run

HELD_OUT_EVERY, SAVE_EVERY, RENDER_EVERY = 8, 10, 10
NEAR_M, OPAQUE, STEP_M = 0.10, 0.5, 0.05
OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])
FIGURES = ("psnr_db", "ssim", "wire_psnr_db")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--opensplat", type=Path, required=True, help="its program")
    parser.add_argument("--scene", type=Path, nargs="+", required=True, help="folders with transforms.json")
    parser.add_argument("-o", "--out", type=Path, required=True, help="new folder for race.json and the runs")
    parser.add_argument("--seconds", type=float, default=240.0, help="of plnerf's training (240)")
    parser.add_argument("--preset", default="pl-nerf-wire", help="of plnerf (pl-nerf-wire)")
    parser.add_argument("--downscale", type=int, default=1, help="of photos that are undistorted (1)")
    parser.add_argument("--rounds", type=int, default=1, help="runs of each on each scene (1)")
    options = parser.parse_args()
    options.out.mkdir(parents=True)
    rows: list[dict[str, Any]] = []
    for given in options.scene:
        folder = undistorted(given, options.out / given.name / "scene", options.downscale)
        points = points_of(folder, options.out / given.name / "points")
        for k in range(options.rounds):
            out = options.out / given.name / str(k)
            rows.append({"scene": given.name, "round": k, **ours(folder, out / "run", options)})
            print(rows[-1], flush=True)
            peer = theirs(options.opensplat, folder, points, out / "opensplat", rows[-1]["wall_s"])
            rows.append({"scene": given.name, "round": k, **peer})
            print(rows[-1], flush=True)
            text = json.dumps({**circumstances("cpu"), "rows": rows}, indent=1)
            (options.out / "race.json").write_text(text + "\n", encoding="utf-8")


def ours(folder: Path, out: Path, options: argparse.Namespace) -> dict[str, Any]:
    """What `plnerf train` makes of a scene."""
    command = [sys.executable, "-m", "plnerf.cli.main"]
    load, begin = os.getloadavg(), time.perf_counter()
    train = ["train", str(folder), "-o", str(out), "--preset", options.preset, "--device", "cpu"]
    _run([*command, *train, "--seconds", str(options.seconds)], out.with_suffix(".log"))
    wall_s = time.perf_counter() - begin
    _run([*command, "eval", str(out)], out.with_suffix(".eval.log"))
    mean = json.loads((out / "eval" / "metrics.json").read_text())["mean"]
    run = open_run(out)
    frame = photos_of(run.scene).frame
    wires = [wire for wire in run.wires or () if wire.evidence.certain]
    at = [
        frame.to_world(wire.points(np.arange(0.0, wire.base.length_m, STEP_M / 2 / frame.scale)))
        for wire in wires
    ]
    places = np.concatenate([np.zeros((0, 3)), *at])
    figures = {key: mean.get(key) for key in FIGURES}
    return {"who": "plnerf", "wall_s": wall_s, "load": load, **figures, **recall(folder, places)}


def theirs(program: Path, folder: Path, points: Path, out: Path, wall_s: float) -> dict[str, Any]:
    """What OpenSplat makes of a scene in so many seconds."""
    out.mkdir(parents=True)
    names = [frame["file_path"] for frame in _transforms(folder)["frames"]]
    held_out = sorted(names)[::HELD_OUT_EVERY]
    train = [name for name in names if name not in held_out]
    _opensplat_scene(folder, points, out / "train", train)
    ply, log, load = out / "splats.ply", out / "train.log", os.getloadavg()
    command = [str(program), str(out / "train"), "--cpu", "--num-downscales", "0"]
    command += ["-o", str(ply)]
    with log.open("w") as output:
        more = ["-n", "30000", "--save-every", str(SAVE_EVERY)]
        process = subprocess.Popen([*command, *more], stdout=output, stderr=output, env=_environment())
        time.sleep(wall_s)
        process.terminate()
        process.wait()
    saved = max(out.glob("splats_*.ply"), key=_steps)
    scene, scores = replace(load_scene(folder), depths={}), []
    for name in held_out:
        one = _opensplat_scene(folder, points, out / "held_out", [*train, name])
        last = _steps(saved) // RENDER_EVERY * RENDER_EVERY + RENDER_EVERY
        command[1] = str(one)
        more = ["-n", str(last), "--resume", str(saved), "--val-image", Path(name).name]
        _run([*command, *more, "--val-render", str(out / "renders" / Path(name).stem)], out / "held_out.log")
        scores.append(_score(scene, name, out / "renders" / Path(name).stem / f"{last}.png"))
    every = {key: [one[key] for one in scores if one[key] is not None] for key in FIGURES}
    figures = {key: statistics.mean(values) if values else None for key, values in every.items()}
    splats = _read_ply(saved)
    opaque = 1 / (1 + np.exp(-splats["opacity"])) > OPAQUE
    places = np.column_stack([splats[axis] for axis in "xyz"])[opaque]
    made = {"steps": _steps(saved), "gaussians": len(splats)}
    return {"who": "OpenSplat", "wall_s": wall_s, "load": load, **figures, **recall(folder, places), **made}


def recall(folder: Path, places: np.ndarray) -> dict[str, Any]:
    """The share of the scene's true conductors, all of their length, that has a place near it."""
    truth = folder / "truth.json"
    if not truth.exists():
        return {"wires_found": None}
    near, total = 0, 0
    for one in json.loads(truth.read_text())["conductors"]:
        line = np.array(one["polyline"])
        s = np.concatenate([[0.0], np.linalg.norm(np.diff(line, axis=0), axis=1).cumsum()])
        at = np.arange(0.0, s[-1], STEP_M)
        line = np.column_stack([np.interp(at, s, line[:, axis]) for axis in range(3)])
        total += len(line)
        if len(places):
            near += int((cKDTree(places).query(line)[0] <= NEAR_M).sum())
    return {"wires_found": near / total}


def undistorted(folder: Path, out: Path, downscale: int) -> Path:
    """The folder itself, or one whose photos have no distortion, smaller by the factor."""
    t = _transforms(folder)
    distortion = np.array([t.get(key, 0.0) for key in ("k1", "k2", "p1", "p2")])
    if not distortion.any() and downscale == 1:
        return folder
    (out / "images").mkdir(parents=True)
    K = np.array([[t["fl_x"], 0, t["cx"]], [0, t["fl_y"], t["cy"]], [0, 0, 1.0]])
    size = int(t["w"]), int(t["h"])
    new, (x, y, w, h) = cv2.getOptimalNewCameraMatrix(K, distortion, size, 0.0)
    w, h = w // downscale * downscale, h // downscale * downscale
    frames = []
    for frame in t["frames"]:
        photo = cv2.imread(str(folder / frame["file_path"]))
        if photo is None:
            continue
        photo = cv2.undistort(photo, K, distortion, None, new)[y : y + h, x : x + w]
        name = f"images/{Path(frame['file_path']).stem}.png"
        small = cv2.resize(photo, (w // downscale, h // downscale), interpolation=cv2.INTER_AREA)
        cv2.imwrite(str(out / name), small)
        frames.append({"file_path": name, "transform_matrix": frame["transform_matrix"]})
    lens = {
        "fl_x": new[0, 0] / downscale, "fl_y": new[1, 1] / downscale, "cx": (new[0, 2] - x) / downscale,
        "cy": (new[1, 2] - y) / downscale, "w": w // downscale, "h": h // downscale,
    }  # fmt: skip
    content = {"camera_model": "PINHOLE", **lens, "frames": frames}
    (out / "transforms.json").write_text(json.dumps(content))
    return out


def points_of(folder: Path, out: Path) -> Path:
    """Points that pycolmap triangulates from the training images with the true poses, as PLY."""
    out.mkdir(parents=True)
    t = _transforms(folder)
    pose = {frame["file_path"]: np.array(frame["transform_matrix"]) for frame in t["frames"]}
    train = [name for k, name in enumerate(sorted(pose)) if k % HELD_OUT_EVERY]
    lens = [t[key] for key in ("fl_x", "fl_y", "cx", "cy")]
    reader = pycolmap.ImageReaderOptions()
    reader.camera_model, reader.camera_params = "PINHOLE", ",".join(map(str, lens))
    mode = pycolmap.CameraMode.SINGLE
    database = out / "points.db"
    pycolmap.extract_features(database, folder, image_names=train, camera_mode=mode, reader_options=reader)
    pycolmap.match_exhaustive(database)
    scene = pycolmap.Reconstruction()
    camera = pycolmap.Camera(model="PINHOLE", width=t["w"], height=t["h"], params=lens, camera_id=1)
    scene.add_camera_with_trivial_rig(camera)
    ids = {one.name: one.image_id for one in pycolmap.Database.open(str(database)).read_all_images()}
    for name in train:
        R, move = np.split(np.linalg.inv(pose[name] @ OPENGL)[:3], [3], axis=1)
        image = pycolmap.Image(name=name, camera_id=1, image_id=ids[name])
        scene.add_image_with_trivial_frame(image, pycolmap.Rigid3d(pycolmap.Rotation3d(R), move[:, 0]))
    found = pycolmap.triangulate_points(scene, database, folder, out).points3D.values()
    names = "".join(f"property float {axis}\n" for axis in "xyz")
    names += "".join(f"property uchar {colour}\n" for colour in ("red", "green", "blue"))
    lines = "".join("{:f} {:f} {:f} {} {} {}\n".format(*one.xyz, *one.color) for one in found)
    head = f"ply\nformat ascii 1.0\nelement vertex {len(found)}\n{names}end_header\n"
    (out / "points.ply").write_text(head + lines)
    return out / "points.ply"


def _opensplat_scene(folder: Path, points: Path, out: Path, names: list[str]) -> Path:
    """A scene of some of the images."""
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    (out / "images").symlink_to((folder / "images").resolve())
    shutil.copy(points, out / points.name)
    t = _transforms(folder)
    frames = [
        {"file_path": one["file_path"], "transform_matrix": one["transform_matrix"]}
        for one in t["frames"]
        if one["file_path"] in names
    ]
    lens = {key: t[key] for key in ("fl_x", "fl_y", "cx", "cy", "w", "h")}
    content = {"camera_model": "OPENCV", **lens, "ply_file_path": points.name, "frames": frames}
    (out / "transforms.json").write_text(json.dumps(content))
    return out


def _score(scene: Scene, name: str, render: Path) -> dict[str, Any]:
    """The figures of one held-out image."""
    i = next(k for k in scene.test if Path(scene.names[k]).stem == Path(name).stem)
    picture = cv2.imread(str(render))
    assert picture is not None
    view: Any = SimpleNamespace(rgb=picture[..., ::-1].astype(np.float32) / 255)
    score = measure(view, scene, i, Lpips())
    return {key: getattr(score, key) for key in FIGURES}


def _read_ply(path: Path) -> np.ndarray:
    """The vertices of a binary PLY whose properties are all of type float."""
    data = path.read_bytes()
    end = data.index(b"end_header\n") + len(b"end_header\n")
    head = data[:end].decode()
    names = re.findall(r"property float (\w+)", head)
    count = int(re.search(r"element vertex (\d+)", head)[1])  # type: ignore[index]
    return np.frombuffer(data, [(name, "<f4") for name in names], count, end)


def _steps(path: Path) -> int:
    return int(path.stem.rsplit("_", 1)[1])


def _transforms(folder: Path) -> dict[str, Any]:
    content: dict[str, Any] = json.loads((folder / "transforms.json").read_text())
    return content


def _environment() -> dict[str, str]:
    """With torch's libraries, which OpenSplat is linked with."""
    import torch

    return {**os.environ, "LD_LIBRARY_PATH": str(Path(torch.__file__).parent / "lib")}


def _run(command: list[str], log: Path) -> None:
    log.parent.mkdir(parents=True, exist_ok=True)
    with log.open("a") as output:
        subprocess.run(command, stdout=output, stderr=output, check=True, env=_environment())


if __name__ == "__main__":
    main()
