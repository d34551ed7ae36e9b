"""Drawing pixels: unbiased whatever the share of detail, from the training images alone; ridges are lines."""

import math
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from plnerf.errors import ConfigError
from plnerf.scene.images import ImageStore
from plnerf.train.config import DetailMap, TrainConfig
from plnerf.train.pixels import DETAIL_MAPS, PixelSampler, Pool, detail_pixels, detail_pools, ridge_strength

SIZES = [(24, 16), (10, 30), (17, 13), (20, 20)]
TRAIN = (2, 0, 3)  # in no order, and not all


def make_store(folder: Path, masked: bool = False) -> ImageStore:
    rng = np.random.default_rng(0)
    total = sum(w * h for w, h in SIZES)
    rng.integers(0, 256, (total, 3), dtype=np.uint8).tofile(folder / "images.u8")
    if masked:
        (rng.uniform(size=total) > 0.25).astype(np.uint8).tofile(folder / "valid.u8")
    return ImageStore(folder, np.array(SIZES))


def pattern(camera: Tensor, pixel_px: Tensor) -> Tensor:
    """Some function of the pixel that differs a lot from pixel to pixel."""
    return torch.sin(camera * 2.1 + pixel_px[:, 0] * 1.3 + pixel_px[:, 1] * 0.37).double() + 0.5


def all_pixels(image: int) -> tuple[Tensor, Tensor]:
    width, height = SIZES[image]
    y, x = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
    pixel = torch.stack([x.flatten(), y.flatten()], -1) + 0.5
    return torch.full((width * height,), image), pixel


@pytest.mark.parametrize("masked", [False, True], ids=["no masks", "masks"])
@pytest.mark.parametrize("share", [0.0, 0.3, 0.9])
@pytest.mark.parametrize("chosen_by", ["hessian", "ridge"])
def test_the_weighted_mean_is_the_mean_over_all_training_pixels(
    tmp_path: Path, chosen_by: DetailMap, share: float, masked: bool
) -> None:
    """E[importance f] = 1/N sum f over valid pixels: within 5 standard errors of 200,000 draws."""
    store = make_store(tmp_path, masked)
    batch = PixelSampler(store, TRAIN, detail_pools(store, TRAIN, share, 0.1, chosen_by)).draw(
        200_000, torch.Generator().manual_seed(0)
    )
    drawn = batch.importance * pattern(batch.camera, batch.pixel_px)
    truth = torch.cat([
        pattern(*all_pixels(i)) * torch.from_numpy(store.valid(i).ravel()) for i in TRAIN
    ])  # fmt: skip
    error = float(drawn.mean() - truth.mean())
    assert abs(error) < 5 * float(drawn.std()) / len(drawn) ** 0.5
    assert float(drawn.std()) / len(drawn) ** 0.5 < 0.01


@pytest.mark.parametrize("share", [0.0, 0.5])
def test_pixels_are_those_of_the_training_images_and_whole(tmp_path: Path, share: float) -> None:
    store = make_store(tmp_path)
    batch = PixelSampler(store, TRAIN, detail_pools(store, TRAIN, share, 0.1)).draw(
        20_000, torch.Generator().manual_seed(0)
    )
    assert set(batch.camera.tolist()) == set(TRAIN)
    for image in TRAIN:
        mine = batch.camera == image
        corner = (batch.pixel_px[mine] - 0.5).long()
        torch.testing.assert_close(corner + 0.5, batch.pixel_px[mine])
        width, height = SIZES[image]
        assert len(torch.unique(corner, dim=0)) == width * height  # each of them, and none beyond
        colour = store.image(image)[corner[:, 1], corner[:, 0]]
        torch.testing.assert_close(batch.colour[mine], torch.from_numpy(colour).float() / 255)


def test_masked_pixels_do_not_count(tmp_path: Path) -> None:
    store = make_store(tmp_path, masked=True)
    batch = PixelSampler(store, TRAIN, detail_pools(store, TRAIN, 0.5, 0.1)).draw(
        5_000, torch.Generator().manual_seed(0)
    )
    corner = (batch.pixel_px - 0.5).long().numpy()
    valid = [store.valid(c)[y, x] for c, (x, y) in zip(batch.camera.tolist(), corner, strict=True)]
    assert torch.equal(batch.importance > 0, torch.tensor(valid))
    assert 0.1 < 1 - np.mean(valid) < 0.4


def test_detail_gets_its_share_of_the_draws(tmp_path: Path) -> None:
    store = make_store(tmp_path)
    detail = set(detail_pixels(store, TRAIN, 0.1).tolist())
    total = sum(SIZES[i][0] * SIZES[i][1] for i in TRAIN)
    assert len(detail) == sum(round(0.1 * SIZES[i][0] * SIZES[i][1]) for i in TRAIN)
    batch = PixelSampler(store, TRAIN, detail_pools(store, TRAIN, 0.6, 0.1)).draw(
        50_000, torch.Generator().manual_seed(0)
    )
    corner = (batch.pixel_px - 0.5).long()
    width = torch.tensor([w for w, _ in SIZES])[batch.camera]
    flat = torch.from_numpy(store.starts)[batch.camera] + corner[:, 1] * width + corner[:, 0]
    is_detail = torch.tensor([value in detail for value in flat.tolist()])
    assert is_detail.double().mean().item() == pytest.approx(0.6 + 0.4 * len(detail) / total, abs=0.01)
    assert batch.importance[~is_detail].unique().tolist() == [pytest.approx(1 / 0.4)]
    assert batch.importance[is_detail].unique().tolist() == [
        pytest.approx(1 / (0.4 + 0.6 * total / len(detail)))
    ]


@pytest.mark.parametrize("chosen_by", ["hessian", "ridge"])
def test_detail_pixels_are_sorted_and_the_strongest_of_each_image(
    tmp_path: Path, chosen_by: DetailMap
) -> None:
    store = make_store(tmp_path)
    detail = detail_pixels(store, TRAIN, 0.2, detail_map=chosen_by)
    assert (np.diff(detail) > 0).all()
    for image in TRAIN:
        first, end = store.starts[image], store.starts[image + 1]
        mine = detail[(detail >= first) & (detail < end)] - first
        strength = DETAIL_MAPS[chosen_by](store.image(image)).ravel()
        others = np.delete(strength, mine)
        assert len(mine) == round(0.2 * strength.size)
        assert strength[mine].min() >= others.max()


def test_draws_are_a_function_of_the_generator(tmp_path: Path) -> None:
    sampler = PixelSampler(make_store(tmp_path), TRAIN, detail_pools(make_store(tmp_path), TRAIN, 0.5, 0.1))
    a, b, c = (sampler.draw(100, torch.Generator().manual_seed(seed)) for seed in (0, 0, 1))
    assert torch.equal(a.pixel_px, b.pixel_px)
    assert not torch.equal(a.pixel_px, c.pixel_px)


def picture(grey: np.ndarray) -> np.ndarray:
    return np.repeat(np.round(grey)[..., None], 3, -1).astype(np.uint8)


def band(width_px: float, angle_deg: float, phase_px: float, contrast: float) -> np.ndarray:
    """A straight band across a grey picture, edges area-sampled; a width of infinity makes a step edge."""
    fine = (np.mgrid[0:640, 0:640] + 0.5) / 10 - 32
    normal = np.deg2rad(angle_deg)
    across = fine[1] * np.cos(normal) + fine[0] * np.sin(normal) + phase_px
    inside = (across > 0) & (across < width_px) if np.isinf(width_px) else np.abs(across) < width_px / 2
    return 100 + contrast * inside.reshape(64, 10, 64, 10).mean((1, 3))


@pytest.mark.parametrize("sign", [1, -1], ids=["bright", "dark"])
@pytest.mark.parametrize("angle_deg", [0.0, 30.0, 90.0])
def test_a_thin_line_outranks_an_edge_of_the_same_contrast(angle_deg: float, sign: int) -> None:
    """Of one to three pixels, on average over where it lies between them; a flat area has no strength."""
    inner = np.s_[16:48, 16:48]
    phases = (0.0, 0.25, 0.5)  # from the border of two pixels to a pixel's centre

    def strongest(width_px: float, phase_px: float) -> float:
        return float(ridge_strength(picture(band(width_px, angle_deg, phase_px, 90 * sign)))[inner].max())

    edge = max(strongest(np.inf, phase) for phase in phases)
    for width_px in (1.0, 2.0, 3.0):
        assert np.mean([strongest(width_px, phase) for phase in phases]) > 1.2 * edge
    assert ridge_strength(picture(np.full((20, 30), 77.0))).max() < 1e-6


def test_ridge_strength_is_the_curvature_along_the_worst_direction() -> None:
    """Of a x^2 + b x y + c y^2: sigma^2 |eigenvalue| of its Hessian, sigma = 2 being the stronger scale."""
    y, x = np.mgrid[-30:31, -30:31].astype(float)
    a, b, c = 0.10, 0.06, -0.04
    strength = ridge_strength(picture(128 + a * x**2 + b * x * y + c * y**2))[30, 30]
    hessian = np.array([[2 * a, b], [b, 2 * c]])
    assert strength == pytest.approx(4 * np.abs(np.linalg.eigvalsh(hessian)).max() / 255, rel=0.05)


def test_ridge_strength_turns_with_the_picture() -> None:
    image = np.random.default_rng(1).integers(0, 256, (20, 30, 3), dtype=np.uint8)
    strength = ridge_strength(image)
    np.testing.assert_allclose(ridge_strength(np.rot90(image).copy()), np.rot90(strength), atol=1e-5)
    np.testing.assert_allclose(ridge_strength(255 - image), strength, atol=1e-5)


@pytest.mark.parametrize("most", [1, 7, 40, 10_000])
def test_detail_pixels_are_bounded_and_some_of_the_strongest(tmp_path: Path, most: int) -> None:
    store = make_store(tmp_path)
    whole, some = detail_pixels(store, TRAIN, 0.2), detail_pixels(store, TRAIN, 0.2, most)
    assert len(some) <= most + len(TRAIN)  # at least one of each image
    assert set(some.tolist()) <= set(whole.tolist())
    assert set(store.locate(torch.from_numpy(some))[0].tolist()) == set(TRAIN)
    if most >= len(whole):
        assert np.array_equal(some, whole)


POOLS = ((0.3, slice(3, 60)), (0.25, slice(40, 200)), (0.1, slice(0, 7)))
"""Shares, and which of the detail pixels: the second overlaps the first, the third is small."""


def some_pools(store: ImageStore) -> tuple[Pool, ...]:
    detail = detail_pixels(store, TRAIN, 0.25)
    return tuple(Pool(detail[part], share) for share, part in POOLS)


def flat_of(store: ImageStore, camera: Tensor, pixel_px: Tensor) -> Tensor:
    corner = (pixel_px - 0.5).long()
    width = torch.tensor([w for w, _ in SIZES])[camera]
    return torch.from_numpy(store.starts)[camera] + corner[:, 1] * width + corner[:, 0]


def test_each_pool_is_drawn_as_often_as_it_was_told(tmp_path: Path) -> None:
    """From its share, from the others' that overlap it, and from the uniform rest; and weighed by it."""
    store = make_store(tmp_path)
    pools = some_pools(store)
    batch = PixelSampler(store, TRAIN, pools).draw(100_000, torch.Generator().manual_seed(0))
    flat = flat_of(store, batch.camera, batch.pixel_px).numpy()
    total = sum(SIZES[i][0] * SIZES[i][1] for i in TRAIN)
    uniform = 1 - sum(pool.share for pool in pools)
    for pool in pools:
        others = sum(
            other.share * len(np.intersect1d(other.pixels, pool.pixels)) / len(other.pixels)
            for other in pools
        )
        often = uniform * len(pool.pixels) / total + others
        assert np.isin(flat, pool.pixels).mean() == pytest.approx(often, abs=0.01)
    for value in np.unique(flat)[::40]:
        often = uniform + sum(pool.share * total / len(pool.pixels) for pool in pools if value in pool.pixels)
        mine = batch.importance[torch.from_numpy(flat == value)]
        torch.testing.assert_close(mine, torch.full_like(mine, 1 / often))


@pytest.mark.parametrize("masked", [False, True], ids=["no masks", "masks"])
def test_several_pools_leave_the_weighted_mean_that_of_all_pixels(tmp_path: Path, masked: bool) -> None:
    store = make_store(tmp_path, masked)
    batch = PixelSampler(store, TRAIN, some_pools(store)).draw(200_000, torch.Generator().manual_seed(0))
    drawn = batch.importance * pattern(batch.camera, batch.pixel_px)
    truth = torch.cat([
        pattern(*all_pixels(i)) * torch.from_numpy(store.valid(i).ravel()) for i in TRAIN
    ])  # fmt: skip
    assert abs(float(drawn.mean() - truth.mean())) < 5 * float(drawn.std()) / len(drawn) ** 0.5


@pytest.mark.parametrize("unbias", [0.0, 0.4, 1.0])
def test_unbias_is_the_power_of_the_weights(tmp_path: Path, unbias: float) -> None:
    """And changes no draw: 0 leaves every pixel a weight of 1, masked ones none."""
    store = make_store(tmp_path, masked=True)
    whole, powered = (
        PixelSampler(store, TRAIN, some_pools(store), power).draw(5_000, torch.Generator().manual_seed(0))
        for power in (1.0, unbias)
    )
    assert torch.equal(whole.pixel_px, powered.pixel_px) and torch.equal(whole.camera, powered.camera)
    seen = whole.importance > 0
    assert (~seen).any() and (powered.importance[~seen] == 0).all()
    torch.testing.assert_close(powered.importance[seen], whole.importance[seen] ** unbias)


@pytest.mark.parametrize("shares", [(1.0,), (0.5, 0.5), (0.9, 0.3)])
def test_pools_must_leave_some_draws_to_all_pixels(tmp_path: Path, shares: tuple[float, ...]) -> None:
    store = make_store(tmp_path)
    pixels = detail_pixels(store, TRAIN, 0.1)
    with pytest.raises(ConfigError, match=r"train\.detail_share or train\.curve_share") as caught:
        PixelSampler(store, TRAIN, [Pool(pixels, share) for share in shares])
    assert all(str(share) in str(caught.value) for share in shares)


def test_without_a_share_there_is_no_pool(tmp_path: Path) -> None:
    store = make_store(tmp_path)
    assert detail_pools(store, TRAIN, 0.0, 0.1) == ()
    (pool,) = detail_pools(store, TRAIN, 0.2, 0.1)
    assert pool.share == 0.2 and np.array_equal(pool.pixels, detail_pixels(store, TRAIN, 0.1))


@pytest.mark.parametrize("masked", [False, True], ids=["no masks", "masks"])
@pytest.mark.parametrize("side", [1, 3, 5])
def test_a_squares_mean_is_that_of_its_pixels(tmp_path: Path, side: int, masked: bool) -> None:
    """Against loops over images whose edge pixels are repeated; ignored pixels do not count."""
    store, half = make_store(tmp_path, masked), side // 2
    found = store.mean_colours(torch.arange(sum(w * h for w, h in SIZES)), side)
    start = 0
    for i, (width, height) in enumerate(SIZES):
        padded = np.pad(store.image(i) / 255, ((half, half), (half, half), (0, 0)), mode="edge")
        counts = np.pad(store.valid(i).astype(float), half, mode="edge")
        for x, y in [(0, 0), (width - 1, 3), (5, height - 1), (7, 8)]:
            square = padded[y : y + side, x : x + side].reshape(-1, 3)
            weights = counts[y : y + side, x : x + side].ravel()
            weights = weights if weights.any() else np.ones_like(weights)
            mean = np.average(square, axis=0, weights=weights)
            np.testing.assert_allclose(found[start + y * width + x].numpy(), mean, atol=1e-5)
        start += width * height


def test_squares_stand_for_pixels_outside_pools_alone(tmp_path: Path) -> None:
    store = make_store(tmp_path)
    sampler = PixelSampler(store, TRAIN, detail_pools(store, TRAIN, 0.3, 0.1))
    own, mean = (sampler.draw(4000, torch.Generator().manual_seed(3), side=side) for side in (1, 3))
    assert torch.equal(own.pixel_px, mean.pixel_px) and torch.equal(own.importance, mean.importance)
    differ = (own.colour != mean.colour).any(1)
    assert torch.equal(differ, own.importance > 1) and 0.5 < float(differ.double().mean()) < 0.8


def test_squares_end_with_a_share_of_all_pixels_drawn(tmp_path: Path) -> None:
    sampler = PixelSampler(make_store(tmp_path), TRAIN)
    cfg = TrainConfig(rays=16, normal_rays=4, smooth_px=5, smooth_draws=0.1)
    sides = [sampler.side_at(step, cfg) for step in range(20)]
    smooth = math.ceil(0.1 * sampler.total / 16)
    assert 0 < smooth < 20 and sides == [5] * smooth + [1] * (20 - smooth)
