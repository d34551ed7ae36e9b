"""The image store holds exactly what a direct read and resize gives, and is built once."""

import os
import socket
import subprocess
import sys
import tracemalloc
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from PIL import Image

from plnerf.errors import SceneError
from plnerf.scene import build_store, images
from plnerf.scene.build_store import open_store, reduced_sizes_px
from plnerf.scene.decode import read_mask
from plnerf.scene.images import ImageStore
from plnerf.scene.listing import Intrinsics, Shot

SIZES = [(64, 48), (50, 81), (37, 40), (96, 33)]


def make_shots(root: Path, seed: int = 0, masks: tuple[int, ...] = ()) -> list[Shot]:
    rng = np.random.default_rng(seed)
    shots = []
    for i, (w, h) in enumerate(SIZES):
        path = root / f"{i}.png"
        Image.fromarray(rng.integers(0, 256, (h, w, 3), dtype=np.uint8)).save(path)
        mask = None
        if i in masks:
            mask = root / f"{i}.mask.png"
            Image.fromarray((rng.random((h, w)) < 0.97).astype(np.uint8) * 255).save(mask)
        lens = Intrinsics(w, h, 50.0, 50.0, w / 2, h / 2, (0.0,) * 5, f"frame {i}")
        shots.append(Shot(path.name, path, np.eye(4), lens, mask=mask))
    return shots


@pytest.mark.parametrize("downscale", [1, 2])
def test_pixels_are_those_of_a_direct_resize(tmp_path: Path, downscale: int) -> None:
    shots = make_shots(tmp_path)
    store = open_store(shots, tmp_path, tmp_path / "store", downscale=downscale)
    assert store.sizes_px.tolist() == [[w // downscale, h // downscale] for w, h in SIZES]
    for i, (w, h) in enumerate(SIZES):
        direct = cv2.imread(str(shots[i].path), cv2.IMREAD_COLOR)[..., ::-1]
        direct = cv2.resize(direct, (w // downscale, h // downscale), interpolation=cv2.INTER_AREA)
        assert np.array_equal(store.image(i), direct)
        assert store.valid(i).all() and store.valid(i).shape == direct.shape[:2]
    assert not store.has_masks


def test_locate_and_colours_agree_with_image_for_unequal_sizes(tmp_path: Path) -> None:
    store = open_store(make_shots(tmp_path), tmp_path, tmp_path / "store", downscale=2)
    total = int(store.starts[-1])
    assert total == sum((w // 2) * (h // 2) for w, h in SIZES)
    flat = torch.randint(0, total, (500,), generator=torch.Generator().manual_seed(0))
    ends = torch.from_numpy(np.concatenate([store.starts[:-1], store.starts[1:] - 1]))
    flat = torch.cat([flat, ends])
    image, pixel = store.locate(flat)
    colours = store.colours(flat)
    for k in range(len(flat)):
        x, y = pixel[k].tolist()
        assert x % 1 == 0.5 and y % 1 == 0.5
        truth = store.image(int(image[k]))[int(y), int(x)]
        assert colours[k].tolist() == pytest.approx((truth / 255.0).tolist(), abs=1e-6)


def test_every_flat_index_is_one_pixel_of_one_image(tmp_path: Path) -> None:
    store = open_store(make_shots(tmp_path), tmp_path, tmp_path / "store", downscale=2)
    image, pixel = store.locate(torch.arange(int(store.starts[-1])))
    seen = {(int(i), float(x), float(y)) for i, (x, y) in zip(image, pixel, strict=True)}
    assert len(seen) == int(store.starts[-1])
    assert all(x < store.sizes_px[i, 0] and y < store.sizes_px[i, 1] for i, x, y in seen)


def test_a_pixel_is_valid_only_if_all_pixels_under_it_are(tmp_path: Path) -> None:
    shots = make_shots(tmp_path, masks=(0, 2))
    store = open_store(shots, tmp_path, tmp_path / "store", downscale=2)
    full = np.asarray(Image.open(tmp_path / "0.mask.png")) != 0
    assert np.array_equal(store.valid(0), full.reshape(24, 2, 32, 2).all((1, 3)))
    assert store.valid(1).all() and store.has_masks and not store.valid(2).all()
    flat = torch.arange(int(store.starts[-1]))
    joined = np.concatenate([store.valid(i).reshape(-1) for i in range(len(store))])
    assert np.array_equal(store.valid_flat(flat).numpy(), joined)


def test_a_store_is_reused_until_something_changes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shots = make_shots(tmp_path)
    built = []
    real = build_store._build
    monkeypatch.setattr(build_store, "_build", lambda *args: (built.append(1), real(*args)))

    def open_it(downscale: int = 1) -> ImageStore:
        return open_store(shots, tmp_path, tmp_path / "store", downscale=downscale)

    first = open_it()
    kept = first.image(0).copy()
    open_it()
    assert len(built) == 1
    open_it(downscale=2)
    assert len(built) == 2
    assert np.array_equal(first.image(0), kept)  # a reader of the old files is not disturbed
    os.utime(shots[1].path, ns=(1, 1))
    open_it(downscale=2)
    assert len(built) == 3
    (tmp_path / "store/images.u8").write_bytes(b"short")
    assert np.array_equal(open_it(downscale=2).image(1).shape, (40, 25, 3)) and len(built) == 4
    assert sorted(p.name for p in (tmp_path / "store").iterdir()) == ["images.u8", "index.json"]


def test_a_failed_build_leaves_no_store_and_no_rest(tmp_path: Path) -> None:
    shots = make_shots(tmp_path)
    open_store(shots, tmp_path, tmp_path / "store", downscale=1)
    shots[2].path.write_bytes(shots[2].path.read_bytes()[:2000])
    with pytest.raises(SceneError, match="damaged"):
        open_store(shots, tmp_path, tmp_path / "store", downscale=1)
    assert not list((tmp_path / "store").glob("*.partial"))
    Image.new("RGB", SIZES[2], (9, 9, 9)).save(shots[2].path)
    assert (open_store(shots, tmp_path, tmp_path / "store", downscale=1).image(2) == 9).all()


def test_what_a_killed_process_left_of_a_store_is_removed(tmp_path: Path) -> None:
    """And not what one that lives, or one of another machine, is writing."""
    ended, host = subprocess.Popen([sys.executable, "-c", ""]), socket.gethostname()
    ended.wait()
    store = tmp_path / "store"
    store.mkdir()
    left = store / f"images.u8.{host}-{ended.pid}.partial"
    others = {f"images.u8.{host}-{os.getppid()}.partial", f"images.u8.not{host}-{ended.pid}.partial"}
    for name in (left.name, *others):
        (store / name).write_bytes(b"half")
    open_store(make_shots(tmp_path), tmp_path, store, downscale=1)
    assert {path.name for path in store.iterdir()} == {"images.u8", "index.json"} | others


def test_a_store_that_cannot_be_written_says_why(tmp_path: Path) -> None:
    shots = make_shots(tmp_path)
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(SceneError, match="cannot be written"):
        open_store(shots, tmp_path, tmp_path / "file" / "store", downscale=1)


def test_exif_orientation_is_ignored_when_the_stored_grid_matches(tmp_path: Path) -> None:
    shots = make_shots(tmp_path)
    stored = np.random.default_rng(3).integers(0, 256, (48, 64, 3), dtype=np.uint8)
    exif = Image.Exif()
    exif[0x0112] = 6
    Image.fromarray(stored).save(shots[0].path, exif=exif)
    store = open_store(shots, tmp_path, tmp_path / "store", downscale=1)
    assert np.array_equal(store.image(0), stored)


def test_progress_counts_every_image_once(tmp_path: Path) -> None:
    calls: list[tuple[int, int]] = []
    open_store(
        make_shots(tmp_path), tmp_path, tmp_path / "store", downscale=1, progress=lambda *c: calls.append(c)
    )
    assert calls == [(1, 4), (2, 4), (3, 4), (4, 4)]


def test_downscale_below_one_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"1 \(full size\) or more"):
        reduced_sizes_px(make_shots(tmp_path), 0)


def test_building_holds_only_the_images_in_work(tmp_path: Path) -> None:
    """Forty images of 3 MB each raise the peak by far less than their sum."""
    lens = Intrinsics(1000, 1000, 1.0, 1.0, 500.0, 500.0, (0.0,) * 5, "all")
    Image.new("RGB", (1000, 1000)).save(tmp_path / "a.png")
    shots = [Shot(f"{i}.png", tmp_path / "a.png", np.eye(4), lens) for i in range(40)]
    tracemalloc.start()
    open_store(shots, tmp_path, tmp_path / "store", downscale=2)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 20e6


@pytest.mark.parametrize("mode", ["1", "L", "I;16", "RGB", "LA", "RGBA"])
def test_masks_of_every_kind_mean_the_same(tmp_path: Path, mode: str) -> None:
    """Not 0 is used, 0 is ignored; an alpha channel says nothing."""
    usable = np.random.default_rng(0).random((48, 64)) < 0.5
    if mode == "I;16":
        mask = Image.fromarray(usable.astype(np.uint16) * 256)  # low byte 0: must not count as 0
    else:
        mask = Image.fromarray(usable.astype(np.uint8) * 255).convert(mode)
    mask.save(tmp_path / "mask.png")
    lens = make_shots(tmp_path)[0].intrinsics
    assert np.array_equal(read_mask(tmp_path / "mask.png", lens), usable)


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="Linux alone reports what is mapped")
def test_only_a_bounded_part_of_the_pixels_is_mapped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A file of 201 MB, of which 20 MB may be mapped: neither whole images nor single pixels pile up."""

    def mapped_mb() -> float:
        lines = Path("/proc/self/status").read_text().splitlines()
        return next(int(line.split()[1]) / 1e3 for line in lines if line.startswith("RssFile"))

    monkeypatch.setattr(images, "RESIDENT_BYTES", 20_000_000)
    count, side = 64, 1024
    with (tmp_path / "images.u8").open("wb") as file:
        file.truncate(3 * count * side**2)
    store = ImageStore(tmp_path, np.full((count, 2), side))
    assert store.waits_for_disk
    store.image(0).max()
    before = mapped_mb()
    for i in range(count):
        assert store.image(i).max() == 0
        assert mapped_mb() < before + 40
    generator = torch.Generator().manual_seed(0)
    for _ in range(100):
        store.colours(torch.randint(0, count * side**2, (100,), generator=generator))
        assert mapped_mb() < before + 40
