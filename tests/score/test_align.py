"""The truth is brought into a survey's frame by cameras: exactly, on straight flights too; not scaled."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.support.spans import on, span, wire

from plnerf.capture.similarity import Similarity
from plnerf.errors import SurveyError
from plnerf.scene.transforms import flip_camera_axes
from plnerf.score.align import Cameras, align, cameras_of, moved, true_cameras
from plnerf.score.truth import WireTruth

TRUTH = span(wire(0.0, name="A"), wire(3.0, name="B"))
TURN = Rotation.from_euler("zyx", [130, 2, -3], degrees=True).as_matrix()
MOTION = Similarity(1.0, TURN, np.array([9.0, -4.0, 70.0]))


def flight(*, bent: bool) -> dict[str, np.ndarray]:
    """Cameras beside the line, all of them in one place across it unless bent."""
    random, cameras = np.random.default_rng(2), {}
    for i in range(9):
        T = np.eye(4)
        T[:3, :3] = Rotation.from_rotvec(0.3 * random.normal(size=3)).as_matrix()
        T[:3, 3] = [5.0 * i - 20, -8.0 + bent * (i % 3), 12.0 + bent * (i % 2)]
        cameras[f"{i:04d}"] = T
    return cameras


def carried(cameras: Cameras, motion: Similarity) -> dict[str, np.ndarray]:
    """The same cameras in another frame."""
    found = {}
    for name, T in cameras.items():
        found[name] = np.eye(4)
        found[name][:3, :3], found[name][:3, 3] = motion.R @ T[:3, :3], motion(T[:3, 3])
    return found


def assert_same(one: WireTruth, other: WireTruth) -> None:
    np.testing.assert_allclose(on(one), on(other), atol=1e-9)
    for mine, theirs in zip(one.wires, other.wires, strict=True):
        np.testing.assert_allclose([*mine.a, *mine.direction], [*theirs.a, *theirs.direction], atol=1e-9)
    feet = [[tower.foot for tower in truth.towers] for truth in (one, other)]
    np.testing.assert_allclose(feet[0], feet[1], atol=1e-9)


@pytest.mark.parametrize("bent", [True, False])
def test_the_motion_is_found_exactly_even_by_a_straight_flight(bent: bool) -> None:
    cameras = flight(bent=bent)
    found, told = align(TRUTH, cameras, carried(cameras, MOTION))
    assert_same(found, moved(TRUTH, MOTION))
    assert told.cameras == 9 and told.off_m < 1e-9 and told.scale == pytest.approx(1)
    assert found.wires[0].sag_m == pytest.approx(TRUTH.wires[0].sag_m, rel=3e-3)  # it leans by 3 degrees


def test_the_scale_is_told_but_not_taken_out() -> None:
    cameras = flight(bent=True)
    found, told = align(TRUTH, cameras, carried(cameras, Similarity(1.02, MOTION.R, MOTION.shift)))
    assert told.scale == pytest.approx(1.02) and "1.02000 times as far apart" in told.words
    assert 0.05 < told.off_m < 0.3
    assert found.wires[0].span_m == pytest.approx(moved(TRUTH, MOTION).wires[0].span_m)


def test_only_images_of_both_count() -> None:
    cameras = flight(bent=True)
    some = {name: T for name, T in carried(cameras, MOTION).items() if name > "0004"}
    assert align(TRUTH, cameras, some | {"other": np.eye(4)})[1].cameras == 4
    with pytest.raises(SurveyError, match=r"2 images of .* \(2\) are also in the truth's \(9\)"):
        align(TRUTH, cameras, {name: some[name] for name in list(some)[:2]})


def test_cameras_are_read_from_scene_and_truth(tiny_scene: Path) -> None:
    cameras = cameras_of(tiny_scene)
    assert len(cameras) == 12 and "0003" in cameras
    truth = tiny_scene / "truth.json"
    truth.write_text("{}")
    assert all((true_cameras(truth)[name] == T).all() for name, T in cameras.items())
    poses = [{"name": name, "T_world_camera": flip_camera_axes(T).tolist()} for name, T in cameras.items()]
    truth.write_text(json.dumps({"poses": poses[:5]}))
    read = true_cameras(truth)
    assert len(read) == 5 and all((read[name] == cameras[name]).all() for name in read)
    truth.write_text(json.dumps({"poses": [{"name": "0000"}]}))
    with pytest.raises(SurveyError, match=r"has poses that are none \(KeyError"):
        true_cameras(truth)
