"""The doctor knows good flights from those that see nothing of a wire, before anything is trained."""

import json
import math
import shutil
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from tests.conftest import look_at

import plnerf
from plnerf.cli.main import main
from plnerf.doctor.config import SCENES, SceneDoctorConfig
from plnerf.doctor.coverage import Diagnosis, advice
from plnerf.doctor.scene_doctor import examine_scene, table, to_json
from plnerf.errors import ConfigError, SceneError

BUNDLED = Path(plnerf.__file__).parent / "data" / "span"
AZIMUTH_DEG = 90 - math.degrees(0.3)
"""Of a line that is turned by 0.3 rad from east towards north, as `flight` has it."""


def flight(folder: Path, *passes: tuple[float, float], unit: str = "m", turn_rad: float = 0.3) -> Path:
    """A scene of passes (across, height) straight along a line at an angle to x; each camera looks at it."""
    (folder / "images").mkdir(parents=True)
    Image.fromarray(np.zeros((32, 48, 3), np.uint8)).save(folder / "images/0.png")
    c, s = math.cos(turn_rad), math.sin(turn_rad)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    frames = []
    for i, (across, height) in enumerate(passes):
        for k, x in enumerate(np.linspace(-22, 22, 23)):
            pose = look_at(turn @ np.array([x, across, height]), turn @ np.array([x, 0.0, 9.0]))
            name = f"images/{i}_{k:02d}.png"
            (folder / name).write_bytes((folder / "images/0.png").read_bytes())
            opengl = pose @ np.diag([1.0, -1.0, -1.0, 1.0])
            frames.append({"file_path": name, "transform_matrix": opengl.tolist()})
    ours = {"format_version": 1, "unit": unit, "up": [0, 0, 1]}
    data = {
        "w": 48,
        "h": 32,
        "fl_x": 40.0,
        "fl_y": 40.0,
        "cx": 24,
        "cy": 16,
        "plnerf": ours,
        "frames": frames,
    }
    (folder / "transforms.json").write_text(json.dumps(data))
    return folder


def examined(scene: Path, **options: float) -> Diagnosis:
    return examine_scene(scene, config=SceneDoctorConfig(wire_diameter_m=0.3, sigma_px=0.1), **options)


@pytest.mark.parametrize("told", [{}, {"azimuth_deg": AZIMUTH_DEG}], ids=["track", "azimuth"])
def test_one_pass_along_the_wire_sees_nothing_of_it(told: dict[str, float], tmp_path: Path) -> None:
    found = examined(flight(tmp_path / "a", (8.0, 9.0)), **told)
    assert {stretch.verdict for stretch in found.stretches} == {"unobservable"} and not found.usable
    for stretch in found.stretches:
        assert stretch.sigma_m == math.inf and stretch.spread_deg < 0.01 and stretch.views >= 1
        assert stretch.baseline_deg is not None and stretch.baseline_deg < 0.1
    assert "second pass that sees the wires from another angle" in table(found) and "Not usable" in table(
        found
    )


@pytest.mark.parametrize("second", [(8.0, 15.0), (-8.0, 12.0)], ids=["other height", "other side"])
def test_a_second_pass_makes_it_good(second: tuple[float, float], tmp_path: Path) -> None:
    """The track of two passes far apart is not elongated: the line's azimuth is stated."""
    found = examined(flight(tmp_path / "a", (8.0, 9.0), second), azimuth_deg=AZIMUTH_DEG)
    inner = found.stretches[2:-2]
    assert {stretch.verdict for stretch in inner} == {"good"} and found.usable
    assert all(stretch.spread_deg > 5 and 0 < (stretch.sigma_best_m or 0) < 0.1 for stretch in inner)


def test_level_views_from_both_sides_at_one_height_are_no_second_angle(tmp_path: Path) -> None:
    """Of a wire at the cameras' own height nothing more is known: both passes share one plane with it."""
    scene = flight(tmp_path / "a", (8.0, 8.98), (-8.0, 8.98), turn_rad=0.0)
    found = examined(scene, distance=8.0, azimuth_deg=90.0)
    assert {stretch.verdict for stretch in found.stretches} == {"unobservable"}
    other = examined(flight(tmp_path / "b", (8.0, 8.98), (-8.0, 6.98)), distance=8.0, azimuth_deg=AZIMUTH_DEG)
    assert {stretch.verdict for stretch in other.stretches[2:-2]} == {"good"}


def test_stretches_follow_one_another_over_the_whole_flight(tmp_path: Path) -> None:
    found = examined(flight(tmp_path / "a", (8.0, 9.0), (8.0, 15.0)), azimuth_deg=AZIMUTH_DEG)
    ends = [(stretch.from_m, stretch.to_m) for stretch in found.stretches]
    assert ends[0][0] == 0 and ends[-1][1] == pytest.approx(44, abs=1e-4)
    assert all(a[1] == pytest.approx(b[0]) for a, b in pairwise(ends))


def test_wires_of_a_hairs_width_are_seen_by_no_camera(tmp_path: Path) -> None:
    scene = flight(tmp_path / "a", (8.0, 9.0), (8.0, 15.0))
    thin = examine_scene(scene, config=SceneDoctorConfig(wire_diameter_m=1e-3))
    assert {stretch.verdict for stretch in thin.stretches} == {"unseen"} and not thin.usable


def test_the_stated_azimuth_decides_the_direction_of_the_wires(tmp_path: Path) -> None:
    """One pass along the line, above it, if the wires ran across it: every view has its own plane."""
    scene = flight(tmp_path / "a", (8.0, 15.0))
    across = examined(scene, azimuth_deg=AZIMUTH_DEG + 90)
    assert across.box.endswith(f"at an azimuth of {AZIMUTH_DEG + 90:g}°") and across.usable
    assert all((stretch.baseline_deg or 0) > 89 for stretch in across.stretches)
    assert examined(scene).box.endswith("along the cameras' track")


def test_the_distance_of_what_a_capture_sees_stands_for_that_of_its_wires(tmp_path: Path) -> None:
    scene = tmp_path / "scene"
    shutil.copytree(BUNDLED, scene)
    (scene / "capture.json").write_text(json.dumps({"view_distance": 43.21}))
    assert "about 43.2 m away" in examine_scene(scene).box
    assert "about 12 m away" in examine_scene(scene, distance=12.0).box


def test_an_unscaled_scene_is_judged_by_shares_of_the_distance(tmp_path: Path) -> None:
    scene = flight(tmp_path / "a", (8.0, 9.0), (8.0, 15.0), unit="unscaled")
    data = json.loads((scene / "transforms.json").read_text())
    found = examined(scene, distance=10.0)
    for frame in data["frames"]:
        matrix = np.array(frame["transform_matrix"])
        matrix[:3, 3] *= 7.0
        frame["transform_matrix"] = matrix.tolist()
    (scene / "transforms.json").write_text(json.dumps(data))
    larger = examined(scene, distance=70.0)
    assert [s.verdict for s in larger.stretches] == [s.verdict for s in found.stretches]
    pairs = zip(found.stretches, larger.stretches, strict=True)
    assert all((b.sigma_m or 0) == pytest.approx(7 * (a.sigma_m or 0), rel=1e-3) for a, b in pairs)
    assert all(stretch.wire_px is None for stretch in found.stretches)


def test_what_the_search_would_not_trust_is_not_called_good(tmp_path: Path) -> None:
    """A second pass that hardly differs: known to centimetres, which is several pixels so near by."""
    scene = flight(tmp_path / "a", (3.0, 9.0), (3.0, 9.4))
    sharp, coarse = (
        examine_scene(scene, distance=3.0, config=SceneDoctorConfig(wire_diameter_m=0.1, sigma_px=px))
        for px in (0.02, 1.0)
    )
    for one, other in zip(sharp.stretches[2:-2], coarse.stretches[2:-2], strict=True):
        assert (other.sigma_px or 0) == pytest.approx(50 * (one.sigma_px or 0), rel=1e-3)
        assert (other.sigma_m or 0) < 1 and (other.sigma_px or 0) > SCENES.good_px and other.verdict == "poor"
        assert one.verdict == "good" and one.wire_px is not None
        footprint = 0.1 / one.wire_px  # of a pixel
        assert one.sigma_px == pytest.approx((one.sigma_m or 0) / footprint, rel=0.3)  # medians of points
    assert sharp.usable and not coarse.usable
    assert "too little to place a wire within 3 px" in table(coarse)


def test_the_bundled_span_is_good_and_its_json_is_strict() -> None:
    found = examine_scene(BUNDLED)
    assert found.usable and [stretch.verdict for stretch in found.stretches[:-2]] == ["good"] * 18
    content = json.loads(json.dumps(to_json(found), allow_nan=False))
    assert content["unit"] == "m" and content["stretches"][5]["verdict"] == "good"
    assert content["stretches"][5]["sigma_m"] < 0.05
    assert content["settings"]["sigma_px"] == 0.5 and content["usable"] is True


def test_the_command_writes_and_ends_with_its_status(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    one = flight(tmp_path / "one", (8.0, 9.0))
    two = flight(tmp_path / "two", (8.0, 9.0), (8.0, 15.0))
    for scene, status in ((one, 3), (two, 0)):
        words = ["plnerf", "doctor", str(scene), "-o", str(tmp_path / "d.json"), "--wire-diameter", "0.3"]
        words += ["--line-azimuth", str(AZIMUTH_DEG)]
        monkeypatch.setattr(sys, "argv", words)
        with pytest.raises(SystemExit) as stop:
            main()
        assert stop.value.code == status
        out = capsys.readouterr().out
        assert "along the line m" in out and str(tmp_path / "d.json") in out
        content = json.loads((tmp_path / "d.json").read_text())
        assert content["usable"] is (status == 0)
        assert {s["advice"] for s in content["stretches"]} <= set(advice(SCENES).values())
    assert content["stretches"][5]["sigma_m"] > 0


def test_wrong_numbers_are_refused() -> None:
    with pytest.raises(SceneError, match="The distance must be a positive number, but is -1"):
        examine_scene(BUNDLED, distance=-1.0)
    with pytest.raises(SceneError, match="The line's azimuth must be in degrees, but is nan"):
        examine_scene(BUNDLED, azimuth_deg=math.nan)
    for name, value in (("sigma_px", -1.0), ("wire_diameter_m", math.nan), ("stretches", 0)):
        with pytest.raises(ConfigError, match=f"The doctor's {name} must be a positive number"):
            SceneDoctorConfig(**{name: value})
    with pytest.raises(ConfigError, match="needs depths greater than 0"):
        SceneDoctorConfig(depths=())


def test_the_configuration_decides() -> None:
    coarse = examine_scene(BUNDLED, config=SceneDoctorConfig(stretches=4, good_px=1e-6))
    assert len(coarse.stretches) == 4 and not coarse.usable
    assert {stretch.verdict for stretch in coarse.stretches} == {"poor"}
    assert "within 1e-06 px" in table(coarse)
