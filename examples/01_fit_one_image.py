"""Fit one image with a multi-resolution hash encoding and a small network: Instant-NGP's first picture.

python examples/01_fit_one_image.py OUT.png [--image PHOTO] [--quick]

A pixel's place, in [0, 1]^2, is encoded as the features of the grid cells around it, level by level; a
network of one hidden layer makes a colour of them.  Table and network are trained together, on random pixels.
"""

import argparse
from pathlib import Path

import numpy as np
import torch
from PIL import Image

from plnerf.field.hashgrid import HashGrid
from plnerf.field.networks import mlp
from plnerf.ops.grid import GridShape
from plnerf.pipeline import bundled_span


def main(out: Path, image: Path, steps: int, side_px: int) -> float:
    """Writes what was learnt; returns its PSNR in dB."""
    with Image.open(image) as photo:
        photo.thumbnail((side_px, side_px))
        truth = torch.from_numpy(np.array(photo.convert("RGB"))).float() / 255
    h, w, _ = truth.shape
    generator = torch.Generator().manual_seed(0)
    shape = GridShape(levels=8, coarsest=8, finest=max(h, w), features=4, log2_table=14)
    grid = HashGrid(shape, "torch", generator)
    network = mlp([shape.width, 64, 3], generator)
    optimizer = torch.optim.Adam([*grid.parameters(), *network.parameters()], lr=1e-2)

    def colour(row: torch.Tensor, column: torch.Tensor) -> torch.Tensor:
        """Colours in [0, 1] of pixel centres; the third coordinate of the grid stays in its middle."""
        unit = torch.stack([(column + 0.5) / w, (row + 0.5) / h, torch.full_like(row, 0.5)], -1)
        return torch.sigmoid(network(grid(unit)))

    for step in range(steps):
        row = torch.randint(h, (2048,), generator=generator)
        column = torch.randint(w, (2048,), generator=generator)
        loss = (colour(row.float(), column.float()) - truth[row, column]).square().mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        if step % 50 == 0:
            print(f"step {step:4d}: {-10 * loss.log10().item():.1f} dB")
    with torch.no_grad():
        rows, columns = torch.meshgrid(torch.arange(h), torch.arange(w), indexing="ij")
        learnt = colour(rows.flatten().float(), columns.flatten().float()).reshape(h, w, 3)
    out.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray((learnt * 255).round().byte().numpy()).save(out)
    psnr_db = -10 * (learnt - truth).square().mean().log10().item()
    print(f"{psnr_db:.2f} dB with {sum(p.numel() for p in grid.parameters()):,} numbers in the table: {out}")
    return psnr_db


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--image", type=Path, default=bundled_span() / "images" / "0000.jpg")
    parser.add_argument("--quick", action="store_true", help="a small image and few steps")
    args = parser.parse_args()
    main(args.out, args.image, *((120, 96) if args.quick else (1000, 480)))
