"""Whether a corridor of LiDAR tiles in blocks is the same as one cloud, and what it takes.

    python benchmarks/corridor_clouds.py TILE.laz OUT [--copies 2 4 8] [--whole 4] [--block-m 1000]

Makes tiles of one tile: copies side by side along its longer side, each with noise of its own (1 cm, seed 0),
so that the line of one goes on in the next with a jump.  Surveys each count in blocks, in a process of its
own, and one of them as a single cloud as well.  Prints time and peak memory of each, how far the wires of
blocks and of the single cloud are apart, and how many points have other classes.  OUT is written anew where
tiles are absent.
"""

import argparse
import os
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import laspy
import numpy as np

from plnerf.line.files import SURVEY_FILE, read_survey
from plnerf.line.survey import Survey

NOISE_M = 0.01


def make_tiles(tile: Path, folder: Path, copies: int) -> None:
    """Copies of a tile in a row."""
    folder.mkdir(parents=True, exist_ok=True)
    las = laspy.read(tile)
    low, high = las.header.mins, las.header.maxs
    axis = int(np.argmax(high[:2] - low[:2]))
    step, xyz, random = high[axis] - low[axis], np.array(las.xyz), np.random.default_rng(0)
    for k in range(copies):
        path = folder / f"{k:03d}.laz"
        moved = xyz + random.normal(0, NOISE_M, xyz.shape)
        moved[:, axis] += k * step
        if not path.exists():
            las.x, las.y, las.z = moved.T
            las.write(path)


def one_cloud(folder: Path, copies: int, path: Path) -> None:
    """The first tiles as one file."""
    parts = [laspy.read(folder / f"{k:03d}.laz") for k in range(copies)]
    header = laspy.LasHeader(version="1.4", point_format=parts[0].header.point_format)
    header.scales, header.offsets, header.vlrs = (
        parts[0].header.scales, parts[0].header.offsets, parts[0].header.vlrs,
    )  # fmt: skip
    header.global_encoding = parts[0].header.global_encoding
    with laspy.open(path, mode="w", header=header) as writer:
        for part in parts:
            part.points.change_scaling(header.scales, header.offsets)
            writer.write_points(part.points)


def measured(*arguments: str) -> tuple[float, float]:
    """Seconds and peak resident memory in MB of a command of plnerf."""
    begin = time.monotonic()
    process = subprocess.Popen([sys.executable, "-m", "plnerf", *arguments], stdout=subprocess.DEVNULL)
    _, status, used = os.wait4(process.pid, 0)
    if status:
        sys.exit(f"plnerf {' '.join(arguments)} ended with status {status}")
    return time.monotonic() - begin, used.ru_maxrss / 1e3


def compare(blocks: Survey, whole: Survey) -> None:
    """Prints how many wires of one are in the other, and how far they are apart."""
    ends = np.array([
        blocks.frame.to_world(wire.points(np.array([0.0, wire.base.length_m]))) for wire in blocks.wires
    ])  # fmt: skip
    apart, sags = [], []
    for wire in whole.wires:
        at = whole.frame.to_world(wire.points(np.array([0.0, wire.base.length_m])))
        off = np.minimum(np.abs(ends - at).max((1, 2)), np.abs(ends - at[::-1]).max((1, 2)))
        apart.append(float(off.min()))
        other = blocks.wires[int(off.argmin())]
        if wire.sag is not None and other.sag is not None and off.min() < 1.0:
            sags.append(abs(wire.sag.value - other.sag.value))
    largest = f", largest {1e6 * np.max(sags):.2f} um" if sags else ""
    print(
        f"wires: {len(whole.wires)} of one cloud, {len(blocks.wires)} of blocks; ends apart: median "
        f"{1e6 * np.median(apart):.2f} um, largest {1e6 * np.max(apart):.2f} um; sags of {len(sags)}{largest}"
    )


def compare_classes(blocks: Path, whole: Path) -> None:
    """Prints whether both have the same points, and how many have another class."""
    mine, its = (
        classes_of(paths) for paths in (sorted(blocks.glob("*/survey/cloud.laz")), [whole / "cloud.laz"])
    )
    if mine.shape != its.shape or (mine[:, :3] != its[:, :3]).any():
        print(f"points: {len(its):,} of one cloud and {len(mine):,} of blocks are not the same")
    else:
        print(f"points: {len(its):,} of both, {(mine[:, 3] != its[:, 3]).sum():,} with another class")


def classes_of(paths: Sequence[Path]) -> np.ndarray:
    """Places in millimetres and class of all points, in their order."""
    parts = []
    for path in paths:
        las = laspy.read(path)
        parts.append(np.column_stack([np.round(1e3 * las.xyz), las.classification]).astype(np.int64))
    rows = np.concatenate(parts)
    return rows[np.lexsort(rows.T[::-1])]


def main() -> None:
    """See the top of the file."""
    parser = argparse.ArgumentParser()
    parser.add_argument("tile", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--copies", type=int, nargs="+", default=[2, 4, 8])
    parser.add_argument("--whole", type=int, default=4)
    parser.add_argument("--block-m", type=float, default=1000.0)
    given = parser.parse_args()
    for copies in given.copies:
        tiles, out = given.out / f"tiles-{copies}", given.out / f"blocks-{copies}"
        make_tiles(given.tile, tiles, copies)
        options = ("--block-m", str(given.block_m))
        seconds, peak_mb = measured("corridor", str(tiles), "-o", str(out), *options)
        found = read_survey(out / SURVEY_FILE)
        print(
            f"{copies} tiles in blocks: {seconds:.0f} s, {peak_mb:,.0f} MB, {len(found.spans)} spans, "
            f"{len(found.structures)} structures, {len(found.wires)} wires",
            flush=True,
        )
        if copies != given.whole:
            continue
        one = given.out / "whole.laz"
        one_cloud(tiles, copies, one)
        seconds, peak_mb = measured("survey", str(one), "-o", str(given.out / "whole"))
        print(f"{copies} tiles as one cloud: {seconds:.0f} s, {peak_mb:,.0f} MB", flush=True)
        compare(found, read_survey(given.out / "whole" / SURVEY_FILE))
        compare_classes(out / "clouds", given.out / "whole")


if __name__ == "__main__":
    main()
