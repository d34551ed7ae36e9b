"""Photos of a rendered scene have what a camera states, and nothing of where they were taken exactly."""

from pathlib import Path

import numpy as np

from plnerf.capture.photos import find_photos
from plnerf.capture.references import GEO_TXT, read_geo_txt
from plnerf.pipeline import bundled_span
from plnerf.scene.formats import read_listing
from plnerf.synth.photos import PLACE, write_photos


def test_photos_have_a_focal_length_and_positions_that_are_off_as_stated(tmp_path: Path) -> None:
    exact = read_listing(bundled_span())
    folder = write_photos(bundled_span(), tmp_path / "photos", noise_m=0.05, seed=3)
    names = {shot.path.name for shot in exact.shots}
    assert {path.name for path in folder.iterdir()} == names | {GEO_TXT}
    photos = find_photos(folder)
    # Whole millimetres of a 35 mm camera.
    focal = {fact.focal_px for fact in photos.facts.values()}
    assert len(focal) == 1 and abs(focal.pop() / exact.shots[0].intrinsics.fl_x - 1) < 0.02
    stated = read_geo_txt(folder / GEO_TXT, sorted(names)).by_name
    off = np.array([
        PLACE.to_local(np.array([stated[shot.path.name].xyz]))[0] - shot.T_world_camera[:3, 3]
        for shot in exact.shots
    ])
    assert {one.sigma_m for one in stated.values()} == {(0.05, 0.05, 0.05)}
    assert 0.04 < off.std() < 0.06 and abs(off.mean()) < 0.015
    assert (folder / GEO_TXT).read_text() != (
        write_photos(bundled_span(), tmp_path / "other", noise_m=0.05, seed=4) / GEO_TXT
    ).read_text()
