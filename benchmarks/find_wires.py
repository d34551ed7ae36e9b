"""Which wires are detected in scenes with truth: `python benchmarks/find_wires.py SCENE [SCENE ...]`.

Poses are adjusted first, as surveys do; --given-poses leaves them as the scene states them.  A true wire is
found where a certain one lies within 10 cm of it on average.  Also printed: how much of what the truth calls
observable lies within 10 cm of a certain wire.
"""

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from plnerf.capture.adjusted_poses import with_adjusted_poses
from plnerf.capture.poses_config import PosesConfig
from plnerf.capture.similarity import Similarity
from plnerf.detect.detect import detect_wires
from plnerf.field.guides import scene_points
from plnerf.line.frame import LineFrame
from plnerf.scene.scene import load_scene
from plnerf.score.config import WireScoreConfig
from plnerf.score.observable import score_observable
from plnerf.score.truth import read_truth

CLOSE_M = 0.10


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("scenes", nargs="+", metavar="SCENE")
    parser.add_argument("--given-poses", action="store_true", help="do not adjust poses")
    options = parser.parse_args()
    for folder in options.scenes:
        with tempfile.TemporaryDirectory() as store:
            scene = load_scene(Path(folder), store=Path(store))
            if scene.truth is None:
                sys.exit(f"{folder} has no truth.json: give scenes that `plnerf synth` made.")
            start, worked = time.perf_counter(), time.process_time()
            scene, change = with_adjusted_poses(scene, PosesConfig(adjust=not options.given_poses))
            adjusting = time.perf_counter() - start
            detected = detect_wires(scene)
            seconds, worked = time.perf_counter() - start, time.process_time() - worked
        frame = LineFrame.of_scene(scene.frames)
        true = json.loads(scene.truth.read_text())["conductors"]
        axes = [frame.from_world(dense(np.array(wire["polyline"]))) for wire in true]
        found: dict[str, float] = {}
        rows = []
        for wire in detected:
            points = frame.from_scene(scene_points(wire, frame, 200))
            apart = [mean_distance(points, axis) for axis in axes]
            nearest = int(np.argmin(apart))
            name, certain = true[nearest]["name"], wire.evidence.certain
            rows.append((name, apart[nearest], wire.worst_sigma(), certain))
            if certain and apart[nearest] < CLOSE_M:
                found[name] = apart[nearest]
        poses = f"{adjusting:.1f} s of them for poses"
        many = f"{len(scene.train)} images, {worked:.1f} s of a processor"
        print(f"{folder}: {len(found)} of {len(true)} found, {seconds:.1f} s, {poses}, {many}")
        if change is not None:
            print(f"  {change.text(scene.frames.unit)}")
        truth = read_truth(scene.truth).moved(Similarity(*frame.similarity))
        certain_ones = [wire for wire in detected if wire.evidence.certain]
        shown = score_observable(certain_ones, truth, WireScoreConfig())
        if shown is not None and shown.recall is not None:
            print(f"  {shown.recall:.1%} of {shown.total_m:.1f} m that images show well")
        for name, distance, sigma, certain in rows:
            known = "" if certain else ", uncertain"
            print(f"  nearest to {name}: {distance:.3f} m on average, sigma {sigma:.3f} m{known}")


def mean_distance(points: np.ndarray, axis: np.ndarray) -> float:
    """Mean distance of a wire's points from a true axis, of those that lie beside it."""
    apart, nearest = cKDTree(axis).query(points)
    beside = (nearest > 0) & (nearest < len(axis) - 1)
    return float(apart[beside].mean()) if beside.any() else np.inf


def dense(polyline: np.ndarray, step_m: float = 0.01) -> np.ndarray:
    """A polyline with vertices so close that the nearest one is the distance."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(polyline, axis=0), axis=1))])
    places = np.arange(0.0, along[-1], step_m)
    return np.stack([np.interp(places, along, polyline[:, k]) for k in range(3)], 1)


if __name__ == "__main__":
    main()
