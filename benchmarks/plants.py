"""How far the plants of surveys are from where their leaves are nearest to a wire:
`python benchmarks/plants.py SURVEY TRUTH [SURVEY TRUTH ...]`.

SURVEY is a survey's folder, TRUTH the truth.json of the scene that it is of.  Of each plant that images show
(`observable` in the truth), the points of vegetation within its crown and 0.3 m beside it are compared with
the true conductor that it is nearest to: their least distance less the true one, above 0 where the plant is
found too far.  Plants with fewer than 50 points are not counted.  Prints every plant within NEAR_M, and the
median and the greatest error of each kind.
"""

import argparse
import json
from collections import defaultdict
from pathlib import Path

import laspy
import numpy as np
from scipy.spatial import cKDTree

from plnerf.export.exports import LAS
from plnerf.line.cloud import HIGH_VEGETATION, LOW_VEGETATION, VEGETATION
from plnerf.survey.config_ground import ClearanceConfig

NEAR_M, BESIDE_M, LEAST_POINTS, FINE_M = 12.0, 0.3, 50, 0.03


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("pairs", nargs="+", type=Path, metavar="SURVEY TRUTH")
    options = parser.parse_args()
    if len(options.pairs) % 2:
        parser.error("Give a truth.json after each survey.")
    errors = defaultdict(list)
    for folder, truth in zip(options.pairs[::2], options.pairs[1::2], strict=True):
        for kind, error in compare(folder, json.loads(truth.read_text(encoding="utf-8"))):
            errors[kind].append(error)
    for kind, of_kind in errors.items():
        median, least, most = np.median(of_kind), min(of_kind), max(of_kind)
        print(f"{kind}: {len(of_kind)}, median {median:+.2f} m, {least:+.2f} to {most:+.2f} m")


def compare(folder: Path, truth: dict) -> list[tuple[str, float]]:
    """Kind and error of each plant, which it prints."""
    las = laspy.read(folder / LAS)
    counts = np.isin(np.asarray(las.classification), (LOW_VEGETATION, VEGETATION, HIGH_VEGETATION))
    counts &= np.asarray(las["sigma"]) <= ClearanceConfig().obstacles.max_sigma_m
    points = np.stack([las.x, las.y, las.z], 1)[counts]
    wires = {
        one["name"]: (cKDTree(_fine(np.array(one["polyline"]))), one["diameter_m"] / 2)
        for one in truth["conductors"]
    }
    in_plan, found = cKDTree(points[:, :2]), []
    for plant in truth["vegetation"]:
        if not plant.get("observable") or plant["clearance_m"] > NEAR_M:
            continue
        here = in_plan.query_ball_point(plant["foot"][:2], plant["radius_m"] + BESIDE_M)
        if len(here) < LEAST_POINTS:
            continue
        wire, radius = wires[plant["nearest_conductor"]]
        error = float(wire.query(points[here])[0].min()) - radius - plant["clearance_m"]
        print(
            f"{folder}: {plant['kind']} {plant['height_m']:.1f} m high, {plant['clearance_m']:.2f} m from "
            f"{plant['nearest_conductor']}: {error:+.2f} m, {len(here)} points"
        )
        found.append((plant["kind"], error))
    return found


def _fine(line: np.ndarray) -> np.ndarray:
    """A polyline's points and more between them."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    at = np.linspace(0.0, along[-1], int(along[-1] / FINE_M) + 2)
    return np.stack([np.interp(at, along, x) for x in line.T], 1)


if __name__ == "__main__":
    main()
