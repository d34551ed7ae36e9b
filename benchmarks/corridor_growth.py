"""Whether the time and memory of `plnerf corridor` grow with the number of spans, and what a kilometre takes.

    python benchmarks/corridor_growth.py SCENE OUT [--spans 8] [--parts 1 2 4 8] [--block-m 150]
        [--overlap-m 50]

SCENE has so many spans (`plnerf synth OUT --scene long`: 8).  For each part the first images along the
cameras' way, as large a share of it as the part is of the spans, are a scene of their own, by reference, and
are surveyed by `plnerf corridor` in a process of its own, with one thread.  What OUT holds already is not
done again.  Prints images, spans and wires, processor time, peak memory and size on disk of each part, with a
straight line fitted to the times, and writes OUT/growth.json and OUT/growth.svg.  Processor time is that of
all cores together, so that other programs of the machine count little.
"""

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np

from plnerf.corridor.block_scene import write_block_scene
from plnerf.corridor.config import CutConfig
from plnerf.corridor.cut import cut
from plnerf.scene.formats import read_listing
from plnerf.scene.orientation import frames_for
from plnerf.scene.scene import split

GREY, BLUE, RED = "#bbb", "#1b6ca8", "#d1495b"
WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM = 640, 360, 70, 560, 24, 300
ONE_M = 1.0
"""Length of the blocks that give the order of the images."""


def along_the_way(places: np.ndarray) -> np.ndarray:
    """Images in the order of their cameras' stations."""
    return np.concatenate([block.core for block in cut(places, CutConfig(block_m=ONE_M))])


def write_part(source: Path, folder: Path, share: float) -> int:
    """The scene of the first images along the way; returns their number."""
    listing = read_listing(source)
    poses = np.stack([shot.T_world_camera for shot in listing.shots])
    frames = frames_for(poses, up=listing.up, unit=listing.unit, crs=listing.crs, origin=listing.origin)
    order = along_the_way(poses[:, :2, 3])
    images = order[: round(share * len(order))]
    held_out = frozenset(listing.shots[k].name for k in split(listing)[1])
    write_block_scene(listing, images, frames.up_world, held_out, folder)
    return len(images)


def survey(scene: Path, out: Path, options: list[str]) -> dict[str, float]:
    """Surveys a part; what it took, as its records say, whether it was done now or before."""
    env = os.environ | dict.fromkeys(("OMP_NUM_THREADS", "NUMBA_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    command = [sys.executable, "-m", "plnerf", "corridor", str(scene), "-o", str(out), *options]
    ended = subprocess.run(command, stdout=subprocess.DEVNULL, env=env, check=False)
    if ended.returncode:
        sys.exit(f"The corridor of {scene} ended with status {ended.returncode}.")
    state = json.loads((out / "corridor.json").read_text())
    files = [path.stat().st_size for path in out.rglob("*") if path.is_file()]
    return {
        "spans": state["spans"], "wires": state["wires"], "processor_seconds": state["processor_seconds"],
        "seconds": state["seconds"], "peak_mb": max(one["peak_mb"] for one in state["records"]),
        "disk_mb": sum(files) / 1e6,
    }  # fmt: skip


def drawing(rows: list[dict[str, float]], slope: float, at_none: float) -> str:
    """Processor time (blue, with its line) and peak memory (red) by images."""
    most = max(row["images"] for row in rows)
    top_s = 1.1 * max(row["processor_seconds"] for row in rows)
    top_mb = 1.4 * max(row["peak_mb"] for row in rows)  # so that the two last dots are apart

    def place(images: float, share: float) -> tuple[float, float]:
        return LEFT + (RIGHT - LEFT) * images / (1.05 * most), BOTTOM - (BOTTOM - TOP) * share

    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" '
        'font-family="sans-serif" font-size="13" role="img">',
        f'<rect width="{WIDTH}" height="{HEIGHT}" fill="white"/>',
    ]
    for k in range(5):
        x, y = place(0, k / 4)
        parts.append(f'<line x1="{x}" y1="{y}" x2="{RIGHT}" y2="{y}" stroke="#eee"/>')
        for text, colour, at, anchor in (
            (f"{top_s * k / 4:,.0f} s", BLUE, LEFT - 6, "end"),
            (f"{top_mb * k / 4:,.0f} MB", RED, RIGHT + 6, "start"),
        ):
            parts.append(f'<text x="{at}" y="{y + 4}" fill="{colour}" text-anchor="{anchor}">{text}</text>')
    (x1, y1), (x2, y2) = (place(n, (at_none + slope * n) / top_s) for n in (rows[0]["images"], most))
    parts.append(f'<line x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}" stroke="{GREY}"/>')
    for row in rows:
        for share, colour in ((row["processor_seconds"] / top_s, BLUE), (row["peak_mb"] / top_mb, RED)):
            x, y = place(row["images"], share)
            parts.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="5" fill="{colour}"/>')
        x, _ = place(row["images"], 0)
        label = f"{row['images']:.0f} ({row['spans']:.0f})"
        parts.append(
            f'<text x="{x:.1f}" y="{BOTTOM + 20}" text-anchor="middle" font-size="11">{label}</text>'
        )
    middle = (LEFT + RIGHT) / 2
    parts.append(f'<text x="{middle}" y="{HEIGHT - 10}" text-anchor="middle">images (spans)</text>')
    parts.append(f'<text x="{LEFT}" y="{HEIGHT - 10}" fill="{BLUE}">processor time</text>')
    parts.append(f'<text x="{RIGHT}" y="{HEIGHT - 10}" fill="{RED}" text-anchor="end">peak memory</text>')
    return "\n".join([*parts, "</svg>"])


def main() -> None:
    """See the top of the file."""
    parser = argparse.ArgumentParser()
    parser.add_argument("scene", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--spans", type=int, default=8)
    parser.add_argument("--parts", type=int, nargs="+", default=[1, 2, 4, 8])
    parser.add_argument("--block-m", default="150")
    parser.add_argument("--overlap-m", default="50")
    given = parser.parse_args()
    options = ["--block-m", given.block_m, "--overlap-m", given.overlap_m]
    rows: list[dict[str, float]] = []
    for part in given.parts:
        count = write_part(given.scene, given.out / f"scene-{part}", part / given.spans)
        took = survey(given.out / f"scene-{part}", given.out / f"part-{part}", options)
        rows.append({"part": part, "images": count, **took})
        print(
            f"{count} images: {took['spans']} spans, {took['wires']} wires; "
            f"{took['processor_seconds']:,.0f} s of processor, {took['processor_seconds'] / count:.2f} each; "
            f"peak {took['peak_mb']:,.0f} MB, {took['disk_mb']:,.0f} MB on disk",
            flush=True,
        )
    slope, at_none = np.polyfit([r["images"] for r in rows], [r["processor_seconds"] for r in rows], 1)
    off = max(abs(at_none + slope * r["images"] - r["processor_seconds"]) for r in rows)
    print(f"{at_none:.0f} s and {slope:.2f} s an image; off that line by {off:.0f} s at most")
    (given.out / "growth.json").write_text(json.dumps(rows, indent=1) + "\n")
    (given.out / "growth.svg").write_text(drawing(rows, slope, at_none) + "\n")


if __name__ == "__main__":
    main()
