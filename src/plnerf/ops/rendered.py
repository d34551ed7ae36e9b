"""What the rendering sum returns, on any backend."""

from typing import NamedTuple

from jaxtyping import Float
from torch import Tensor


class Rendered(NamedTuple):
    """Weights, colours and depths of r rays with S intervals; the depths carry no gradient."""

    w: Float[Tensor, "r S"]
    colour: Float[Tensor, "r 3"]
    accumulation: Float[Tensor, " r"]
    depth: Float[Tensor, " r"]
    """Expected distance."""
    depth_median: Float[Tensor, " r"]
