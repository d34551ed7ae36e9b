"""Ask a trained field: density on a grid, colours along rays, an image from a place where no camera was.

python examples/04_query_the_field.py RUN OUT

Everything is in world coordinates: metres and z up where the capture is georeferenced.  The photos are not
needed.  OUT gets density.npz (a horizontal slice) and view.png.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image

import plnerf


def main(folder: Path, out: Path, side: int = 64) -> None:
    """Writes density.npz and view.png."""
    out.mkdir(parents=True, exist_ok=True)
    field = plnerf.open_run(folder).field
    centres = np.array([camera.T_world_camera[:3, 3] for camera in field.cameras])
    low, high = centres.min(0), centres.max(0)

    # Density of a slice half-way between the lowest camera and 5 m below it: 1/m, or 1/world unit.
    x, y = np.meshgrid(np.linspace(low[0], high[0], side), np.linspace(low[1], high[1], side))
    grid = np.stack([x, y, np.full_like(x, low[2] - 2.5)], -1)
    sigma = field.density(grid)
    np.savez_compressed(out / "density.npz", points=grid, density=sigma)
    print(f"{sigma.size:,} points, density {sigma.min():.3g} to {sigma.max():.3g} 1/{field.unit}")

    # A ray straight down from every camera: how high did it fly?
    seen = field.along(centres, np.array([0.0, 0.0, -1.0]))
    reached = np.isfinite(seen.depth)
    if reached.any():
        height = np.median(seen.depth[reached])
        print(f"{reached.sum()} of {len(centres)} rays end, after {height:.1f} {field.unit} (median)")

    # The first camera, moved up by a tenth of the flight's extent.
    camera = field.cameras[0]
    T = camera.T_world_camera.copy()
    T[2, 3] += 0.1 * float(np.linalg.norm(high - low))
    image = field.render(replace(camera, T_world_camera=T))
    Image.fromarray((image.colour * 255).round().astype(np.uint8)).save(out / "view.png")
    print(f"{out / 'density.npz'}, {out / 'view.png'}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("run", type=Path, help="made by `plnerf train`, or by example 03")
    parser.add_argument("out", type=Path)
    args = parser.parse_args()
    main(args.run, args.out)
