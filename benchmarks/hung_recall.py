"""Which hung wires a survey has, in the photos: `python benchmarks/hung_recall.py SCENE HUNG AGAIN`.

SCENE: the capture that `plnerf hang SCENE -o HUNG` hung wires in; AGAIN: the capture of HUNG/images, with
AGAIN/survey.  Two structures from motion of the same photos differ in their lens, and so in how far away
everything is; where a wire is in a photo they must agree.  A true wire is drawn by the poses and the lens
that it was hung by, a surveyed one by those of its own capture.  Every half metre, or unit, of what a photo
shows of a stretch that enough photos show is found if a surveyed wire is within some pixels there.
"""

import argparse
import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from plnerf.line.files import read_survey

STEP = 0.5
PLACES = 2000


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("scene", type=Path)
    parser.add_argument("hung", type=Path)
    parser.add_argument("again", type=Path)
    parser.add_argument("--within", type=float, default=3.0, help="pixels (3)")
    given = parser.parse_args()
    truth = json.loads((given.hung / "truth.json").read_text())
    first, again = (
        json.loads((folder / "transforms.json").read_text()) for folder in (given.scene, given.again)
    )
    poses = {row["name"]: np.array(row["T_world_camera"]) for row in truth["poses"]}
    lenses = {Path(frame["file_path"]).name: first | frame for frame in first["frames"]}
    later = {Path(frame["file_path"]).name: again | frame for frame in again["frames"]}
    survey = read_survey(given.again / "survey" / "survey.json")
    curves = {
        wire.id: survey.frame.to_world(wire.points(np.linspace(0, wire.base.length_m, PLACES)))
        for wire in survey.wires
    }
    used: set[int] = set()
    print(f"{len(curves)} wires surveyed; within {given.within:g} px:")
    for wire in truth["conductors"]:
        off, near = [], []
        for image in wire["images"]:
            name = image["name"]
            places = _common(wire["seen_m"], image["seen_m"])
            if name not in later or not len(places):
                continue
            uv = _pixels(_along(np.array(wire["polyline"]), places), poses[name], lenses[name])
            lens = later[name]
            T = np.array(lens["transform_matrix"])
            drawn = {k: _pixels(points, T, lens) for k, points in curves.items()}
            apart = np.array([_distances(uv, line) for line in drawn.values()]).reshape(len(drawn), len(uv))
            off += apart.min(0, initial=np.inf).tolist()
            near += [list(drawn)[k] for k in apart.argmin(0)] if len(drawn) else []
        found = np.array(off) <= given.within
        mine = sorted({k for k, one in zip(near, found, strict=False) if one})
        used |= set(mine)
        print(
            f"{wire['name']}: {found.mean():.1%} of {len(off)} places in {len(wire['images'])} photos, "
            f"median {np.median(off):.2f} px off, by wires {mine}"
        )
    print(f"near no true wire: {sorted(set(curves) - used)}")


def _common(of: list[list[float]], seen: list[list[float]]) -> np.ndarray:
    """Places along a wire that lie in a stretch of both."""
    most = max((end for _, end in of), default=0.0)
    s = np.arange(0.0, most, STEP)
    inside = [np.any([(s >= low) & (s <= high) for low, high in some], axis=0) for some in (of, seen) if some]
    return s[inside[0] & inside[1]] if len(inside) == 2 else s[:0]


def _along(line: np.ndarray, s: np.ndarray) -> np.ndarray:
    """Places of a polyline, by the length from its first point in plan."""
    at = np.linalg.norm((line - line[0])[:, :2], axis=1)
    return np.column_stack([np.interp(s, at, line[:, k]) for k in range(3)])


def _pixels(points: np.ndarray, T_world_camera: np.ndarray, lens: dict[str, Any]) -> np.ndarray:
    """Where points of the world are in a photo; NaN behind it and far outside."""
    R = T_world_camera[:3, :3] * [1, -1, -1]  # OpenGL's axes to OpenCV's
    inside = (points - T_world_camera[:3, 3]) @ R
    K = np.array([[lens["fl_x"], 0, lens["cx"]], [0, lens["fl_y"], lens["cy"]], [0, 0, 1]], np.float64)
    distortion = np.array([lens.get(name, 0.0) for name in ("k1", "k2", "p1", "p2", "k3")])
    uv = cv2.projectPoints(inside[:, None], np.zeros(3), np.zeros(3), K, distortion)[0][:, 0]
    wild = (inside[:, 2] <= 0) | (np.abs(uv - [lens["w"] / 2, lens["h"] / 2]) > [lens["w"], lens["h"]]).any(1)
    return np.where(wild[:, None], np.nan, uv)


def _distances(uv: np.ndarray, line: np.ndarray) -> np.ndarray:
    """From places to a polyline in a photo; infinite where it is not."""
    a, b = line[:-1], line[1:]
    good = np.isfinite(a).all(1) & np.isfinite(b).all(1)
    if not good.any():
        return np.full(len(uv), np.inf)
    a, b = a[good], b[good]
    ab = b - a
    share = np.clip(((uv[:, None] - a) * ab).sum(-1) / np.maximum((ab**2).sum(-1), 1e-12), 0, 1)
    found = np.linalg.norm(uv[:, None] - a - share[..., None] * ab, axis=2).min(1)
    return np.where(np.isfinite(found), found, np.inf)


if __name__ == "__main__":
    main()
