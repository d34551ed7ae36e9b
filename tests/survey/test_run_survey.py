"""From a cloud, or a run, to the folder that a line engineer opens."""

import dataclasses
import json
import sys
from pathlib import Path

import laspy
import numpy as np
import pytest
import torch
from pyproj import CRS
from tests.support.drawn import hanging
from tests.support.lidar_clouds import line
from tests.support.tiny_run import Recorder, tiny_config

from plnerf.cli.main import main
from plnerf.detect.curves import Curve, write_curves
from plnerf.errors import SurveyError
from plnerf.report.deliver import SurveyOptions
from plnerf.scene.transforms import Frames
from plnerf.survey.classify import classified, ground_of, standing_on
from plnerf.survey.curve_wires import conductors_of_curves, require_upright
from plnerf.survey.field_surface import Surface, half_width, surface_points
from plnerf.survey.fit import Base
from plnerf.survey.lidar.las import read_las, survey_cloud
from plnerf.survey.model import Tower
from plnerf.survey.refine.curves import Refit, cut, of_curve
from plnerf.survey.run import survey_run
from plnerf.survey.supports import between_supports
from plnerf.train.guidance import CURVES
from plnerf.train.loop import train
from plnerf.train.run import TrainedRun, open_run

RD = np.array([230_000.0, 570_000.0, 0.0])


def write_las(path: Path, xyz: np.ndarray, crs: str | None = "EPSG:28992") -> Path:
    header = laspy.LasHeader(point_format=7, version="1.4")
    header.scales, header.offsets = [0.001] * 3, np.floor(xyz.min(0)) if len(xyz) else np.zeros(3)
    if crs is not None:
        header.add_crs(CRS(crs))
    las = laspy.LasData(header)
    las.xyz = xyz
    las.write(path)
    return path


@pytest.fixture(scope="module")
def run(built_tiny_scene: Path, tmp_path_factory: pytest.TempPathFactory) -> TrainedRun:
    folder = tmp_path_factory.mktemp("survey") / "run"
    return open_run(train(tiny_config(built_tiny_scene, steps=3), folder, Recorder()))


def test_a_cloud_becomes_a_folder_with_a_report(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    made = line(np.array([[0.0, 0.0], [110.0, 20.0]]))
    cloud = write_las(tmp_path / "line.laz", made.xyz + RD)
    words = ["plnerf", "survey", str(cloud), "--voltage-kv", "230", "--temperature-c", "35"]
    monkeypatch.setattr(sys, "argv", words)
    main()
    folder = tmp_path / "line-survey"
    said = capsys.readouterr().out
    assert f"{len(made.wires)} conductors" in said and str(folder / "report.html") in said
    names = {path.name for path in folder.iterdir()}
    assert {"report.html", "survey.json", "cloud.laz", "conductors.csv", "conductors.geojson"} <= names
    content = json.loads((folder / "survey.json").read_text())
    assert len(content["conductors"]) == len(made.wires) and len(content["towers"]) == 2
    assert content["crs"] == "EPSG:28992" and content["temperature_c"] == 35
    sags = sorted(one["sag"] for one in content["conductors"])
    # Ends lie where supports are seen, up to half a metre from the true ones: of sag that is 2 %.
    assert sags == pytest.approx(sorted(wire.sag_m for wire in made.wires), rel=0.03)
    judged = [one for one in content["clearances"] if one["required"] is not None]
    assert judged and all(one["required"] == pytest.approx(4.0 * 0.3048) for one in judged)


def test_what_is_no_cloud_of_a_line_is_told(tmp_path: Path) -> None:
    with pytest.raises(SurveyError, match="There is no cloud"):
        read_las(tmp_path / "absent.laz")
    (tmp_path / "broken.las").write_bytes(b"LASF and no more")
    with pytest.raises(SurveyError, match="cannot be read as LAS or LAZ"):
        read_las(tmp_path / "broken.las")
    degrees = write_las(tmp_path / "degrees.las", np.random.default_rng(0).random((9, 3)), "EPSG:4326")
    with pytest.raises(SurveyError, match=r"is in degrees \(WGS 84\), but metres are needed"):
        read_las(degrees)
    nowhere = write_las(tmp_path / "nowhere.las", np.eye(3), None)
    assert read_las(nowhere)[1] is None and "states no coordinate system" in read_las(nowhere)[2][0]


def test_a_cloud_without_wires_says_so(tmp_path: Path) -> None:
    made = line(np.array([[0.0, 0.0], [110.0, 20.0]]))
    bare = made.xyz[np.isin(made.truth, (2, 5))] + RD
    page = survey_cloud(write_las(tmp_path / "bare.laz", bare), tmp_path / "out", SurveyOptions())
    content = json.loads((tmp_path / "out" / "survey.json").read_text())
    assert content["conductors"] == [] and content["towers"] == []
    assert any("No wires were found" in text for text in content["caveats"])
    assert "No wires were found" in page.read_text() and not (tmp_path / "out" / "conductors.csv").exists()


def test_options_that_say_nothing_are_told(tmp_path: Path) -> None:
    with pytest.raises(SurveyError, match="no voltage is given"):
        SurveyOptions(thresholds=tmp_path / "mine.toml")


def test_a_run_is_surveyed_with_its_curves(run: TrainedRun, tmp_path: Path) -> None:
    path = run.folder / CURVES
    write_curves(path, [hanging(0.1, 0.2), hanging(-0.1, 0.1)])
    try:
        page = survey_run(run, tmp_path / "out", SurveyOptions(clearance_m=1.0))
    finally:
        path.unlink()
    content = json.loads((tmp_path / "out" / "survey.json").read_text())
    assert [one["id"] for one in content["conductors"]] == [1, 2]
    assert all(one["sag"] > 0 for one in content["conductors"])
    assert page.read_text().count("<img") >= 1  # wires over photos
    assert {"wires.ply", "cloud.laz"} <= {file.name for file in (tmp_path / "out").iterdir()}


def test_a_run_that_looked_for_no_wires_says_so(run: TrainedRun, tmp_path: Path) -> None:
    survey_run(run, tmp_path / "out", SurveyOptions())
    content = json.loads((tmp_path / "out" / "survey.json").read_text())
    assert content["conductors"] == []
    assert any("looks for no conductors in the images" in text for text in content["caveats"])


def test_a_world_on_its_side_is_not_classified(run: TrainedRun, tmp_path: Path) -> None:
    aside = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
    frames = dataclasses.replace(run.scene.frames, R_scene_world=aside)
    turned = dataclasses.replace(run, scene=dataclasses.replace(run.scene, frames=frames))
    survey_run(turned, tmp_path / "out", SurveyOptions())
    content = json.loads((tmp_path / "out" / "survey.json").read_text())
    assert any("z is not up, so that nothing is classified" in text for text in content["caveats"])
    assert {one["code"] for one in content["points_by_class"]} <= {1}


def test_a_surface_is_the_same_twice_and_in_the_world(run: TrainedRun) -> None:
    one, other = surface_points(run, rays=3000), surface_points(run, rays=3000)
    assert (one.xyz == other.xyz).all() and len(one.xyz) <= 3000
    assert (one.sigma > 0).all() and np.isfinite(one.xyz).all() and one.rgb.dtype == np.uint8


def test_half_widths_are_those_of_normal_light() -> None:
    t = torch.linspace(0, 10, 2001)[None].double()
    for sigma in (0.1, 0.7):
        middle = (t[:, 1:] + t[:, :-1]) / 2
        w = torch.exp(-((middle - 5) ** 2) / (2 * sigma**2))
        assert half_width(t, 0.6 * w / w.sum())[0] == pytest.approx(sigma, rel=0.02)


def test_curves_become_catenaries_where_they_hang() -> None:
    turn = np.array([[0.6, 0.8, 0], [-0.8, 0.6, 0], [0, 0, 1.0]])
    frames = Frames(turn, 0.05, np.array([500.0, 60.0, 7.0]), "m", None, "file")
    curves = (hanging(-0.1, 0.0), hanging(0.1, 0.08))
    points = frames.to_world(curves[0].points(np.linspace(-0.9, 0.0, 400)))
    top, low = conductors_of_curves([as_it_was(curve, frames) for curve in curves], frames, points)
    assert top.evidence == 0 and top.note == "The field shows no point of it." and top.coverage == 0
    assert low.coverage == pytest.approx(0.5, abs=0.02) and low.longest_gap_m == pytest.approx(18, abs=0.5)
    assert low.fit.curve.sag_m == pytest.approx(0.04 / 0.05, abs=1e-3)
    world = low.fit.curve.points(np.linspace(0, 1, 50) * low.fit.curve.span_m)
    back = frames.to_scene(world)
    assert np.abs(back - curves[0].points(back[:, 0])).max() < 2e-4  # a parabola is no catenary
    require_upright(frames)
    with pytest.raises(SurveyError, match="a world with z up"):
        require_upright(dataclasses.replace(frames, R_scene_world=turn[[0, 2, 1]]))


def test_a_conductor_tells_what_its_refit_was_and_what_its_supports_add() -> None:
    frames = Frames(np.eye(3), 0.05, np.zeros(3), "m", None, "file")
    refit = as_it_was(hanging(0.0, 0.0), frames)
    refused = dataclasses.replace(refit, images=2, refused="2 images show it")
    (wire,) = conductors_of_curves([refused], frames, np.zeros((0, 3)))
    assert wire.note == "The field shows no point of it. It is not refitted to the images: 2 images show it."
    assert wire.source == "2 images, and 0 points of the field"
    assert wire.before is not None and (wire.before.q == wire.fit.q).all()
    held_refit = dataclasses.replace(refit, end_sigma=(0.15, 0.15))
    (held,) = conductors_of_curves([held_refit], frames, np.zeros((0, 3)))
    # 0.15 m at either end of 36 m, of a sag of 0.8 m.
    of_ends = np.sqrt(2) * 2 * 0.8 / 36 * 0.15
    assert held.fit.sag_sigma_m == pytest.approx(np.hypot(wire.fit.sag_sigma_m, of_ends), rel=1e-3)


def as_it_was(curve: Curve, frames: Frames) -> Refit:
    """Without a refit."""
    base = Base(np.array([curve.ends[0], 0.0]), np.array([1.0, 0.0]), curve.ends[1] - curve.ends[0])
    line = cut(base, of_curve(curve, base), np.eye(5) * curve.sigma**2, curve.ends, frames)
    return Refit(line, line, 9, None)


def test_points_on_a_conductor_are_its_own() -> None:
    frames = Frames(np.eye(3), 0.05, np.array([0.0, 0.0, 12.0]), "m", None, "file")
    (wire,) = conductors_of_curves([as_it_was(hanging(0.0, 0.0), frames)], frames, np.zeros((0, 3)))
    xy = np.random.default_rng(0).uniform(-18, 18, (4000, 2))
    floor = np.column_stack([xy, 0.02 * xy[:, 0]])
    on = wire.fit.curve.points(np.linspace(0, wire.fit.curve.span_m, 50))
    bush = np.random.default_rng(1).normal(size=(60, 3)) * 0.3 + [3, 5, 2.0]
    xyz = np.concatenate([floor, on, bush])
    sight = np.tile([0.0, 1.0, 0.0], (len(xyz), 1))
    surface = Surface(xyz, np.zeros((len(xyz), 3), np.uint8), np.full(len(xyz), 0.02), sight)
    none = np.zeros(len(xyz), bool)
    ground = ground_of(surface, [wire.fit.curve], none)
    cloud, notes = classified(surface, ground, [wire], none)
    assert (cloud.wire[4000:4050] == 1).all() and (cloud.label[4000:4050] == 14).all()
    assert (cloud.label[:4000] == 2).mean() > 0.99 and np.isin(cloud.label[4050:], (4, 5)).mean() > 0.9
    assert len(notes) == 1 and cloud.rgb is not None and cloud.sigma_m is not None
    sunk = Tower(np.array([4.0, 4.0, -3.0]), 15.0)
    (tower,) = standing_on(ground, [sunk])
    assert tower.foot[2] == pytest.approx(0.08, abs=0.05) and tower.foot[2] + tower.height_m == 12.0
    assert standing_on(None, [sunk]) == (sunk,)


@pytest.mark.parametrize("seen", [(True, True), (True, False), (False, False)])
def test_wires_end_at_the_supports_that_the_surface_shows(seen: tuple[bool, bool]) -> None:
    """Columns at x = -15 and 16 m under wires that go on to 18 m; plants under the wires are no supports."""
    frames = Frames(np.eye(3), 0.05, np.array([7.0, -3.0, 12.0]), "m", None, "file")
    curves = [hanging(-0.1, 0.0), hanging(0.1, 0.08)]
    random = np.random.default_rng(0)
    floor = np.column_stack([random.uniform(-20, 20, (4000, 2)), np.full(4000, -10.0)])
    bush = random.uniform([-1, -1, -10], [1, 1, -6], (300, 3))
    parts = [floor, bush]
    for x, there in zip((-15.0, 16.0), seen, strict=True):
        if there:
            parts.append(random.uniform([x - 0.4, -2, -10], [x + 0.4, 2, 1.5], (900, 3)))
    xyz = np.concatenate(parts) + frames.shift_world
    along = np.tile([0.0, 1.0, 0.0], (len(xyz), 1))
    surface = Surface(xyz, np.zeros((len(xyz), 3), np.uint8), np.full(len(xyz), 0.02), along)
    shorter, found = between_supports(surface, surface, curves, frames)
    ends = [-15.0 if seen[0] else -18.0, 16.0 if seen[1] else 18.0]
    for curve in shorter:
        assert np.array(curve.ends) / 0.05 == pytest.approx(ends, abs=0.05)
    assert len(found.towers) == sum(seen) and not found.points[:4300].any()
    assert tuple(one is not None for one in found.held) == seen
    for tower, x in zip(found.towers, (-15.0, 16.0), strict=False):
        assert tower.foot == pytest.approx([x + 7, -3, 2], abs=0.15)
        assert tower.height_m == pytest.approx(11.5, abs=0.1)


def test_what_ends_below_the_wires_is_no_support() -> None:
    frames = Frames(np.eye(3), 0.05, np.zeros(3), "m", None, "file")
    random = np.random.default_rng(0)
    floor = np.column_stack([random.uniform(-20, 20, (4000, 2)), np.full(4000, -10.0)])
    for top, towers in ((-2.0, 0), (1.5, 1)):
        column = random.uniform([-15.4, -2, -10], [-14.6, 2, top], (900, 3))
        xyz = np.concatenate([floor, column])
        along = np.tile([0.0, 1.0, 0.0], (len(xyz), 1))
        surface = Surface(xyz, np.zeros((len(xyz), 3), np.uint8), np.full(len(xyz), 0.02), along)
        _, found = between_supports(surface, surface, [hanging(-0.1, 0.0), hanging(0.1, 0.08)], frames)
        assert len(found.towers) == towers


def test_a_crown_that_hides_the_ground_is_no_ground() -> None:
    random = np.random.default_rng(0)
    xy = random.uniform(-20, 20, (9000, 2))
    hidden = np.hypot(*(xy - [4, 4]).T) < 5
    floor = np.column_stack([xy[~hidden], random.normal(0, 0.03, (~hidden).sum())])
    crown = random.normal(size=(1500, 3)) * [1.2, 1.2, 0.9] + [4, 4, 4.0]
    xyz = np.concatenate([floor, crown])
    n = len(xyz)
    surface = Surface(xyz, np.zeros((n, 3), np.uint8), np.full(n, 0.05), np.tile([0.0, 1.0, 0.0], (n, 1)))
    ground = ground_of(surface, [], np.zeros(n, bool))
    assert ground is not None and abs(float(ground.above(np.array([[4.0, 4.0, 0.0]]))[0])) < 0.2


def test_ground_that_is_known_to_a_metre_only_is_no_crown() -> None:
    random = np.random.default_rng(0)
    xyz = np.column_stack([random.uniform(-20, 20, (9000, 2)), random.normal(0, 0.8, 9000)])
    down = np.tile([0.0, 0.0, -1.0], (len(xyz), 1))
    surface = Surface(xyz, np.zeros((len(xyz), 3), np.uint8), np.full(len(xyz), 0.8), down)
    assert ground_of(surface, [], np.zeros(len(xyz), bool)) is not None
