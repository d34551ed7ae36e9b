"""Wires hung in a captured scene: the photos, their truth, and that a survey can be scored by it."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, JpegImagePlugin
from scipy.spatial import cKDTree
from tests.support.flown_ground import FOCAL, HIGH, views, write_capture

from plnerf.errors import ConfigError, SceneError
from plnerf.scene.formats import has_poses, read_listing
from plnerf.score.align import true_cameras
from plnerf.score.truth import read_truth
from plnerf.synth.hang_config import ChooseConfig, DrawConfig, HangConfig, HangDepthConfig
from plnerf.synth.hang_depth import Depth, photo_depths
from plnerf.synth.hang_scene import hang_in_photos
from plnerf.synth.hang_truth import summary_of
from plnerf.synth.hang_views import PhotoView, photo_views, upright

pytestmark = pytest.mark.slow

DEPTH = HangDepthConfig(longest_px=120, partners=4, range_steps=40)
CHOOSE = ChooseConfig(groups=2, wires=(2, 2), candidates=30, stations=40)
CONFIG = HangConfig(3, CHOOSE, DrawConfig(samples=3), DEPTH)


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_capture(tmp_path_factory.mktemp("flown") / "scene")


@pytest.fixture(scope="module")
def hung(capture: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return hang_in_photos(capture, tmp_path_factory.mktemp("hung") / "out", CONFIG)


def pixels(path: Path) -> np.ndarray:
    return np.asarray(Image.open(path)).astype(int)


def posed(capture: Path) -> list[PhotoView]:
    return photo_views(read_listing(capture), np.array([0.0, 0.0, 1.0]))


@pytest.fixture(scope="module")
def depths(capture: Path) -> list[Depth]:
    return photo_depths(posed(capture), DEPTH, lambda done, of: None)


@pytest.fixture
def measured(depths: list[Depth], monkeypatch: pytest.MonkeyPatch) -> None:
    """Depths that are measured again are these: of the same photos by the same settings."""
    monkeypatch.setattr("plnerf.synth.hang_scene.photo_depths", lambda *_: depths)


def test_the_depth_of_the_ground_is_measured(depths: list[Depth]) -> None:
    for depth in depths:
        assert depth.known.mean() > 0.3
        assert abs(np.median(depth.z[depth.known]) / HIGH - 1) < 0.03
        assert (np.abs(depth.z / HIGH - 1) < 0.1).mean() > 0.9


def test_photos_and_truth_are_all_there_is(capture: Path, hung: Path) -> None:
    assert sorted(path.name for path in hung.iterdir()) == ["images", "truth.json"]
    assert [path.name for path in sorted((hung / "images").iterdir())] == [view.name for view in views()]
    assert not has_poses(hung)


def test_photos_change_where_wires_are_and_nowhere_else(capture: Path, hung: Path) -> None:
    """By the truth alone: its curves, its poses, its diameters, through the scene's lens."""
    truth, cameras = read_truth(hung / "truth.json"), true_cameras(hung / "truth.json")
    changed_somewhere = 0
    for view in posed(capture):
        np.testing.assert_allclose(cameras[Path(view.name).stem][:3, 3], view.centre, atol=1e-9)
        before, after = pixels(view.path), pixels(hung / "images" / view.name)
        changed = np.abs(after - before).max(2) > 25
        near = np.zeros(changed.shape, np.bool_)
        y, x = np.indices(changed.shape) + 0.5
        for wire in truth.wires:
            assert wire.diameter_m is not None
            pixel, z, ahead = view.project(wire.points(np.linspace(0, wire.base.length_m, 3000)))
            if not ahead.any():
                continue
            off, vertex = cKDTree(pixel[ahead]).query(np.stack([x, y], -1))
            near |= off < 0.75 * wire.diameter_m * FOCAL / z[ahead][vertex] + 3
        assert not (changed & ~near).any(), view.name
        changed_somewhere += int(changed.sum())
    assert changed_somewhere > 1000


def test_the_truth_says_where_and_how_wide_wires_are_seen(hung: Path) -> None:
    content = json.loads((hung / "truth.json").read_text())
    assert len(content["conductors"]) >= 3
    for wire in content["conductors"]:
        widths = np.array([image["width_px"] for image in wire["images"]])
        assert 3 * 0.8 <= widths[:, 2].max() <= 8 * 1.2
        seen = sum(high - low for low, high in wire["seen_m"])
        assert seen > 2.0
        profile = {key: np.array(value) for key, value in wire["profile"].items()}
        inside = np.any([(profile["s_m"] >= a) & (profile["s_m"] <= b) for a, b in wire["seen_m"]], axis=0)
        assert (profile["images"][inside] >= CHOOSE.least_images).all()
        assert (profile["angle_deg"][inside] >= CHOOSE.least_angle_deg - 0.01).all()
        z = np.array(wire["polyline"])[:, 2]
        assert ((HIGH - z) / HIGH > 0.55).all() and ((HIGH - z) / HIGH < 0.95).all()
    first, last = (np.array(content["conductors"][i]["direction"]) for i in (0, -1))
    assert abs(first @ last) < np.cos(np.radians(CHOOSE.turned_deg - 1))
    assert summary_of(hung).count("\n") == len(content["conductors"]) - 1


def test_photos_are_written_as_they_were(capture: Path, hung: Path) -> None:
    for path in (capture / "images").iterdir():
        one, other = Image.open(path), Image.open(hung / "images" / path.name)
        assert isinstance(one, JpegImagePlugin.JpegImageFile)
        assert isinstance(other, JpegImagePlugin.JpegImageFile)
        assert one.quantization == other.quantization and other.getexif()[0x010F] == "maker"
        assert JpegImagePlugin.get_sampling(one) == JpegImagePlugin.get_sampling(other)


def test_the_seed_decides(capture: Path, hung: Path, request: pytest.FixtureRequest, tmp_path: Path) -> None:
    again = hang_in_photos(capture, tmp_path / "again", CONFIG)
    request.getfixturevalue("measured")
    other = hang_in_photos(capture, tmp_path / "other", replace(CONFIG, seed=4))
    for path in (hung / "images").iterdir():
        assert (again / "images" / path.name).read_bytes() == path.read_bytes()
    one, two = (json.loads((folder / "truth.json").read_text())["conductors"] for folder in (again, other))
    assert one == json.loads((hung / "truth.json").read_text())["conductors"] != two


@pytest.mark.usefixtures("measured")
def test_a_direction_can_be_given(capture: Path, tmp_path: Path) -> None:
    config = replace(CONFIG, choose=replace(CHOOSE, groups=1, azimuth_deg=40.0))
    folder = hang_in_photos(capture, tmp_path / "out", config)
    for wire in json.loads((folder / "truth.json").read_text())["conductors"]:
        np.testing.assert_allclose(wire["direction"], [np.sin(np.radians(40)), np.cos(np.radians(40))])


def test_one_track_fixes_no_wire_along_it(tmp_path: Path) -> None:
    scene = write_capture(tmp_path / "scene", tracks=(0.0,), each=6)
    config = replace(CONFIG, choose=replace(CHOOSE, azimuth_deg=90.0, groups=1))
    with pytest.raises(SceneError, match="from sides that differ by 10 degrees"):
        hang_in_photos(scene, tmp_path / "out", config)
    assert not (tmp_path / "out").exists()


def test_a_folder_that_is_there_is_left_alone(capture: Path, tmp_path: Path) -> None:
    (tmp_path / "mine").write_text("mine")
    with pytest.raises(SceneError, match="is not empty"):
        hang_in_photos(capture, tmp_path, CONFIG)


@pytest.mark.parametrize(
    "wrong", [{"depth": (0.5, 1.2)}, {"width_px": (5.0, 3.0)}, {"wires": (3, 2)}, {"least_angle_deg": 95.0}]
)
def test_settings_that_cannot_be_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ConfigError, match="hang:"):
        ChooseConfig(**wrong)  # type: ignore[arg-type]


def test_a_world_is_turned_upright() -> None:
    up = np.array([0.3, -0.2, 0.9])
    np.testing.assert_allclose(upright(up) @ up, [0, 0, np.linalg.norm(up)], atol=1e-12)
    np.testing.assert_array_equal(upright(np.array([0.0, 0.0, 2.0])), np.eye(3))


@pytest.mark.data
def test_wires_are_hung_in_the_fox(shared_data: Path, tmp_path: Path) -> None:
    """Twelve of its photos, at full size: their poses have a unit of their own, and z is not up."""
    scene = tmp_path / "fox"
    content = json.loads((shared_data / "fox" / "transforms.json").read_text())
    content["frames"] = sorted(content["frames"], key=lambda frame: str(frame["file_path"]))[::6]
    (scene / "images").mkdir(parents=True)
    for frame in content["frames"]:
        (scene / frame["file_path"]).symlink_to(shared_data / "fox" / frame["file_path"])
    (scene / "transforms.json").write_text(json.dumps(content))
    choose = replace(CHOOSE, groups=1, candidates=60)
    out = hang_in_photos(scene, tmp_path / "out", HangConfig(0, choose, depth=replace(DEPTH, partners=3)))
    truth = json.loads((out / "truth.json").read_text())
    assert truth["unit"] == "unscaled" and len(truth["conductors"]) >= 1
    for wire in truth["conductors"]:
        assert len(wire["images"]) >= CHOOSE.least_images and wire["seen_m"]
    assert read_truth(out / "truth.json").wires
