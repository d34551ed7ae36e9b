"""Random numbers of the rays of a batch, also where several processes share the batch.

A process that renders every n-th ray of a batch draws the numbers of all of its rays and keeps those of its
own: whichever process renders a ray, the ray's samples are the same.
"""

import torch
from jaxtyping import Float
from torch import Generator, Tensor


class SharedGenerator(Generator):
    """The generator of a process that has every `of`-th ray of a batch, from the ray `first` on."""

    first: int
    of: int

    def __new__(cls, device: torch.device, first: int, of: int) -> "SharedGenerator":
        """device: on which the numbers are drawn; first, of: as above."""
        made = super().__new__(cls, device)  # type: ignore[call-arg]  # of which torch declares none
        made.first, made.of = first, of
        return made

    def __init__(self, device: torch.device, first: int, of: int) -> None:
        """See `__new__`."""


def ray_jitter(
    rays: int, count: int, generator: Generator, like: Float[Tensor, "..."]
) -> Float[Tensor, "{rays} {count}"]:
    """Uniform random numbers in [0, 1), `count` for each of these rays; of the type of `like`, beside it."""
    first, of = (generator.first, generator.of) if isinstance(generator, SharedGenerator) else (0, 1)
    drawn = torch.rand(rays * of, count, generator=generator, dtype=like.dtype, device=like.device)
    return drawn if of == 1 else drawn[first::of].contiguous()
