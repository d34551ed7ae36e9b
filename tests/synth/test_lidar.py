"""Simulated flights: points lie on what stands there, and truth.json says how far wires are from it."""

import json
from dataclasses import replace
from pathlib import Path

import laspy
import numpy as np
import pytest
from scipy.spatial import cKDTree

from plnerf.errors import ConfigError
from plnerf.score.intervals import ANY_CURVE
from plnerf.score.truth import read_truth
from plnerf.synth.config import PlantsConfig
from plnerf.synth.lidar import CLOUD, simulate_lidar
from plnerf.synth.lidar_bodies import Bodies, Targets, hung, lidar_site, still_bodies
from plnerf.synth.lidar_config import LidarScene, ScanConfig, WindConfig, random_lidar_scene
from plnerf.synth.site import Site

WINDY = WindConfig((-1.0, 1.0), (0.1, -0.05))


@pytest.fixture(scope="module")
def scene() -> LidarScene:
    """A drawn one with few plants, a sparse and a nearly exact scanner, and wind."""
    drawn = random_lidar_scene(2)
    plants = PlantsConfig(trees=2, bushes=2, background=0, near=1, reach_m=40.0)
    scan = replace(drawn.scan, pulses_per_m2=2.0, range_sd_m=0.001, pointing_sd_m=0.001, strip_sd_m=0.0)
    return replace(drawn, span=replace(drawn.span, plants=plants, houses=1), scan=scan, wind=WINDY)


@pytest.fixture(scope="module")
def site(scene: LidarScene) -> Site:
    return lidar_site(scene)


@pytest.fixture(scope="module")
def bodies(scene: LidarScene, site: Site) -> tuple[Targets, Bodies]:
    return still_bodies(site, scene, np.random.default_rng(0))


@pytest.fixture(scope="module")
def folder(scene: LidarScene, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return simulate_lidar(tmp_path_factory.mktemp("lidar"), scene)


@pytest.mark.slow
def test_points_lie_on_what_is_there(
    scene: LidarScene, site: Site, folder: Path, bodies: tuple[Targets, Bodies]
) -> None:
    points = np.asarray(laspy.read(folder / CLOUD).xyz)
    strips = range(len(scene.scan.across_m))
    wires = np.concatenate([hung(wire, scene, strip) for wire in site.wires for strip in strips])
    on_ground = np.abs(points[:, 2] - site.ground.heights(points[:, 0], points[:, 1])) < 0.02
    apart = cKDTree(np.concatenate([bodies[0].at, wires])).query(points[~on_ground])[0]
    assert apart.max() < scene.scan.footprint_m + 0.05
    assert (cKDTree(wires).query(points)[0] < scene.scan.footprint_m + 0.05).sum() > 100
    assert 0.8 < on_ground.mean() < 1.0


@pytest.mark.slow
def test_strips_are_off_each_other_and_by_nothing_together(
    scene: LidarScene, site: Site, tmp_path: Path
) -> None:
    """The truth is where all of a cloud is: nothing in it shows a shift that its strips share."""
    shifted = replace(scene, scan=replace(scene.scan, strip_sd_m=0.1))
    las = laspy.read(simulate_lidar(tmp_path, shifted) / CLOUD)
    up = np.asarray(las.z) - site.ground.heights(np.asarray(las.x), np.asarray(las.y))
    first, last = (float(np.median(up[las.point_source_id == strip])) for strip in (1, 2))
    assert abs(first) > 0.01 and first == pytest.approx(-last, abs=0.005)


@pytest.mark.slow
def test_the_truth_is_how_wires_hang_on_average(
    scene: LidarScene, site: Site, folder: Path, bodies: tuple[Targets, Bodies]
) -> None:
    rows = json.loads((folder / "truth.json").read_text())["conductors"]
    truth = read_truth(folder / "truth.json", ANY_CURVE)
    for row, true, wire in zip(rows, truth.wires, site.lines[0].spans[1].wires, strict=True):
        mean = np.mean([hung(wire, scene, strip) for strip in (0, 1)], axis=0)
        line = np.array(row["polyline"])
        assert cKDTree(mean).query(line)[0].max() < 1e-4
        leaf = cKDTree(mean).query(bodies[1].leaves[::40])[0].min()
        assert leaf - 0.6 < row["clearances"]["vegetation"] <= leaf
        assert true.length_m == pytest.approx(wire.length_m, rel=0.01)


def test_strings_lean_along_the_line_and_take_their_wires_along(scene: LidarScene) -> None:
    def places(lean_deg: float) -> np.ndarray:
        leaning = lidar_site(replace(scene, lean_deg=((lean_deg,) * len(scene.lean_deg[0]),) * 4)).lines[0]
        wires = [wire for span in leaning.spans for wire in span.wires]
        ends = [wire.points(np.array([0.0, wire.base.length_m])) for wire in wires]
        return np.array([*np.concatenate(ends), *(at for tower in leaning.towers for at in tower.held)])

    moved = np.linalg.norm(places(5.0) - places(0.0), axis=1)
    reach_m = scene.span.support.string_length_m * np.tan(np.radians(5.0))
    strings = [wire.insulator == "string" for wire in scene.span.wires]
    assert set(np.round(moved, 6)) == {0.0, round(reach_m, 6)}
    assert (moved > 0).mean() == pytest.approx(np.mean(strings))


def test_wind_that_is_uneven_bows_a_wire_off_every_plane_curve(scene: LidarScene, site: Site) -> None:
    wire = next(one for one in site.lines[0].spans[1].wires if abs(one.swing_rad) > 0.05)
    even = replace(scene, wind=WindConfig((0.0, 0.0), (0.0, 0.0)))
    calm, blown = hung(wire, even, 0), hung(wire, replace(even, wind=WindConfig((0.0, 0.0), (0.2, 0.0))), 0)
    bow = abs(float(wire.theta[4]) * np.sin(wire.swing_rad))
    assert np.linalg.norm(blown - calm, axis=1).max() == pytest.approx(0.2 * bow, rel=1e-3)
    assert np.abs(blown[[0, -1]] - calm[[0, -1]]).max() < 1e-9


def test_a_scene_is_drawn_by_its_seed_alone() -> None:
    assert random_lidar_scene(3) == random_lidar_scene(3) != random_lidar_scene(5)
    with pytest.raises(ConfigError, match="one strip or more"):
        ScanConfig((), 200.0, 8.0, 0.05, 0.02, 0.02, 0.01)
