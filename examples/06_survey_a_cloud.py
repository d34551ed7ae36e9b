"""Survey a point cloud: wires as catenaries with their sags, structures, clearances, a report.

python examples/06_survey_a_cloud.py OUT [--cloud CLOUD.laz]

Without a cloud, one is made: two spans of three wires over poles, in the coordinates of EPSG:28992, as an
airborne laser scanner would measure them.
"""

import argparse
from itertools import pairwise
from pathlib import Path

import laspy
import numpy as np
from pyproj import CRS

import plnerf

FEET = np.array([[0.0, 0.0], [110.0, 0.0], [230.0, 4.0]])
"""Of the poles."""
ORIGIN = np.array([155_000.0, 463_000.0, 0.0])


def make_cloud(path: Path, sigma_m: float = 0.02) -> Path:
    """Wires of parameter p = 900 m, 12 m above flat ground, on poles with crossarms."""
    random = np.random.default_rng(0)
    parts = [np.column_stack([random.uniform([-10, -25], [240, 25], (40_000, 2)), np.zeros(40_000)])]
    for a, b in pairwise(FEET):
        span, s = float(np.linalg.norm(b - a)), np.linspace(0, 1, 800)
        along = (b - a) / span
        for offset in (-2.0, 0.0, 2.0):
            side = offset * np.array([-along[1], along[0]])
            z = 12 + 900 * (np.cosh(span * (s - 0.5) / 900) - np.cosh(span / 1800))
            parts.append(np.column_stack([a + s[:, None] * (b - a) + side, z]))
    for foot in FEET:
        pole = np.column_stack([np.tile(foot, (400, 1)), np.linspace(0, 12.3, 400)])
        arm = np.column_stack([
            np.full(120, foot[0]),
            foot[1] + np.linspace(-2.2, 2.2, 120),
            np.full(120, 12.2),
        ])
        parts += [pole, arm]
    xyz = np.concatenate(parts) + ORIGIN
    xyz += random.normal(0, sigma_m, xyz.shape)
    las = laspy.create(point_format=6, file_version="1.4")
    las.header.add_crs(CRS.from_epsg(28992))
    las.header.offsets, las.header.scales = ORIGIN, [0.001] * 3
    las.x, las.y, las.z = xyz.T
    path.parent.mkdir(parents=True, exist_ok=True)
    las.write(path)
    return path


def main(cloud_path: Path, out: Path) -> None:
    """Prints every wire, and writes the survey."""
    cloud = plnerf.read_cloud(cloud_path)
    survey = plnerf.survey_cloud(cloud)
    for line in survey.lines:
        for span in line.spans:
            for wire in span.wires:
                sag = f"sag {wire.sag.value:.2f} ± {wire.sag.half_95:.2f} m" if wire.sag else wire.open
                print(f"span {span.id}, wire {wire.id} ({wire.kind}): {sag}, {wire.evidence.source}")
    print(f"{len(survey.structures)} structures, {len(survey.wires)} wires")
    print(f"report: {plnerf.write_survey(survey, out)}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--cloud", type=Path, help="LAS or LAZ in metres; its classes are not used")
    args = parser.parse_args()
    main(args.cloud or make_cloud(args.out / "made.laz"), args.out)
