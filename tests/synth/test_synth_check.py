"""What is refused: wires in the ground, cameras inside of things, each named; free air is not refused."""

from dataclasses import replace

import numpy as np
import pytest

from plnerf.errors import ConfigError
from plnerf.synth.build import build_site
from plnerf.synth.capture import View, look
from plnerf.synth.check import check_cameras, edge_points
from plnerf.synth.config import PlantsConfig, SceneConfig, SpanConfig, TerrainConfig
from plnerf.synth.flight_config import CaptureConfig, Pass
from plnerf.synth.houses import inside_m, walls
from plnerf.synth.line_config import WireConfig
from plnerf.synth.meshes import Mesh
from plnerf.synth.scenes import SCENES

BARE = PlantsConfig(trees=0, bushes=0, background=0)
STREET = build_site(SCENES["distribution"].span)
LATTICE = build_site(SCENES["span"].span)


def at(*centres) -> list[View]:
    return [View(f"{i:04d}", "right", look(0.0, 0.0, 0.0), np.array(c, float)) for i, c in enumerate(centres)]


def refused(span, centre) -> str:
    """The message for a flight whose second image is taken from `centre`."""
    with pytest.raises(ConfigError) as caught:
        check_cameras(span, at((0.0, 0.0, 60.0), centre))
    assert "image 0001 (pass right)" in str(caught.value)
    assert "Move the pass" in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize("sag_m", [0.0, -1.0, float("nan")])
def test_a_sag_that_is_none_is_refused(sag_m):
    with pytest.raises(ConfigError, match=r"phase A: sag_m must be greater than 0, got"):
        WireConfig("phase A", "phase", 0.0, 9.0, sag_m, 0.03)


def test_a_wire_that_touches_the_ground_is_refused_by_name_and_place():
    wires = (WireConfig("low one", "phase", 0.0, 4.0, 4.6, 0.03),)
    config = SpanConfig(wires=wires, plants=BARE, terrain=TerrainConfig(waves=0.0))
    with pytest.raises(ConfigError, match=r"low one touches the ground -?0\.\d m from mid-span, by 0\.6\d m"):
        build_site(config)
    just_above = replace(config, wires=(replace(wires[0], sag_m=3.95),))
    build_site(just_above)


def test_a_clamp_inside_the_terrain_is_refused():
    wires = (WireConfig("wide", "phase", -25.0, 0.2, 0.1, 0.03),)
    with pytest.raises(ConfigError, match=r"clamp of wide on support (west|east) lies .* inside the terrain"):
        build_site(SpanConfig(wires=wires, plants=BARE, terrain=TerrainConfig(waves=-8.0)))


def test_a_camera_in_any_tree_or_bush_is_refused():
    beyond = []
    for i in range(0, len(LATTICE.plants), 24):
        plant = LATTICE.plants[i]
        x, y, z = plant.foot
        assert f"inside {plant.kind}" in refused(LATTICE, (x, y, z + 0.7 * plant.height_m))
        beyond.append((x, y, z + plant.height_m + 0.4))
    check_cameras(LATTICE, at(*beyond))


def test_a_camera_in_a_house_is_refused_and_one_above_its_ridge_is_not():
    for house in STREET.houses:
        x, y, z = house.foot
        assert f"inside {house.name}" in refused(STREET, (x, y, z + 0.8 * house.ridge_m))
        check_cameras(STREET, at((x, y, z + house.ridge_m + 2.5)))


def test_the_hull_of_a_house_holds_its_walls():
    for house in STREET.houses:
        mesh = walls(house)
        body = Mesh(mesh.vertices[:10], mesh.faces[:10])  # without the chimney
        assert inside_m(house, body.vertices).min() > -1e-9


@pytest.mark.parametrize("span", [STREET, LATTICE], ids=["pole", "lattice"])
def test_a_camera_in_a_support_or_at_a_wire_is_refused(span):
    for tower in span.towers:
        x, y, z = tower.foot
        assert f"inside the {tower.name}" in refused(span, (x, y, z + 0.5 * tower.height_m))
        assert f"the {tower.name}" in refused(span, (x, y, z + tower.height_m - 0.4))
    for wire in span.wires:
        x, y, z = wire.points(np.array([0.43 * wire.base.length_m]))[0]
        assert f"at the wire {wire.name}" in refused(span, (x, y, z + 0.1))
        check_cameras(span, at((x, y, z + 0.31 + wire.diameter_m)))


def test_a_camera_below_the_ground_is_refused():
    assert "below the ground" in refused(LATTICE, (3.0, 12.0, -4.0))


def test_edge_points_lie_on_the_edges_and_leave_no_gap():
    triangle = Mesh(np.array([[0.0, 0, 0], [3, 0, 0], [0, 4, 0]]), np.array([[0, 1, 2]]))
    points = edge_points(triangle, 0.1)
    on_edge = np.minimum.reduce([
        np.abs(points[:, 0]),
        np.abs(points[:, 1]),
        np.abs(points @ [4, 3, 0] - 12) / 5,
    ])
    assert on_edge.max() < 1e-12
    for edge in (points[np.abs(points[:, 1]) < 1e-12], points[np.abs(points[:, 0]) < 1e-12]):
        reach = np.sort(np.linalg.norm(edge, axis=1))
        assert np.diff(reach).max() <= 0.1 + 1e-12


def test_a_pass_must_follow_a_wire_that_is_there():
    lost = CaptureConfig(passes=(Pass("one", "phase Z", 1.0, 1.0, -1.0, 1.0, 0.0, 0.0),))
    with pytest.raises(ConfigError, match="no wire 'phase Z'"):
        SceneConfig(capture=lost)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"trees": -1}, "number of trees must be 0 or more, got -1"),
        ({"conifers": 1.5}, "share from 0 to 1"),
        ({"near": 3, "near_clearance_m": (1.0, 2.0)}, "below clearance_m"),
        ({"clearance_m": 0.0}, "clearance_m must be greater than 0"),
    ],
)
def test_impossible_plants_are_refused(change, text):
    with pytest.raises(ConfigError, match=text):
        PlantsConfig(**change)
