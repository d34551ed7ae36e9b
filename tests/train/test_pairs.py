"""Pairs of pixels: neighbours in one image, each as likely as alone, and a loss that sees edges only."""

from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from plnerf.scene.images import ImageStore
from plnerf.train.pairs import draw_pairs, edge_loss
from plnerf.train.pixels import PixelBatch, PixelSampler, detail_pools

SIZES = [(8, 5), (5, 9), (7, 6)]
TRAIN = (2, 0)
DRAWS = 400_000


@pytest.fixture(params=[False, True], ids=["no masks", "masks"])
def store(tmp_path: Path, request: pytest.FixtureRequest) -> ImageStore:
    rng = np.random.default_rng(0)
    total = sum(w * h for w, h in SIZES)
    rng.integers(0, 256, (total, 3), dtype=np.uint8).tofile(tmp_path / "images.u8")
    if request.param:
        (rng.uniform(size=total) > 0.25).astype(np.uint8).tofile(tmp_path / "valid.u8")
    return ImageStore(tmp_path, np.array(SIZES))


def pairs(store: ImageStore, share: float = 0.6, rays: int = DRAWS) -> PixelBatch:
    sampler = PixelSampler(store, TRAIN, detail_pools(store, TRAIN, share, 0.1))
    return draw_pairs(sampler, rays, torch.Generator().manual_seed(0))


def flat(store: ImageStore, batch: PixelBatch) -> Tensor:
    x, y = batch.pixel_px.long().T
    width = torch.from_numpy(store.sizes_px)[batch.camera, 0]
    return torch.from_numpy(store.starts)[batch.camera] + y * width + x


def test_a_pixel_and_its_neighbour_are_one_pixel_apart_in_one_image(store: ImageStore) -> None:
    batch = pairs(store)
    first, second = batch.pixel_px.chunk(2)
    camera, other_camera = batch.camera.chunk(2)
    assert torch.equal(camera, other_camera)
    step = (first - second).abs()
    assert bool((step.sum(-1) <= 1).all())
    assert float((step.sum(-1) == 1).double().mean()) > 0.5
    for axis in (0, 1):
        assert float((step[:, axis] == 1).double().mean()) > 0.2
    assert torch.equal(batch.colour, store.colours(flat(store, batch)))
    ends = torch.from_numpy(store.sizes_px)[batch.camera]
    assert bool(((batch.pixel_px > 0) & (batch.pixel_px < ends)).all())


@pytest.mark.parametrize("share", [0.0, 0.6])
def test_every_valid_pixel_counts_the_same_among_the_neighbours_too(store: ImageStore, share: float) -> None:
    """The importance that falls on each pixel: that of uniform draws, within 5 standard errors."""
    batch = pairs(store, share)
    for half in (slice(0, DRAWS // 2), slice(DRAWS // 2, DRAWS)):
        place, importance = flat(store, batch)[half], batch.importance[half].double()
        count = int(store.starts[-1])
        found = torch.zeros(count).double().index_add(0, place, importance)
        spread = torch.zeros(count).double().index_add(0, place, importance**2).sqrt()
        pixels = torch.cat([torch.arange(int(store.starts[i]), int(store.starts[i + 1])) for i in TRAIN])
        truth = store.valid_flat(pixels).double() * (DRAWS / 2) / len(pixels)
        assert bool(((found[pixels] - truth).abs() <= 5 * spread[pixels]).all())
        assert float(found.sum() - found[pixels].sum()) == 0


def test_an_odd_number_of_rays_is_rounded_up(store: ImageStore) -> None:
    assert len(pairs(store, rays=7).camera) == 8


def test_pairs_are_a_function_of_the_seed(store: ImageStore) -> None:
    assert torch.equal(pairs(store, rays=100).pixel_px, pairs(store, rays=100).pixel_px)


def test_the_loss_is_blind_to_a_level_and_sees_a_missing_line() -> None:
    one = torch.ones(8)
    level = torch.full((8, 3), 0.3)
    assert float(edge_loss(level, one)) == 0
    line = torch.zeros(8, 3)
    line[0] = 0.3  # a pixel of a line; its neighbour, ray 4, is beside it
    assert float(edge_loss(line, one)) == pytest.approx(0.3**2 / 4)
    assert float(edge_loss(line, torch.tensor([0.0, 1, 1, 1, 0, 1, 1, 1]))) == 0
    torch.testing.assert_close(edge_loss(-2 * line + level, 0.5 * one), 2 * edge_loss(line, one))
