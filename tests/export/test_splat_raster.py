"""The rasteriser and its gradient against the sum written out pixel by pixel; projection and samples."""

import numba
import numpy as np
import pytest
import torch
from torch import Tensor

from plnerf.export.splat_project import LOW_PASS, Gaussians, Pinhole, image_covariance, render, rotation_of
from plnerf.export.splat_raster import CUT_OFF, MAX_ALPHA, MIN_ALPHA, OPAQUE, rasterise

SIZE = (24, 17)
WHOLE = torch.tensor([0, SIZE[0], 0, SIZE[1]])


def drawn(count: int, opacity: float = 1.2) -> Tensor:
    """Gaussians of all shapes; some more opaque than an alpha may be."""
    random = torch.Generator().manual_seed(0)
    mean = torch.rand(count, 2, generator=random, dtype=torch.float64) * torch.tensor(SIZE)
    L = torch.randn(count, 2, 2, generator=random, dtype=torch.float64)
    conic = torch.linalg.inv(2 * L @ L.mT + 0.5 * torch.eye(2, dtype=torch.float64))
    rest = torch.rand(count, 4, generator=random, dtype=torch.float64)
    rest[:, 0] *= opacity
    return torch.cat([mean, conic[:, 0], conic[:, 1, 1:], rest], 1)


def by_hand(splats: Tensor) -> tuple[Tensor, Tensor]:
    """The sum of the module's docstring, with torch alone."""
    w, h = SIZE
    y, x = torch.meshgrid(torch.arange(h).double() + 0.5, torch.arange(w).double() + 0.5, indexing="ij")
    colour, T = splats.new_zeros(h, w, 3), splats.new_ones(h, w)
    for mx, my, a, b, c, opacity, *rgb in splats:
        dx, dy = x - mx, y - my
        q = (a * dx * dx + c * dy * dy) / 2 + b * dx * dy
        alpha = (opacity * torch.exp(-q)).clamp(max=MAX_ALPHA)
        alpha = torch.where((q <= CUT_OFF) & (alpha >= MIN_ALPHA) & (T >= OPAQUE), alpha, 0.0)
        colour = colour + (T * alpha)[..., None] * torch.stack(rgb)
        T = T * (1 - alpha)
    return colour, T


@pytest.mark.parametrize("threads", [1, 2])
def test_value_and_gradient_are_those_of_the_sum(threads: int) -> None:
    if threads > numba.config.NUMBA_NUM_THREADS:
        pytest.skip("this machine has one processor")
    before = numba.get_num_threads()
    splats = drawn(40).requires_grad_()
    random = torch.Generator().manual_seed(1)
    by_colour = torch.randn(SIZE[1], SIZE[0], 3, generator=random, dtype=torch.float64)
    by_through = torch.randn(SIZE[1], SIZE[0], generator=random, dtype=torch.float64)
    try:
        numba.set_num_threads(threads)
        found = rasterise(splats, WHOLE.expand(40, 4), SIZE)
        (gradient,) = torch.autograd.grad(
            (found[0] * by_colour).sum() + (found[1] * by_through).sum(), splats
        )
    finally:
        numba.set_num_threads(before)
    known = by_hand(splats)
    (expected,) = torch.autograd.grad((known[0] * by_colour).sum() + (known[1] * by_through).sum(), splats)
    torch.testing.assert_close(found[0], known[0], rtol=1e-9, atol=1e-9)
    torch.testing.assert_close(found[1], known[1], rtol=1e-9, atol=1e-9)
    torch.testing.assert_close(gradient, expected, rtol=1e-8, atol=1e-8)


def test_what_is_in_front_hides_what_is_behind() -> None:
    red_first = drawn(2)
    red_first[:, :2] = torch.tensor([12.0, 8.0])
    red_first[:, 2:5] = torch.tensor([0.02, 0.0, 0.02])
    red_first[:, 5] = 0.98
    red_first[:, 6:] = torch.eye(3, dtype=torch.float64)[:2]
    rgb, through = rasterise(red_first, WHOLE.expand(2, 4), SIZE)
    middle = rgb[8, 12]
    assert middle[0] > 0.95 and middle[1] < 0.03 and through[8, 12] < 1e-3


def camera(size: tuple[int, int] = SIZE) -> Pinhole:
    """At (1, -4, 2), along y."""
    R = torch.tensor([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    return Pinhole(
        R, torch.tensor([1.0, -4.0, 2.0]), torch.tensor([30.0, 32.0]), torch.tensor([12.5, 8.0]), size, 0.1
    )  # fmt: skip


def in_space(count: int) -> Gaussians:
    random = torch.Generator().manual_seed(2)
    return Gaussians(
        torch.randn(count, 3, generator=random) + torch.tensor([1.0, 0.0, 2.0]),
        torch.randn(count, 3, generator=random) * 0.5 - 2.0,
        torch.randn(count, 4, generator=random),
        torch.randn(count, generator=random),
        torch.randn(count, 9, 3, generator=random) * 0.3,
    )


def test_a_small_gaussian_has_the_covariance_of_its_projected_samples() -> None:
    eye = camera((200, 200))
    mean = torch.tensor([[1.6, 2.0, 2.9]])
    log_scale, quaternion = torch.tensor([[0.02, 0.05, 0.01]]).log(), torch.tensor([[0.9, 0.3, -0.4, 0.2]])
    seen = (mean - eye.centre) @ eye.R_local_camera
    found = image_covariance(seen, log_scale, quaternion, eye)[0]
    random = torch.Generator().manual_seed(3)
    offsets = (torch.randn(400_000, 3, generator=random) * log_scale.exp()) @ rotation_of(quaternion)[0].T
    samples = (mean + offsets - eye.centre) @ eye.R_local_camera
    pixels = samples[:, :2] / samples[:, 2:] * eye.focal_px
    expected = torch.from_numpy(np.cov(pixels.double().numpy().T)) + LOW_PASS * torch.eye(2)
    assert found[0] == pytest.approx(float(expected[0, 0]), rel=0.01)
    assert found[1] == pytest.approx(float(expected[0, 1]), rel=0.03)
    assert found[2] == pytest.approx(float(expected[1, 1]), rel=0.01)


def test_gaussians_out_of_sight_change_nothing() -> None:
    near = in_space(60)
    away = torch.tensor([[1.0, -8.0, 2.0], [60.0, 2.0, 2.0], [1.0, 2.0, -70.0], [1.0, -4.001, 2.0]])
    shown = render(near, camera())[0]
    more = Gaussians(
        torch.cat([near.xyz, away]), torch.cat([near.log_scale, torch.full((4, 3), -3.0)]),
        torch.cat([near.quaternion, torch.ones(4, 4)]), torch.cat([near.logit, torch.full((4,), 5.0)]),
        torch.cat([near.sh, torch.ones(4, 9, 3)]),
    )  # fmt: skip
    assert shown.max() > 0.2
    torch.testing.assert_close(render(more, camera())[0], shown)


def test_gradients_of_a_render_are_finite_and_lead_downhill() -> None:
    start = in_space(60)
    values = [value.clone().requires_grad_() for value in vars(start).values()]
    eye, target = camera(), torch.full((SIZE[1], SIZE[0], 3), 0.4)
    loss = (render(Gaussians(*values), eye)[0] - target).square().sum()
    loss.backward()
    assert all(value.grad is not None and value.grad.isfinite().all() for value in values)
    for value in values:  # each on its own, so that none is right by another's help
        gradient = value.grad
        assert gradient is not None
        moved = [(one - 1e-3 * gradient / gradient.norm()) if one is value else one for one in values]
        assert (render(Gaussians(*moved), eye)[0] - target).square().sum() < loss


@pytest.mark.parametrize("near_first", [True, False])
def test_the_nearer_gaussian_is_in_front_whatever_their_order(near_first: bool) -> None:
    """By distance, not by depth along z: as KHR_gaussian_splatting sorts."""
    eye = camera()
    aside = torch.tensor([0.5, 0.0, 0.0])  # as deep, but farther away
    xyz = eye.centre + torch.tensor([0.0, 3.0, 0.0]) + torch.stack([0 * aside, aside])
    order = [0, 1] if near_first else [1, 0]
    sh = torch.zeros(2, 1, 3)
    sh[0, 0], sh[1, 0] = torch.tensor([1.7, -1.7, -1.7]), torch.tensor([-1.7, 1.7, -1.7])
    size, turn = torch.full((2, 3), -0.5), torch.tensor([[1.0, 0.0, 0.0, 0.0]]).expand(2, 4)
    both = Gaussians(xyz[order], size, turn, torch.full((2,), 9.0), sh[order])
    rgb = render(both, eye)[0][8, 12]
    assert rgb[0] > 0.9 and rgb[1] < 0.1
