"""Masked parts of photos have no features and are not learnt; a mask that does not fit is told."""

from pathlib import Path

import numpy as np
import pycolmap
import pytest
from PIL import Image
from tests.capture.test_sfm import COUNT, H, W, steps

from plnerf.capture.capture import CaptureConfig, capture
from plnerf.capture.exif import PhotoFacts, read_facts
from plnerf.capture.masks import bring_masks
from plnerf.capture.sfm import SfmConfig
from plnerf.errors import CaptureError
from plnerf.scene.scene import load_scene


def mask(path: Path, size: tuple[int, int] = (W, H)) -> None:
    """The left third is to be ignored."""
    path.parent.mkdir(exist_ok=True)
    picture = np.full((size[1], size[0]), 255, np.uint8)
    picture[:, : size[0] // 3] = 0
    Image.fromarray(picture).save(path)


@pytest.fixture
def photo(tmp_path: Path) -> dict[str, PhotoFacts]:
    Image.fromarray(np.zeros((H, W, 3), np.uint8)).save(tmp_path / "a.jpg")
    return {"a.jpg": read_facts(tmp_path / "a.jpg")}


@pytest.mark.slow
def test_a_masked_part_has_no_features_and_is_not_learnt(tmp_path: Path) -> None:
    steps(tmp_path / "photos")
    for i in range(COUNT - 1):
        mask(tmp_path / "masks" / f"{i:02d}.png")
    sfm = SfmConfig(camera_model="SIMPLE_PINHOLE", features=1500, threads=1)
    config = CaptureConfig(sfm, masks=tmp_path / "masks")
    capture(tmp_path / "photos", tmp_path / "scene", config)
    with pycolmap.Database.open(tmp_path / "scene" / "sfm" / "database.db") as db:
        for image in db.read_all_images():
            x = db.read_keypoints(image.image_id)[:, 0]
            assert (x.min() >= W // 3) == (image.name != f"{COUNT - 1:02d}.png") and len(x) > 100
    scene = load_scene(tmp_path / "scene", store=tmp_path / "pixels")
    assert scene.images.has_masks
    mask(tmp_path / "masks" / f"{COUNT - 1:02d}.png")  # another set of masks finds features anew

    def stop_at_features(stage: str, done: int, of: int) -> None:
        if (stage, done, of) == ("features", 0, COUNT):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        capture(tmp_path / "photos", tmp_path / "scene", config, stop_at_features)


def test_one_mask_serves_all_and_names_follow_colmap(photo: dict[str, PhotoFacts], tmp_path: Path) -> None:
    mask(tmp_path / "one.png")
    facts = {**photo, "b.jpg": photo["a.jpg"]}
    assert bring_masks(tmp_path / "one.png", facts, tmp_path / "out") == {
        "a.jpg": tmp_path / "out" / "a.jpg.png",
        "b.jpg": tmp_path / "out" / "b.jpg.png",
    }
    mask(tmp_path / "own" / "b.jpg.png")
    bring_masks(tmp_path / "own", facts, tmp_path / "out")
    assert np.asarray(Image.open(tmp_path / "out" / "a.jpg.png")).all()  # without one, it is used whole
    assert set(np.unique(np.asarray(Image.open(tmp_path / "out" / "b.jpg.png")))) == {0, 255}


def test_masks_that_do_not_fit_are_told(photo: dict[str, PhotoFacts], tmp_path: Path) -> None:
    with pytest.raises(CaptureError, match="There are no masks at"):
        bring_masks(tmp_path / "absent", photo, tmp_path / "out")
    mask(tmp_path / "masks" / "z.png")
    with pytest.raises(CaptureError, match=r"none for any of the 1 images.*a\.jpg\.png or a\.png"):
        bring_masks(tmp_path / "masks", photo, tmp_path / "out")
    mask(tmp_path / "masks" / "a.png", (H, W))
    with pytest.raises(CaptureError, match=rf"is {H} x {W} px, but upright its image a\.jpg is {W} x {H}"):
        bring_masks(tmp_path / "masks", photo, tmp_path / "out")
    (tmp_path / "masks" / "a.png").write_bytes(b"no picture")
    with pytest.raises(CaptureError, match=r"a\.png cannot be read"):
        bring_masks(tmp_path / "masks", photo, tmp_path / "out")
    assert not list((tmp_path / "out").glob("*"))
