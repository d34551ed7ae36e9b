"""Pose corrections: none at the start, proper rotations about the camera, with exact gradients at zero."""

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from plnerf.field.poses import PoseCorrections, rotation_matrix
from plnerf.rays.rays import Rays


def random_rays(n: int, cameras: int) -> Rays:
    generator = torch.Generator().manual_seed(0)
    origins, directions = torch.randn(2, n, 3, generator=generator)
    directions = torch.nn.functional.normalize(directions, dim=-1)
    radius = torch.rand(n, generator=generator)
    return Rays(origins, directions, radius, torch.randint(cameras, (n,), generator=generator))


def test_rotations_are_scipy_s_and_proper() -> None:
    vectors = torch.randn(20, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64) * 2
    vectors[0], vectors[1] = 0, torch.tensor([1e-9, -2e-9, 1e-9])
    found = rotation_matrix(vectors)
    np.testing.assert_allclose(found, Rotation.from_rotvec(vectors.numpy()).as_matrix(), atol=1e-12)
    eye = torch.eye(3, dtype=torch.float64).expand(20, 3, 3)
    torch.testing.assert_close(found @ found.mT, eye)
    torch.testing.assert_close(torch.linalg.det(found), torch.ones(20, dtype=torch.float64))
    torch.testing.assert_close(found @ rotation_matrix(-vectors), eye)


def test_gradient_at_zero_is_that_of_finite_differences() -> None:
    """The derivative of a rotated direction is v x d: not NaN from a division by the angle."""
    zero = torch.zeros(3, dtype=torch.float64, requires_grad=True)
    direction = torch.tensor([0.6, -0.3, 0.74], dtype=torch.float64)
    derivative = torch.autograd.functional.jacobian(lambda v: rotation_matrix(v) @ direction, zero)
    step = 1e-6 * torch.eye(3, dtype=torch.float64)
    differences = torch.stack(
        [(rotation_matrix(v) - rotation_matrix(-v)) @ direction / 2e-6 for v in step], -1
    )
    torch.testing.assert_close(derivative, differences, atol=1e-9, rtol=0)
    crosses = torch.stack([torch.linalg.cross(axis, direction) for axis in step / 1e-6], -1)
    torch.testing.assert_close(derivative, crosses)


def test_zero_correction_changes_nothing() -> None:
    rays = random_rays(10, 4)
    corrected = PoseCorrections(4)(rays)
    for name in ("origins", "directions", "radius", "camera"):
        assert torch.equal(getattr(corrected, name), getattr(rays, name))


def test_each_camera_turns_about_its_own_centre() -> None:
    """Directions turn and stay of unit length; origins move by the shift alone, the cones stay as wide."""
    poses, rays = PoseCorrections(4), random_rays(10, 4)
    with torch.no_grad():
        poses.correction.copy_(torch.randn(4, 6, generator=torch.Generator().manual_seed(1)))
    corrected = poses(rays)
    correction = poses.correction.detach()
    for i, camera in enumerate(rays.camera.tolist()):
        turn = Rotation.from_rotvec(correction[camera, :3].numpy()).as_matrix()
        np.testing.assert_allclose(
            corrected.directions[i].detach(), turn @ rays.directions[i].numpy(), atol=1e-5
        )
        torch.testing.assert_close(corrected.origins[i].detach(), rays.origins[i] + correction[camera, 3:])
    torch.testing.assert_close(corrected.directions.norm(dim=-1), torch.ones(10))
    assert torch.equal(corrected.radius, rays.radius)


def test_only_cameras_that_were_seen_get_a_gradient() -> None:
    poses, rays = PoseCorrections(5), random_rays(10, 3)
    corrected = poses(rays)
    (corrected.origins.square().sum() + (corrected.directions * torch.arange(3)).sum()).backward()
    gradient = poses.correction.grad
    assert gradient is not None
    assert bool(gradient.isfinite().all())
    seen = torch.unique(rays.camera)
    assert bool(gradient[seen].abs().gt(0).any(-1).all())
    assert not gradient[3:].any()
