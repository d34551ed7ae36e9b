"""Measures against closed forms and an independent implementation; ignored pixels have no say."""

import importlib.util
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image
from skimage.metrics import structural_similarity
from tests.support.oracle import Oracle, Seen, tiny_world

from plnerf.render.system import RadianceSystem
from plnerf.scene.scene import Scene, load_scene
from plnerf.train.metrics import (
    LPIPS_ABSENT,
    Lpips,
    held_out_pixels,
    mean_inside,
    psnr,
    psnr_of_mse,
    some_of,
    ssim,
    ssim_map,
    validation_psnr,
)

ROUNDING_DB = 10 * math.log10(12 * 255**2)
"""PSNR of colours against their 8-bit rounding, an error even in +-1/510; some colours need none."""


def pair(seed: int = 0, size: tuple[int, int] = (24, 31)) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    photo = rng.random((*size, 3), dtype=np.float32)
    return np.clip(photo + rng.normal(0, 0.1, photo.shape), 0, 1).astype(np.float32), photo


def everywhere(picture: np.ndarray) -> np.ndarray:
    return np.ones(picture.shape[:2], np.bool_)


@pytest.mark.parametrize("error", [0.5, 0.01, 1e-6])
def test_psnr_of_a_constant_error(error: float) -> None:
    photo = np.full((4, 5, 3), 0.25)
    assert psnr(photo + error, photo, everywhere(photo)) == pytest.approx(-20 * math.log10(error), rel=1e-6)
    assert psnr_of_mse(error**2) == pytest.approx(-20 * math.log10(error))


def test_equal_pictures_have_infinite_psnr_and_no_pixels_have_none() -> None:
    _, photo = pair()
    assert psnr(photo, photo, everywhere(photo)) == math.inf
    assert psnr(photo, photo, ~everywhere(photo)) is None
    assert ssim(photo, photo, ~everywhere(photo)) is None


def test_psnr_over_two_halves_adds_up() -> None:
    render, photo = pair()
    mask = np.random.default_rng(1).random((24, 31)) < 0.3
    mse = [10 ** (-(psnr(render, photo, m) or 0) / 10) for m in (mask, ~mask, everywhere(photo))]
    assert mse[0] * mask.mean() + mse[1] * (~mask).mean() == pytest.approx(mse[2])


def test_ssim_agrees_with_scikit_image() -> None:
    render, photo = pair(2, (40, 33))
    theirs = structural_similarity(
        render.astype(np.float64),
        photo.astype(np.float64),
        data_range=1.0,
        channel_axis=2,
        gaussian_weights=True,
        sigma=1.5,
        use_sample_covariance=False,
    )
    assert ssim(render, photo, everywhere(photo)) == pytest.approx(theirs, abs=2e-5)
    assert ssim(photo, photo, everywhere(photo)) == pytest.approx(1, abs=1e-6)


def test_ssim_over_parts_adds_up_and_says_nothing_of_borders() -> None:
    render, photo = pair(3, (40, 33))
    similarity = ssim_map(render, photo, everywhere(photo))
    part = np.random.default_rng(1).random((40, 33)) < 0.2
    inner = (slice(5, -5), slice(5, -5))
    shares = part[inner].mean(), 1 - part[inner].mean()
    parts = [mean_inside(similarity, use) or 0.0 for use in (part, ~part)]
    assert shares[0] * parts[0] + shares[1] * parts[1] == pytest.approx(
        ssim(render, photo, everywhere(photo))
    )
    border = everywhere(photo)
    border[inner] = False
    assert mean_inside(similarity, border) is None


def test_ignored_pixels_have_no_say() -> None:
    render, photo = pair()
    valid = everywhere(photo)
    valid[5:12, 8:20] = False
    noise = np.where(
        valid[..., None], render, np.random.default_rng(5).random(render.shape, dtype=np.float32)
    )
    for metric in (psnr, ssim):
        assert metric(noise, photo, valid) == metric(render, photo, valid)
        assert metric(noise, photo, everywhere(photo)) != metric(render, photo, everywhere(photo))


def test_lpips_is_computed_or_its_absence_stated() -> None:
    lpips = Lpips()
    if importlib.util.find_spec("torchvision") is None:
        render, photo = pair(0, (64, 64))
        assert lpips.absent == LPIPS_ABSENT and lpips(render, photo, everywhere(photo)) is None
    else:
        pytest.skip("torchvision is there, and its weights may have to be downloaded")


def validated(model: RadianceSystem, scene: Scene, pixels: int, seed: int = 0) -> float:
    chosen = held_out_pixels(scene, pixels, torch.Generator().manual_seed(seed))
    return validation_psnr(model, scene, chosen)


def test_validation_looks_at_held_out_pixels_alone_and_finds_the_oracle_right(
    tiny_scene: Path, tmp_path: Path
) -> None:
    scene = load_scene(tiny_scene, store=tmp_path / "store")
    model = Oracle(tiny_world(scene.frames), len(scene.names))
    value = validated(model, scene, 3000)
    assert ROUNDING_DB - 0.5 < value < ROUNDING_DB + 15
    assert model.cameras == set(scene.test) and sum(model.chunks) == 3000
    assert not torch.cat(model.appearances).requires_grad


def test_validation_repeats_itself_and_leaves_the_model_alone(tiny_scene: Path, tmp_path: Path) -> None:
    scene = load_scene(tiny_scene, store=tmp_path / "store")

    def noisy(rays) -> Seen:  # type: ignore[no-untyped-def]
        seen = tiny_world(scene.frames)(rays)
        return replace(seen, colour=seen.colour * (0.5 + 0.5 * torch.sin(900 * rays.directions)))

    model = Oracle(noisy, len(scene.names)).train()
    first, again, other = (
        validated(model, scene, 500, seed) for seed in (1, 1, 2)
    )
    assert first == again != other
    assert model.training


def test_validation_leaves_ignored_pixels_out(tiny_scene: Path, tmp_path: Path) -> None:
    """Photos spoilt on their left halves, which masks then ignore."""
    mask = np.full((32, 48), 255, np.uint8)
    mask[:, :24] = 0
    (tiny_scene / "masks").mkdir()
    for path in sorted((tiny_scene / "images").iterdir()):
        pixels = np.array(Image.open(path))
        pixels[:, :24] = 0
        Image.fromarray(pixels).save(path)
        Image.fromarray(mask).save(tiny_scene / "masks" / path.name)
    text = (tiny_scene / "transforms.json").read_text()
    spoilt = load_scene(tiny_scene, store=tmp_path / "spoilt")
    with_masks = text.replace('"file_path": "images/', '"mask_path": "masks/@", "file_path": "images/')
    for i in range(12):
        with_masks = with_masks.replace("@", f"{i:04d}.png", 1)
    (tiny_scene / "transforms.json").write_text(with_masks)
    masked = load_scene(tiny_scene, store=tmp_path / "masked")
    model = Oracle(tiny_world(masked.frames), len(masked.names))
    assert validated(model, spoilt, 2000) < 15
    assert validated(model, masked, 2000) > 55


def test_some_pixels_are_drawn_once_each() -> None:
    pixels, generator = np.arange(100, 150), torch.Generator().manual_seed(1)
    assert len(set(some_of(pixels, 20, generator).tolist())) == 20
    assert sorted(some_of(pixels, 90, generator).tolist()) == pixels.tolist()
    assert len(some_of(np.zeros(0, np.int64), 9, generator)) == 0
