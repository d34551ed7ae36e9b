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
from plnerf.score.align import Cameras, align, cameras_of, is_unscaled, true_cameras
from plnerf.score.truth import Truth

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


def assert_same(one: Truth, other: Truth) -> None:
    np.testing.assert_allclose(on(one), on(other), atol=1e-9)
    for mine, theirs in zip(one.wires, other.wires, strict=True):
        np.testing.assert_allclose([*mine.base.a, *mine.base.b], [*theirs.base.a, *theirs.base.b], atol=1e-9)
    feet = [[structure.foot for structure in truth.structures] for truth in (one, other)]
    np.testing.assert_allclose(feet[0], feet[1], atol=1e-9)


@pytest.mark.parametrize("bent", [True, False])
def test_the_motion_is_found_exactly_even_by_a_straight_flight(bent: bool) -> None:
    cameras = flight(bent=bent)
    found, how = align(TRUTH, cameras, carried(cameras, MOTION))
    assert_same(found, TRUTH.moved(MOTION))
    assert how.cameras == 9 and how.off_m < 1e-9 and how.scale == pytest.approx(1)
    sags = [truth.wires[0].sag.value for truth in (found, TRUTH)]
    assert sags[0] == pytest.approx(sags[1], rel=3e-3)  # it leans by 3 degrees


def test_the_scale_is_told_but_not_taken_out() -> None:
    cameras = flight(bent=True)
    found, how = align(TRUTH, cameras, carried(cameras, Similarity(1.02, MOTION.R, MOTION.shift)))
    assert how.scale == pytest.approx(1.02) and "1.02000 times as far apart" in how.words
    assert 0.05 < how.off_m < 0.3
    assert found.wires[0].span_m.value == pytest.approx(TRUTH.moved(MOTION).wires[0].span_m.value)


def test_a_truth_without_a_scale_takes_the_survey_s() -> None:
    cameras, motion = flight(bent=True), Similarity(0.3, MOTION.R, MOTION.shift)
    found, how = align(TRUTH, cameras, carried(cameras, motion), scaled=True)
    assert_same(found, TRUTH.moved(motion))
    assert how.scale == pytest.approx(0.3) and how.off_m < 1e-9 and "scaled by 9 cameras" in how.words


def test_a_truth_says_whether_it_has_a_scale(tmp_path: Path) -> None:
    for unit, unscaled in (("m", False), ("unscaled", True), (None, False)):
        (tmp_path / "truth.json").write_text(json.dumps({} if unit is None else {"unit": unit}))
        assert is_unscaled(tmp_path / "truth.json") == unscaled


def test_a_truth_that_leans_keeps_its_wires_where_they_are() -> None:
    """A leaning catenary is none: by 3 degrees it is one to 5 mm, by a tenth of a degree to 0.1 mm."""
    for degrees, most in ((3.0, 5e-3), (0.1, 1e-4), (0.0, 1e-9)):
        R = Rotation.from_euler("zyx", [130, degrees, -degrees], degrees=True).as_matrix()
        motion = Similarity(1.0, R, np.array([9.0, -4.0, 70.0]))
        there = TRUTH.moved(motion)
        for wire_there, true in zip(there.wires, TRUTH.wires, strict=True):
            local = wire_there.base.local(motion(true.polyline()))
            assert np.abs(wire_there.at(local[:, 0]) - local[:, 1:]).max() < most


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
