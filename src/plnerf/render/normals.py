"""Normals of a hash field as its density says.  Ref-NeRF, section 4.

Letters: q rays, S intervals; lengths in the scene frame.
"""

from jaxtyping import Float
from torch import Tensor

from plnerf.field.radiance import RadianceField
from plnerf.rays.contraction import axis_factors, contract, pull_back
from plnerf.rays.frustums import ray_frustums
from plnerf.rays.rays import Rays

UNSTRETCHED = (1.0, 1.0, 1.0)


def density_normals(
    field: RadianceField,
    rays: Rays,
    t: Float[Tensor, "q E"],
    size: Float[Tensor, "q E-1"] | None = None,
    *,
    stretch: tuple[float, float, float] = UNSTRETCHED,
    contraction: bool = True,
) -> Float[Tensor, "q E-1 3"]:
    """n = -grad sigma / |grad sigma| in the middle of each interval.  Ref-NeRF eq. 3.

    The log density has a gradient of the same direction, without the range of exp.  size: of the frustums in
    the unit cube, where the field takes it.
    """
    mean = ray_frustums(rays, t).mean.detach()
    factors = axis_factors(stretch, mean)
    stretched = mean * factors
    bounded = contract(stretched) if contraction else stretched.clamp(-2, 2)
    gradient = field.log_density_gradient((bounded + 2) / 4, size)
    # Where space is clamped in place of contracted, nothing changes beyond the cube.
    gradient = pull_back(gradient, stretched) if contraction else gradient * (stretched.abs() <= 2)
    gradient = gradient * factors / 4
    length = (gradient.square().sum(-1, keepdim=True) + 1e-6).sqrt()
    return -gradient / length
