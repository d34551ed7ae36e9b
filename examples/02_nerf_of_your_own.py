"""A NeRF of your own from plnerf's parts, whole: rays, encoding, network, rendering sum, training loop.

python examples/02_nerf_of_your_own.py OUT.png [--scene SCENE] [--quick]

This is NeRF 2020 with one network and even, jittered samples; what the presets add to it (proposals, hash
tables, contraction, wires) is in `plnerf/render/model.py`.
"""

import argparse
from pathlib import Path

import torch
from PIL import Image
from torch import Tensor

import plnerf
from plnerf.field.encodings import positional_encoding
from plnerf.field.networks import mlp
from plnerf.pipeline import bundled_span
from plnerf.rays.rays import Rays, pixel_rays
from plnerf.rays.stepfun import even_edges
from plnerf.render.volume import composite, weights_from_density

NEAR, FAR, SAMPLES = 0.05, 3.0, 48  # in units of the scene frame, in which the cameras are some 1 away
GENERATOR = torch.Generator().manual_seed(0)


class MyNeRF(torch.nn.Module):
    """A position becomes density and a feature vector; with the direction, that becomes a colour."""

    def __init__(self) -> None:
        super().__init__()
        self.trunk = mlp([6 * 8, 96, 96, 1 + 32], GENERATOR)
        self.head = mlp([32 + 6 * 4, 64, 3], GENERATOR)

    def forward(self, rays: Rays, jitter: torch.Generator | None = None) -> Tensor:
        """Colours of rays: sum of w_i c_i.  NeRF 2020, eq. 3."""
        t = NEAR + (FAR - NEAR) * even_edges(len(rays), SAMPLES, jitter, rays.origins)
        middle = (t[:, 1:] + t[:, :-1]) / 2
        x = rays.origins[:, None] + middle[..., None] * rays.directions[:, None]
        out = self.trunk(positional_encoding(x / 2, 8))
        density, feature = torch.nn.functional.softplus(out[..., 0] - 1), out[..., 1:]
        view = positional_encoding(rays.directions, 4)[:, None].expand(-1, SAMPLES, -1)
        colours = torch.sigmoid(self.head(torch.cat([feature, view], -1)))
        w = weights_from_density(density, t)
        return composite(w, colours) + (1 - w.sum(-1, keepdim=True)) * colours[:, -1]  # the sky


def main(scene_folder: Path, out: Path, steps: int, downscale: int) -> float:
    """Trains on the scene and writes a held-out view beside its photo; returns the view's PSNR in dB."""
    scene = plnerf.load_scene(scene_folder, downscale=downscale)
    width, height = scene.cameras.size_px[0].tolist()
    photos = torch.stack([torch.from_numpy(scene.images.image(i).copy()) for i in range(len(scene.names))])
    train, i = torch.tensor(scene.train), scene.test[0]
    nerf = MyNeRF()
    optimizer = torch.optim.Adam(nerf.parameters(), lr=2e-3)
    for step in range(steps):
        camera = train[torch.randint(len(train), (512,), generator=GENERATOR)]
        pixel = torch.rand(512, 2, generator=GENERATOR) * torch.tensor([width, height])
        truth = photos[camera, pixel[:, 1].long(), pixel[:, 0].long()] / 255
        rays = pixel_rays(scene.cameras, camera, pixel.floor() + 0.5)
        loss = (nerf(rays, GENERATOR) - truth).square().mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        if step % 50 == 0:
            print(f"step {step:4d}: {-10 * loss.log10().item():.1f} dB")
    rows, columns = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
    pixels = torch.stack([columns, rows], -1).reshape(-1, 2) + 0.5
    with torch.no_grad():
        seen = torch.cat([
            nerf(pixel_rays(scene.cameras, torch.full((len(p),), i), p)) for p in pixels.split(1024)
        ])
    view, photo = seen.reshape(height, width, 3), photos[i] / 255
    out.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray((torch.cat([view, photo], 1) * 255).round().byte().numpy()).save(out)
    psnr_db = -10 * (view - photo).square().mean().log10().item()
    print(f"held-out {scene.names[i]}: {psnr_db:.2f} dB; rendered and photo: {out}")
    return psnr_db


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--scene", type=Path, default=bundled_span())
    parser.add_argument("--quick", action="store_true", help="small images and few steps")
    args = parser.parse_args()
    main(args.scene, args.out, *((60, 8) if args.quick else (2000, 4)))
