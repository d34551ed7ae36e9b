"""How well wires and towers of classified LiDAR clouds are found without their classes:
`python benchmarks/lidar_wires.py CLOUD.laz [CLOUD.laz ...]`.

The classes (14 conductor, 15 tower; option --wire for another code of wires) serve for scoring alone.

recall       share of the points classified as wire within 25 cm of a found curve
precision    share of the found curves' length, sampled every 10 cm, where a point classified as wire lies
             within 25 cm across and 2.5 m along (LiDAR has a point of a wire every 0.3 to 4 m); what is
             within 3 m of a point classified as tower counts neither way
labelled     share of the points labelled wire that are classified so (those within 3 m of a tower left out),
             and share of the points classified as wire that are labelled so
towers       distance in plan of each found tower from the middle of the nearest cluster of tower points
"""

import argparse
import resource
import time
from itertools import combinations
from pathlib import Path

import laspy
import numpy as np
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from plnerf.line.cloud import CONDUCTOR, NO_WIRE, TOWER
from plnerf.line.frame import LineFrame
from plnerf.line.line import Structure
from plnerf.line.wire import Wire
from plnerf.survey.lidar.config import LidarConfig
from plnerf.survey.lidar.find import Found, find_lines
from plnerf.survey.lidar.point_cloud import read_cloud

TOLERANCE_M, STEP_M, ALONG_M, TOWER_M, BOTH_M = 0.25, 0.1, 2.5, 3.0, 5.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("clouds", nargs="+", type=Path)
    parser.add_argument("--wire", type=int, default=CONDUCTOR, help="class of wires in the file")
    options = parser.parse_args()
    for path in options.clouds:
        cloud = read_cloud(path)
        truth = np.asarray(laspy.read(path).classification)
        xyz = LineFrame.of_cloud(cloud.xyz, cloud.crs).from_world(cloud.xyz)
        wall, cpu = time.perf_counter(), time.process_time()
        found = find_lines(xyz, LidarConfig())
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
        print(f"{path.name}: {len(xyz)} points, {wall:.1f} s ({cpu:.1f} s of CPU), peak {peak:.2f} GB")
        table(found, truth == options.wire)
        score(found, truth == options.wire, truth == TOWER)


def wires_of(found: Found) -> list[Wire]:
    """All of them, line by line."""
    return [wire for line in found.lines for wire in line.wires]


def structures_of(found: Found) -> list[Structure]:
    """All of them, line by line."""
    return [structure for line in found.lines for structure in line.structures]


def table(found: Found, wire: np.ndarray) -> None:
    """One row per wire; "drop" is the greatest one below the chord of what is seen, sag only where held."""
    print(
        "  id line span kind    points  length   drop    sag +-95 %  rms across/up  cover  gap on wire  notes"
    )
    for line in found.lines:
        for span in line.spans:
            for one in span.wires:
                mine, seen = found.cloud.wire == one.id, one.evidence
                sag = "     -      -" if one.sag is None else f"{one.sag.value:6.2f} {one.sag.half_95:6.3f}"
                remarks = " ".join([one.open or "", *one.notes]).strip()
                print(
                    f"  {one.id:2d} {line.id:4d} {span.id:4d} {one.kind:6s} {seen.count:7d} "
                    f"{one.length_m:7.1f} {one.drop_between(0.0, one.base.length_m):6.2f} {sag} "
                    f"{seen.residual_across_m:6.3f} {seen.residual_up_m:6.3f} {seen.coverage:6.2f} "
                    f"{seen.longest_gap_m:5.1f} {wire[mine].mean():6.3f}   {remarks}"
                )
    for finding in found.findings:
        print(f"  {finding.degree}: {finding.text}")


def score(found: Found, wire: np.ndarray, tower: np.ndarray) -> None:
    """Figures of the whole cloud."""
    xyz, wires, structures = found.cloud.xyz, wires_of(found), structures_of(found)
    if not wires or not wire.any():
        print(f"  {wire.sum()} points are classified as wire, {len(wires)} wires found")
        return
    curves = np.concatenate([one.polyline(STEP_M) for one in wires])
    right = np.concatenate([confirmed(one, xyz[wire]) for one in wires])
    far = np.ones(len(curves), bool)
    labelled = found.cloud.wire != NO_WIRE
    counted = labelled.copy()
    if tower.any():
        towers = cKDTree(xyz[tower])
        far = towers.query(curves)[0] > TOWER_M
        counted[labelled] = towers.query(xyz[labelled])[0] > TOWER_M
    recall = (cKDTree(curves).query(xyz[wire])[0] <= TOLERANCE_M).mean()
    precision = right[far].mean()
    print(f"  recall {recall:.4f}  precision {precision:.4f}  of {wire.sum()} wire points")
    print(f"  labelled: {wire[counted].mean():.4f} right, {labelled[wire].mean():.4f} of all wire points")
    closest = min((apart(a, b) for a, b in combinations(wires, 2)), default=np.inf)
    print(f"  {len(wires)} wires in {len(found.lines)} lines, the closest two {closest:.2f} m apart")
    middles = clusters(xyz[tower]) if tower.any() else []
    print(f"  {len(structures)} structures found, {len(middles)} classified")
    for one in structures:
        off = min((float(np.hypot(*(one.foot[:2] - m[:2]))) for m in middles), default=np.inf)
        top = max((m[2] for m in middles), default=np.nan)
        print(
            f"    structure {one.id}, {one.evidence}: {off:.2f} m from the classified one, "
            f"{one.top[2] - top:+.2f} m higher"
        )
    labels = found.cloud.label == TOWER
    if tower.any() and labels.any():
        print(f"    labelled tower: {tower[labels].mean():.3f} right, {labels[tower].mean():.3f} of all")


def confirmed(wire: Wire, truth: np.ndarray) -> np.ndarray:
    """Which samples of a wire's curve have a true point beside them."""
    base, curve = wire.base, wire.polyline(STEP_M)
    local = base.local(truth)
    inside = (local[:, 0] > -ALONG_M) & (local[:, 0] < base.length_m + ALONG_M)
    local = local[inside]
    off = np.linalg.norm(local[:, 1:] - wire.at(local[:, 0]), axis=1)
    s = np.sort(local[off <= TOLERANCE_M, 0])
    if not len(s):
        return np.zeros(len(curve), bool)
    samples = base.local(curve)[:, 0]
    after = np.searchsorted(s, samples)
    before = np.abs(s[np.maximum(after - 1, 0)] - samples)
    return np.minimum(before, np.abs(s[np.minimum(after, len(s) - 1)] - samples)) <= ALONG_M


def apart(a: Wire, b: Wire) -> float:
    """Mean distance of two curves where both are, if that is for a stretch."""
    local = b.base.local(a.polyline(1.0))
    both = (local[:, 0] >= 0) & (local[:, 0] <= b.base.length_m)
    if both.sum() < BOTH_M:
        return np.inf
    return float(np.linalg.norm(local[both, 1:] - b.at(local[both, 0]), axis=1).mean())


def clusters(points: np.ndarray) -> list[np.ndarray]:
    """Middle in plan and top of each group of points that are less than 3 m apart."""
    graph = cKDTree(points).sparse_distance_matrix(cKDTree(points), TOWER_M)
    count, group = connected_components(graph, directed=False)
    parts = [points[group == k] for k in range(count)]
    return [np.append((p.min(0) + p.max(0))[:2] / 2, p[:, 2].max()) for p in parts if len(p) >= 50]


if __name__ == "__main__":
    main()
