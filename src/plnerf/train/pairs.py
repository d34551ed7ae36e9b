"""Pixels drawn with a neighbour, for a loss on the differences between neighbours: edges and thin lines.

With the axis and the parity of pairs drawn at random, "the other pixel of its pair" takes every pixel to
another one and back.  A neighbour therefore has the importance of the pixel it was drawn with, and means over
pixels, neighbours or both are those over all pixels, whatever pixels were preferred.
"""

import torch
from jaxtyping import Float
from torch import Generator, Tensor

from plnerf.train.pixels import PixelBatch, PixelSampler


def draw_pairs(sampler: PixelSampler, rays: int, generator: Generator) -> PixelBatch:
    """Half of the rays as the sampler draws them and, in the same order, the neighbour of each.

    Rounded up to an even number.  A pixel at the border of its image or beside an ignored one may stand
    alone: it is its own neighbour.
    """
    first = sampler.draw((rays + 1) // 2, generator)
    store, count = sampler.store, len(first.camera)
    axis = torch.randint(2, (count, 1), generator=generator)
    parity = torch.randint(2, (count, 1), generator=generator)
    sizes, starts = torch.from_numpy(store.sizes_px).long()[first.camera], torch.from_numpy(store.starts)
    pixel = first.pixel_px.long()
    place = pixel.gather(1, axis)
    other = place + 1 - 2 * ((place + parity) % 2)
    inside = (other >= 0) & (other < sizes.gather(1, axis))
    neighbour = pixel.scatter(1, axis, torch.where(inside, other, place))
    flat, alone = (
        starts[first.camera] + pixel_px[:, 1] * sizes[:, 0] + pixel_px[:, 0]
        for pixel_px in (neighbour, pixel)
    )
    flat = torch.where(store.valid_flat(flat), flat, alone)
    camera, pixel_px = store.locate(flat)
    return PixelBatch(
        torch.cat([first.camera, camera]),
        torch.cat([first.pixel_px, pixel_px]),
        torch.cat([first.colour, store.colours(flat)]),
        first.importance.repeat(2),
    )


def edge_loss(error: Float[Tensor, "r 3"], importance: Float[Tensor, " r"]) -> Float[Tensor, ""]:
    """Mean squared error of the colour differences of pairs, given the errors of the colours.

    It is large where an edge is blurred or a line is missing, and blind to a level that is wrong all over.
    """
    first, second = error.chunk(2)
    return (importance[: len(first), None] * (first - second) ** 2).mean()
