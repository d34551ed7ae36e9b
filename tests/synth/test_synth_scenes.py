"""Laws that every scene of the benchmark keeps, by its geometry alone: nothing is rendered here."""

import json
from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial import cKDTree
from tests.support.synth_spans import assert_same_site

import plnerf
from plnerf.line.catenary import lowest
from plnerf.synth.build import build_site, sub_conductors
from plnerf.synth.capture import plan_flight
from plnerf.synth.check import check_cameras, support_meshes
from plnerf.synth.config import SceneConfig
from plnerf.synth.foliage import plant_meshes
from plnerf.synth.houses import roof, walls, windows
from plnerf.synth.insulators import insulators, spacers
from plnerf.synth.line_scenes import LINE_SCENES
from plnerf.synth.meshes import Mesh
from plnerf.synth.near_plants import near_plants
from plnerf.synth.planting import clearance_m
from plnerf.synth.scenes import SCENES, WHY
from plnerf.synth.tower import footings
from plnerf.synth.truth import truth_of

NAMES = [name for name in SCENES if name not in LINE_SCENES]
"""Of scenes of a single span."""
OWN_GEOMETRY = ["span", "double-circuit", "distribution", "forest", "hills", "bundle", "far"]
MAX_IMAGES = {"double-circuit": 96}


@cache
def built(name: str):
    span = build_site(SCENES[name].span)
    return span, plan_flight(span, SCENES[name].capture)


def filmed(name: str, step_m: float):
    """Points on the filmed stretch of every conductor, less a tenth at either end."""
    span, _ = built(name)
    half = span.config.span_length_m / 2
    low, high = SCENES[name].capture.filmed_m or (-half, half)
    margin = 0.1 * (high - low)
    for wire in span.wires:
        points = wire.polyline(step_m)
        along = points[:, :2] @ np.array(span.along)
        yield wire, points[(along > low + margin) & (along < high - margin)]


def in_image(capture, view, points):
    local = (points - view.centre) @ view.R_world_camera
    half = np.array([capture.width_px, capture.height_px]) / 2
    pixel = local[:, :2] / local[:, 2:] * capture.focal_px + half
    return (local[:, 2] > 0.1) & (pixel > 0).all(axis=1) & (pixel < 2 * half).all(axis=1)


def test_every_scene_has_its_own_name_and_its_reason():
    assert [scene.name for scene in SCENES.values()] == list(SCENES)
    assert set(WHY) == set(SCENES)
    assert SCENES["span"] == SceneConfig()  # the one that comes with the package


@pytest.mark.parametrize("name", NAMES)
def test_every_scene_can_stand_and_be_flown(name):
    span, views = built(name)
    check_cameras(span, views)
    assert 48 <= len(views) <= MAX_IMAGES.get(name, 72)


@pytest.mark.parametrize("name", OWN_GEOMETRY)
def test_conductors_end_at_their_attachments_with_the_sag_of_their_wire(name):
    span, _ = built(name)
    assert len(span.wires) == sum(wire.bundle for wire in span.config.wires)
    asked = [config for config, wires in span.grouped for _ in wires]
    for i, wire in enumerate(span.wires):
        ends = wire.points(np.array([0.0, wire.base.length_m]))
        clamps = [tower.attachments[i] for tower in span.towers]
        np.testing.assert_allclose(ends, clamps, atol=1e-9)
        assert abs(wire.sag.value - asked[i].sag_m) < 1e-9
        assert (wire.id, wire.kind, wire.diameter_m) == (i + 1, asked[i].kind, asked[i].diameter_m)
        assert wire.name.startswith(asked[i].name) and (wire.bundle is None) == (asked[i].bundle == 1)


def test_wires_of_one_bundle_share_its_number():
    span, _ = built("double-circuit")
    bundles = [{wire.bundle for wire in wires} for config, wires in span.grouped if config.bundle > 1]
    assert bundles == [{number} for number in range(1, 7)]


@pytest.mark.parametrize("name", OWN_GEOMETRY)
def test_clamps_are_where_the_configuration_says_and_carried_by_something(name):
    span, _ = built(name)
    axes = np.array([[span.along[0], -span.along[1]], [span.along[1], span.along[0]]])
    for tower in span.towers:
        local = np.array(tower.attachments) - np.array(tower.foot)
        local[:, :2] = local[:, :2] @ axes
        asked = [(y, wire.height_m) for wire in span.config.wires for _, y in sub_conductors(wire)]
        np.testing.assert_allclose(local[:, 1:], asked, atol=1e-9)
        porcelain, metal = insulators(span.lines[0], tower)
        bodies = [metal] if porcelain is None else [metal, porcelain]
        near, _ = cKDTree(np.concatenate([b.vertices for b in bodies])).query(tower.attachments)
        assert near.max() < 0.06


def test_sub_conductors_hang_side_by_side_and_spacers_hold_them_apart():
    for name in ("bundle", "double-circuit"):
        span, _ = built(name)
        held = spacers(span.spans)
        for config, wires in span.grouped:
            lines = [wire.polyline(0.5) for wire in wires]
            for a, b in pairwise(lines):
                np.testing.assert_allclose(np.linalg.norm(a - b, axis=1), config.bundle_gap_m, atol=1e-9)
                middle = (a + b) / 2
                distance, _ = cKDTree(held.vertices).query(middle)
                gaps = np.diff(np.nonzero(distance < 0.3)[0]) * wires[0].base.length_m / (len(middle) - 1)
                assert gaps.max() <= span.config.spacer_step_m + 1.0


@pytest.mark.parametrize("name", OWN_GEOMETRY)
def test_no_plant_comes_closer_to_a_conductor_than_stated(name):
    span, _ = built(name)
    assert len(span.plants) > 50
    for wire in span.wires:
        axis = wire.polyline(0.05)
        for plant in span.plants:
            if np.hypot(*(axis[:, :2] - plant.foot[:2]).T).min() < 12.0:
                gap = clearance_m(axis, plant.foot, plant.radius_m, plant.height_m) - wire.diameter_m / 2
                assert gap >= span.config.plants.clearance_m


def test_leaves_stay_in_the_cylinder_whatever_grows_there():
    span, _ = built("forest")
    kinds = {plant.kind: plant for plant in span.plants}
    assert set(kinds) == {"tree", "conifer", "bush", "background tree"}
    for plant in kinds.values():
        leaves = plant_meshes(plant)[1].vertices - np.array(plant.foot)
        assert np.hypot(leaves[:, 0], leaves[:, 1]).max() <= plant.radius_m
        assert leaves[:, 2].max() <= plant.height_m
        assert leaves[:, 2].max() > 0.8 * plant.height_m  # and fill it


def test_the_forest_has_crowns_two_to_four_metres_from_a_conductor():
    span, _ = built("forest")
    axes = np.concatenate([wire.polyline(0.05) for wire in span.wires])
    gaps = [
        clearance_m(axes, plant.foot, plant.radius_m, plant.height_m)
        for plant in span.plants
        if plant.kind != "bush"
    ]
    assert min(gaps) >= 2.0
    assert sum(gap <= 4.1 for gap in gaps) >= 12


@pytest.mark.parametrize("name", OWN_GEOMETRY)
def test_a_seed_decides_everything(name):
    span, views = built(name)
    scene = SCENES[name]
    assert_same_site(build_site(scene.span), span)
    again = plan_flight(span, scene.capture)
    assert all((a.centre == b.centre).all() for a, b in zip(again, views, strict=True))
    other = build_site(scene.with_seed(scene.seed + 1).span)
    assert other.plants != span.plants
    assert_same_site(replace(other, plants=span.plants, houses=span.houses, config=span.config), span)


def test_nothing_stands_on_the_road_or_in_a_house():
    span, _ = built("distribution")
    assert len(span.houses) == 4
    for plant in span.plants:
        foot = np.array(plant.foot)
        assert abs(span.ground.track_offset(foot[:1], foot[1:2])[0]) > 2.6 + plant.radius_m
        for house in span.houses:
            reach = np.hypot(house.length_m, house.width_m) / 2
            assert np.hypot(*(foot - house.foot)[:2]) > reach


def test_hills_raise_a_support_but_not_the_ground_into_the_wires():
    span, _ = built("hills")
    low, high = (tower.foot[2] for tower in span.towers)
    assert 11.0 < high - low < 13.0
    for wire in span.wires:
        D, h, p = wire.plane
        assert not 0 < lowest(D, h, p)[0] < D  # the lowest point lies outside the span
        line = wire.polyline(0.2)
        assert (line[:, 2] - span.ground.heights(line[:, 0], line[:, 1])).min() > 5.0


@pytest.mark.parametrize("name", [name for name in NAMES if name != "parallel"])
def test_every_metre_is_seen_several_times_and_from_different_sides(name):
    """Lines of sight, seen along the wire, differ by 20 degrees or more for 90 % of the filmed points."""
    span, views = built(name)
    capture = SCENES[name].capture
    for wire, points in filmed(name, 1.0):
        seen = np.stack([in_image(capture, view, points) for view in views])
        assert (seen.sum(axis=0) >= 3).mean() > 0.9, wire.name
        left = np.array([-span.along[1], span.along[0], 0.0])
        sight = points[None] - np.array([view.centre for view in views])[:, None]
        angle = np.degrees(np.arctan2(sight[..., 2], sight @ left)) % 180
        spread = []
        for k in range(len(points)):
            mine = np.sort(angle[seen[:, k], k])
            gaps = np.diff([*mine, mine[0] + 180]) if len(mine) else np.array([180.0])
            spread.append(180 - gaps.max())  # the widest fan of directions, as lines
        assert (np.array(spread) > 20.0).mean() > 0.9, wire.name


def test_parallel_flies_along_a_wire_at_one_side_and_height():
    span, views = built("parallel")
    axis = span.wires[0].polyline(0.02)
    between = [v.centre for v in views if abs(v.centre[:2] @ np.array(span.along)) < 19.0]
    distance, _ = cKDTree(axis).query(between)
    assert np.ptp(distance) < 0.02


def test_wires_of_far_are_one_to_two_pixels_wide_where_they_are_nearest():
    span, views = built("far")
    for wire in span.wires:
        if wire.kind == "phase":
            distance, _ = cKDTree(wire.polyline(0.1)).query([view.centre for view in views])
            width = SCENES["far"].capture.focal_px * wire.diameter_m / distance
            assert width.min() > 0.9 and width.max() < 2.1


def test_the_double_circuit_has_the_measured_figures():
    span, _ = built("double-circuit")
    phases = [wire for wire in span.wires if wire.kind == "phase"]
    assert len(phases) == 12 and len(span.wires) == 14
    assert {round(wire.base.length_m) for wire in span.wires} == {335}
    for wire in phases:  # measured parameters p of the twelve: 1711 to 1766 m
        assert 1690 < wire.p_m.value < 1780


def test_the_truth_in_the_package_is_that_of_the_default_scene():
    """All but what is seen and observable, which is read from rendered masks and depths."""
    kept = json.loads((Path(plnerf.__file__).parent / "data" / "span" / "truth.json").read_text())
    span, views = built("span")
    seen = [(wire.pop("seen_m"), wire.pop("observable_m")) for wire in kept["conductors"]]
    assert len(seen) == len(span.wires)
    plants = near_plants(span)
    near = [plant for plant in kept["vegetation"] if "clearance_m" in plant]
    shown = [plant.pop("observable") for plant in near]
    shown += [row.pop() for plant in near for rows in plant["leaves"].values() for row in rows]
    assert len(near) == sum(len(leaves) > 0 for leaves in plants) and {*shown} == {True, False}
    assert_close(json.loads(json.dumps(truth_of(span, SCENES["span"], views, plants))), kept)


def assert_close(found: Any, kept: Any, where: str = "") -> None:
    """The same keys and texts in the same order, and numbers to 1e-9."""
    assert type(found) is type(kept), where
    if isinstance(kept, dict):
        assert list(found) == list(kept), where
        for key in kept:
            assert_close(found[key], kept[key], f"{where}/{key}")
    elif isinstance(kept, list):
        assert len(found) == len(kept), where
        for i, pair in enumerate(zip(found, kept, strict=True)):
            assert_close(*pair, f"{where}/{i}")
    elif isinstance(kept, float):
        assert found == pytest.approx(kept, abs=1e-9, rel=1e-12), where
    else:
        assert found == kept, where


@pytest.mark.parametrize("name", OWN_GEOMETRY)
def test_supports_reach_their_height_and_into_the_ground(name):
    span, _ = built(name)
    for tower in span.towers:
        bodies = support_meshes(span, tower)
        if span.config.support.kind == "lattice":
            bodies.append(footings(tower))
        points = np.concatenate([body.vertices for body in bodies])
        assert points[:, 2].max() - tower.foot[2] == pytest.approx(tower.height_m, abs=0.1)
        x, y, _ = tower.foot
        nearby = points[np.hypot(points[:, 0] - x, points[:, 1] - y) < 4.5]
        assert (nearby[:, 2] - span.ground.heights(nearby[:, 0], nearby[:, 1])).min() < -0.3


def test_openings_of_houses_show_outside_their_walls_and_roofs_cover_them():
    span, _ = built("distribution")
    for house in span.houses:
        panes, _ = windows(house)
        wall = Mesh(walls(house).vertices[:10], walls(house).faces[:10])
        for pane in np.array_split(panes.vertices, len(panes.vertices) // 8):
            assert closest_m(wall, pane).max() > 0.02  # the glass stands before the wall it is set in
        assert roof(house).vertices[:, 2].max() > wall.vertices[:, 2].max()


def closest_m(wall: Mesh, points: np.ndarray) -> np.ndarray:
    """Signed distance of points in front of the wall's nearest face's plane."""
    a, b, c = (wall.vertices[wall.faces[:, i]] for i in range(3))
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return ((points[:, None] - a[None]) * normal[None]).sum(axis=2).max(axis=1)
