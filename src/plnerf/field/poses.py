"""Small corrections of the training cameras' poses.  NeRF--, section 3.2.

A correction is a rotation vector about the camera's centre and a shift, both in the scene frame, of zero at
the start.
"""

import math

import torch
from jaxtyping import Float
from torch import Tensor, nn

from plnerf.rays.rays import Rays


def rotation_matrix(vector: Float[Tensor, "*n 3"]) -> Float[Tensor, "*n 3 3"]:
    """Rotation by |vector| radians about vector: exp of the cross product matrix K.  Rodrigues.

    I + sin(a)/a K + (1 - cos(a))/a^2 K^2; torch's matrix_exp would wait for a GPU.
    """
    angle = vector.norm(dim=-1)[..., None, None]
    x, y, z = vector.unbind(-1)
    zero = torch.zeros_like(x)
    cross = torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], -1).unflatten(-1, (3, 3))
    first, second = torch.sinc(angle / math.pi), torch.sinc(angle / (2 * math.pi)).square() / 2
    return torch.eye(3, dtype=vector.dtype, device=vector.device) + first * cross + second * (cross @ cross)


class PoseCorrections(nn.Module):
    """One correction per camera: (rotation vector in radians, shift in scene units)."""

    def __init__(self, cameras: int) -> None:
        super().__init__()
        self.correction = nn.Parameter(torch.zeros(cameras, 6))

    def forward(self, rays: Rays) -> Rays:
        """The rays of the corrected cameras."""
        rotation = rotation_matrix(self.correction[:, :3])[rays.camera]
        directions = torch.einsum("rij,rj->ri", rotation, rays.directions)
        return Rays(rays.origins + self.correction[rays.camera, 3:], directions, rays.radius, rays.camera)
