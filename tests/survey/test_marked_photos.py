"""Photos of a report: every wire is in one of them, where it is and nowhere else."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from tests.support.drawn import pinhole_cameras, scene_of

from plnerf.line.hang import hang
from plnerf.survey import marked_photos
from plnerf.survey.crops import EACH, SIDE, crops_of
from plnerf.survey.marked_photos import pictures_of
from plnerf.survey.posed_photos import Photos, photos_of

WIRES = [
    hang((x, 0.0, 0.0), (x + 1.0, 0.0, 0.0), 0.05, id=k + 1) for k, x in enumerate((-2.0, 0.0, 2.0, 9.0))
]
"""One after the other; the last is beyond all photos."""


@pytest.fixture
def photos(tmp_path: Path) -> Photos:
    """Twelve photos, of which the first two show the first wire and the last two the third."""
    x = np.array([-1.5, -1.4, *np.linspace(0.3, 0.7, 8), 2.4, 2.5])
    centres = np.stack([x, 0 * x - 1.0, 0 * x], 1)
    cameras = pinhole_cameras(centres, centres + np.array([0.0, 1.0, 0.0]))
    pictures = [np.full((*reversed(size), 3), 90, np.uint8) for size in cameras.size_px.tolist()]
    made = photos_of(scene_of(tmp_path, cameras, pictures))
    return replace(made, cameras=replace(made.cameras, centre=torch.from_numpy(centres)))


def inside(photo: np.ndarray, line: np.ndarray) -> float:
    height, width = photo.shape[:2]
    return float(((line >= 0) & (line < [width, height])).all(1).mean())


def test_every_wire_that_a_photo_shows_is_shown(photos: Photos) -> None:
    found = pictures_of(photos, WIRES, 2)
    assert 3 <= len(found) <= 4 and len({one.name for one in found}) == len(found)
    best = [max(inside(one.rgb, one.wires[k]) for one in found) for k in range(4)]
    assert min(best[:3]) > 0.3 and best[3] == 0
    assert [one.name for one in found] == sorted(one.name for one in found)
    assert len(pictures_of(photos, WIRES[1:2], 2)) == 2
    assert pictures_of(photos, [], 2) == pictures_of(photos, WIRES, 0) == ()


def test_large_photos_are_reduced_with_their_wires(photos: Photos, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = pictures_of(photos, WIRES[1:2], 1)[0]
    monkeypatch.setattr(marked_photos, "MOST_PX", max(whole.rgb.shape) // 2)
    half = pictures_of(photos, WIRES[1:2], 1)[0]
    assert half.rgb.shape[0] == whole.rgb.shape[0] // 2 and half.rgb.dtype == np.uint8
    np.testing.assert_allclose(half.wires[0], whole.wires[0] / 2, equal_nan=True)


def test_a_lens_turns_nothing_back_into_the_photo(photos: Photos) -> None:
    """With k1 = -0.3, what is 61 degrees off the axis would lie in the middle of the photo."""
    distorted = replace(photos.cameras, distortion=photos.cameras.distortion.clone())
    distorted.distortion[:, 0] = -0.3
    aside = hang((0.0, -0.5, 0.9), (1.0, -0.5, 0.9), 0.01)
    (found,) = pictures_of(replace(photos, cameras=distorted), [aside], 1)
    assert inside(found.rgb, found.wires[0]) == 0


def test_crops_show_a_possible_obstacle_from_several_sides(photos: Photos) -> None:
    """The nearest photo first; the place lies inside of each crop, where the photo shows it; none of what no
    photo shows."""
    at, on_wire = np.array([0.5, 0.0, 0.0]), np.array([0.5, 0.0, 0.1])
    found = crops_of(photos, [(at, on_wire), (np.array([50.0, 0.0, 0.0]), on_wire)])
    assert len(found) == EACH == len({one.name for one in found}) and {one.of for one in found} == {0}
    distances = photos.distances(at[None])[:, 0]
    assert found[0].name == photos.names[photos.train[int(distances.argmin())]]
    for one in found:
        size = one.rgb.shape[1::-1]
        assert (one.at >= 0).all() and (one.at < size).all() and one.wire[1] < one.at[1]
        assert max(size) <= max(photos.full_sizes_px.max() * SIDE + 1, 2)
    assert crops_of(photos, []) == ()
