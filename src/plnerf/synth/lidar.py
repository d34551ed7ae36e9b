"""A simulated LiDAR flight over a span: the cloud as a LAZ file, and truth.json with what is exactly where.

The points carry nothing but their places: no class, no return's number.  World frame, metres, z up.
"""

import json
from collections.abc import Mapping
from pathlib import Path

import laspy
import numpy as np
from jaxtyping import Float
from scipy.spatial import cKDTree

from plnerf.line.wire import Wire
from plnerf.scene.files import write_text
from plnerf.synth.lidar_bodies import Bodies, hung, lidar_site, still_bodies
from plnerf.synth.lidar_config import LidarScene
from plnerf.synth.lidar_scan import scan
from plnerf.synth.site import Site

CLOUD = "cloud.laz"
POLYLINE_EVERY = 5
GROUND_STEP_M = 2.0


def simulate_lidar(out: Path, scene: LidarScene) -> Path:
    """Writes cloud.laz, and truth.json last, into the folder `out`, which returns; the same scene gives
    the same files.

    Raises ConfigError where the scene cannot stand.
    """
    site, rng = lidar_site(scene), np.random.default_rng([scene.span.seed, 29])
    still, bodies = still_bodies(site, scene, rng)
    points, strip = scan(site, scene, still, rng)
    out.mkdir(parents=True, exist_ok=True)
    _write_cloud(out / CLOUD, points, strip)
    write_text(out / "truth.json", json.dumps(lidar_truth(site, scene, bodies)) + "\n")
    return out


def lidar_truth(site: Site, scene: LidarScene, bodies: Bodies) -> dict[str, object]:
    """The content of truth.json: as for filmed scenes, with the main span's wires as they hang on average
    over the strips, and of each the least distances of its axis in `clearances`."""
    line = site.lines[0]
    trees = {
        name: cKDTree(at) if len(at) else None
        for name, at in (
            ("vegetation", bodies.leaves), ("building", bodies.buildings), ("structure", bodies.boom)
        )
    }  # fmt: skip
    return {
        "format_version": 1,
        "scene": scene.name,
        "world": "local, metres, z up, origin on the ground at mid-span",
        "clearance_rule": "least distances between structures: `ground` straight down, the others in space",
        "conductors": [_conductor(site, wire, scene, trees) for wire in line.spans[1].wires],
        "towers": [
            {"name": tower.name, "foot": tower.foot, "height_m": tower.height_m,
             "attachments": tower.attachments, "structure": tower.config.kind}
            for tower in line.towers[1:3]
        ],
    }  # fmt: skip


def _conductor(
    site: Site, wire: Wire, scene: LidarScene, trees: Mapping[str, cKDTree | None]
) -> dict[str, object]:
    axis = hung(wire, scene, None)
    ground = site.ground.heights(axis[:, 0], axis[:, 1])
    return {
        "name": wire.name,
        "kind": wire.kind,
        "diameter_m": wire.diameter_m,
        "a": axis[0].tolist(),
        "b": axis[-1].tolist(),
        "polyline": np.round(_thinned(axis), 5).tolist(),
        "clearances": {
            "ground": float((axis[:, 2] - ground).min()),
            **{name: tree and float(tree.query(axis)[0].min()) for name, tree in trees.items()},
        },
    }


def _thinned(axis: Float[np.ndarray, "v 3"]) -> Float[np.ndarray, "w 3"]:
    return axis[np.r_[0 : len(axis) - 1 : POLYLINE_EVERY, len(axis) - 1]]


def _write_cloud(path: Path, points: Float[np.ndarray, "n 3"], strip: np.ndarray) -> None:
    header = laspy.LasHeader(version="1.4", point_format=6)
    header.scales, header.offsets = np.full(3, 0.001), np.floor(points.min(0))
    las = laspy.LasData(header)
    las.x, las.y, las.z = points.T
    las.point_source_id = strip + 1
    las.write(str(path))
