"""Laws of lines with several spans, named and drawn, by their geometry alone: nothing is rendered here."""

import math
from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial import cKDTree
from tests.support.synth_spans import assert_same_site

from plnerf.errors import ConfigError
from plnerf.line.curve import vertical_sag
from plnerf.synth import seen
from plnerf.synth.build import build_site, stand
from plnerf.synth.capture import plan_flight
from plnerf.synth.check import check_cameras, support_meshes
from plnerf.synth.config import PlantsConfig, SceneConfig, SpanConfig, TerrainConfig
from plnerf.synth.flight_config import CaptureConfig, Grid, Orbit
from plnerf.synth.insulators import insulators, jumpers
from plnerf.synth.line_config import LineConfig, StructureConfig
from plnerf.synth.line_scenes import LINE_SCENES
from plnerf.synth.near_plants import near_plants
from plnerf.synth.random_scene import random_scene
from plnerf.synth.route import Route
from plnerf.synth.scene_options import SceneOptions, find_scene
from plnerf.synth.truth import truth_of

NAMES = list(LINE_SCENES)
BARE = PlantsConfig(trees=0, bushes=0, background=0)
BENT = SpanConfig(
    plants=BARE,
    before_m=(30.0,),
    after_m=(50.0, 45.0),
    structures=(
        StructureConfig("terminal"),
        StructureConfig("strain", 40.0, 1.5),
        StructureConfig("suspension", -2.0),
        StructureConfig("strain", -60.0),
        StructureConfig("suspension"),
    ),
    slack=((1.2,), (1.0,), (0.9, 0.8, 0.7, 1.0), (1.0,)),
)


@cache
def built(name: str):
    scene = LINE_SCENES[name]
    site = build_site(scene.span)
    return site, plan_flight(site, scene.capture)


@cache
def drawn(seed: int) -> SceneConfig:
    return random_scene(seed)


def azimuth(vector: np.ndarray) -> float:
    return math.degrees(math.atan2(vector[1], vector[0]))


@pytest.mark.parametrize("name", NAMES)
def test_named_lines_can_stand_and_be_flown(name: str) -> None:
    site, views = built(name)
    check_cameras(site, views)
    assert len(views) == sum(
        LINE_SCENES[name].capture.views_per_pass for _ in LINE_SCENES[name].capture.passes
    )
    if name == "long":
        assert len(site.spans) == 8 and len(views) >= 500
        assert sum(abs(tower.config.turn_deg) > 5 for tower in site.towers) == 2


def test_three_spans_bend_by_twenty_degrees_and_end() -> None:
    site, _ = built("three-spans")
    assert len(site.spans) == 3
    assert sorted(tower.config.turn_deg for tower in site.towers) == [0.0, 0.0, 0.0, 20.0]
    assert [tower.config.kind for tower in site.towers].count("terminal") == 1


@pytest.mark.parametrize("config", [BENT, LINE_SCENES["long"].span, LINE_SCENES["crossing"].span])
def test_curves_meet_their_attachments_with_the_sag_of_their_span(config: SpanConfig) -> None:
    for line in stand(config).lines:
        for k, span in enumerate(line.spans):
            first, last = span.towers
            sags = [
                line.config.sag_m(k, i)
                for i, wire in enumerate(line.config.wires)
                for _ in range(wire.bundle)
            ]
            for i, wire in enumerate(span.wires):
                ends = wire.points(np.array([0.0, wire.base.length_m]))
                np.testing.assert_allclose(ends, [first.ahead[i], last.behind[i]], atol=1e-9)
                assert [end.structure for end in wire.ends] == [first.id, last.id]
                assert vertical_sag(wire.theta, wire.base.length_m) == pytest.approx(sags[i], abs=1e-9)


def test_the_line_turns_at_its_structures_by_their_angles_and_towers_stand_half_way() -> None:
    line = stand(BENT).lines[0]
    feet = np.array([tower.foot[:2] for tower in line.towers])
    ways = [azimuth(b - a) for a, b in pairwise(feet)]
    turns = [(b - a + 180) % 360 - 180 for a, b in pairwise(ways)]
    np.testing.assert_allclose(turns, [40.0, -2.0, -60.0], atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(np.diff(feet, axis=0), axis=1), line.config.lengths_m)
    for tower, (before, after) in zip(line.towers[1:-1], pairwise(ways), strict=True):
        assert azimuth(np.array(tower.along)) == pytest.approx((before + after) / 2)


def test_adjacent_spans_share_a_hanging_clamp_and_are_two_tension_strings_apart() -> None:
    line = stand(BENT).lines[0]
    for tower in line.towers[1:-1]:
        string = tower.design.support.string_length_m
        gaps = np.linalg.norm(np.subtract(tower.behind, tower.ahead), axis=1)
        hung = np.array([wire.insulator == "none" for wire in tower.design.wires])
        if tower.config.kind == "suspension":
            assert (gaps == 0).all()
            assert len(tower.attachments) == 4
        else:
            turn = math.radians(tower.config.turn_deg)
            assert (gaps[hung] == 0).all()
            np.testing.assert_allclose(gaps[~hung], 2 * string * math.cos(turn / 2), rtol=0.02)
            for end, held in ((tower.behind, tower.held), (tower.ahead, tower.held)):
                away = np.linalg.norm(np.subtract(end, held), axis=1)
                np.testing.assert_allclose(away[~hung], string)
    raised = line.towers[1]
    assert raised.height_m == line.towers[2].height_m + 1.5


def test_tension_strings_point_down_as_steeply_as_their_wires() -> None:
    """On a slope as well, where one end of a span climbs and the other falls steeply."""
    line = stand(drawn(42).span).lines[0]
    steep, apart = [], []
    for tower in line.towers[1:-1]:
        if tower.config.kind != "strain":
            continue
        k = line.towers.index(tower)
        sides = (line.spans[k - 1], tower.behind, True), (line.spans[k], tower.ahead, False)
        for span, ends, last in sides:
            for wire, end, held in zip(span.wires, ends, tower.held, strict=True):
                L = wire.base.length_m
                near, far = wire.points(np.array([L, L - 0.01] if last else [0.0, 0.01]))
                string, tangent = np.subtract(end, held), far - near
                angles = [math.atan2(-one[2], math.hypot(*one[:2])) for one in (string, tangent)]
                steep.append(angles[1])
                apart.append(angles[0] - angles[1])
    assert max(steep) - min(steep) > 0.1
    assert np.abs(apart).max() < 0.015


@pytest.mark.parametrize("config", [BENT, LINE_SCENES["crossing"].span], ids=["bent", "crossing"])
def test_something_carries_every_wire_and_jumpers_join_strained_ones(config: SpanConfig) -> None:
    site = stand(config)
    for line in site.lines:
        for tower in line.towers:
            bodies = [mesh for mesh in insulators(line, tower) if mesh is not None]
            solid = cKDTree(np.concatenate([mesh.vertices for mesh in bodies]))
            assert solid.query(np.array(tower.attachments))[0].max() < 0.06
            structure = np.concatenate([mesh.vertices for mesh in support_meshes(site, tower)])
            held = np.array(tower.held) + np.array([0, 0, 0.5])
            assert cKDTree(structure).query(held)[0].max() < 1.5
            loops = jumpers(line, tower)
            strained = tower.config.kind == "strain" and len(line.beside(tower)) == 2
            assert (loops is not None) == strained
            if loops is not None:
                strings = [i for i, wire in enumerate(tower.design.wires) if wire.insulator == "tension"]
                for side in (tower.behind, tower.ahead):
                    ends = np.array(side)[strings]
                    assert cKDTree(loops.vertices).query(ends)[0].max() < 0.03


def test_wind_swings_the_plane_to_the_left_and_keeps_the_ends() -> None:
    site, _ = built("wind")
    still = stand(replace(LINE_SCENES["wind"].span, wires=SpanConfig().wires))
    for wire, upright in zip(site.wires, still.wires, strict=True):
        L = wire.base.length_m
        assert wire.swing_rad == pytest.approx(math.radians(15.0 if wire.kind == "shield" else 12.0))
        np.testing.assert_allclose(
            wire.points(np.array([0.0, L])), upright.points(np.array([0.0, L])), atol=1e-9
        )
        bow, height = wire.at(np.array([L / 2]))[0] - upright.at(np.array([L / 2]))[0]
        sag = upright.sag.value
        assert bow == pytest.approx(sag * math.sin(wire.swing_rad), rel=0.01)  # left is positive
        assert height == pytest.approx(sag * (1 - math.cos(wire.swing_rad)), rel=0.05)


@pytest.mark.parametrize("config", [BENT, SpanConfig(plants=BARE)], ids=["bent", "straight"])
def test_stations_are_the_inverse_of_places_on_the_line(config: SpanConfig) -> None:
    route = Route.of(config.line)
    for s in np.linspace(route.stations_m[0] - 5, route.stations_m[-1] + 5, 83):
        point = np.array([route.at(float(s), 0.0)])
        assert route.stations_of(point)[0] == pytest.approx(s, abs=1e-9)
        assert route.away_from(point)[0] == pytest.approx(0.0, abs=1e-9)


def test_paths_beside_a_bent_line_have_no_steps() -> None:
    route = Route.of(BENT.line)
    for across in (-3.0, 3.0):
        path = np.array([route.at(float(s), across) for s in np.arange(-60.0, 130.0, 0.05)])
        assert np.linalg.norm(np.diff(path, axis=0), axis=1).max() < 0.12
        away = route.away_from(path)
        assert away.min() > 2.0 and away.max() < 3.01


def test_an_orbit_looks_at_its_tower_from_its_distance_and_a_grid_looks_down() -> None:
    capture = CaptureConfig(
        passes=(
            Orbit("orbit", 0, 12.0, 9.0, 15.0, wobble_m=0.0),
            Grid("grid", (-10.0, 15.0), 6.0, 3, 25.0, wobble_m=0.0),
        ),
        views_per_pass=24,
    )
    site = stand(SpanConfig(plants=BARE))
    views = plan_flight(site, capture)
    foot = np.array(site.towers[0].foot)
    orbit = [view for view in views if view.flight_pass == "orbit"]
    for view in orbit:
        away = view.centre - foot
        assert np.hypot(*away[:2]) == pytest.approx(12.0) and 9.0 <= away[2] <= 15.0
        assert view.R_world_camera[:, 2] @ (foot + np.array([0, 0, 10.0]) - view.centre) > 0.9 * 12.0
    grid = [view for view in views if view.flight_pass == "grid"]
    assert all(view.R_world_camera[2, 2] < -math.cos(math.radians(15)) for view in grid)
    along = np.array([view.centre[:2] @ site.along for view in grid])
    assert along.min() == pytest.approx(-10.0) and along.max() == pytest.approx(15.0)


@pytest.mark.parametrize("name", NAMES)
def test_the_truth_is_what_stands_there(name: str) -> None:
    site = stand(LINE_SCENES[name].span)
    content = truth_of(site, LINE_SCENES[name], (), near_plants(site))
    rows, towers = content["conductors"], content["towers"]
    assert len({row["name"] for row in rows}) == len(rows) == len(site.wires)
    for row, wire in zip(rows, site.wires, strict=True):
        assert row.get("swing_deg", 0.0) == pytest.approx(math.degrees(wire.swing_rad))
        assert row["sag_m"] == pytest.approx(wire.sag.value)
        line = np.array(row["polyline"])
        np.testing.assert_allclose(line[[0, -1]], [row["a"], row["b"]], atol=1e-6)
        held = [end for tower in towers if tower["line"] == row["line"] for end in tower["attachments"]]
        for end in (row["a"], row["b"]):
            assert cKDTree(held).query(end)[0] < 1e-9
    assert [tower["structure"] for tower in towers] == [tower.config.kind for tower in site.towers]
    ends = [
        tower["line_angle_deg"] for line in site.lines for tower in towers if tower["line"] == line.number
    ]
    assert sum(angle is None for angle in ends) == 2 * len(site.lines)


@pytest.mark.parametrize("seed", range(24))
def test_drawn_scenes_can_stand_and_be_flown(seed: int) -> None:
    """What random_scene has checked with all plants is checked here of the lines, from the numbers alone."""
    scene = drawn(seed)
    site = stand(scene.span)
    views = plan_flight(site, scene.capture)
    assert scene.name == f"random-{seed}" and len(views) == 48
    assert (scene.capture.width_px, scene.capture.height_px) == (480, 320)
    assert min(tower.foot[2] + tower.height_m for tower in site.towers) > -20
    for wire in site.wires:
        line = wire.polyline(0.2)
        assert (line[:, 2] - site.ground.heights(line[:, 0], line[:, 1])).min() > 0.5
    names = [wire.name for wire in site.wires]
    assert len(set(names)) == len(names)
    assert [wire.id for wire in site.wires] == list(range(1, len(names) + 1))


@pytest.mark.parametrize("seed", range(6))
def test_whole_spans_are_filmed_to_their_structures(seed: int) -> None:
    scene = find_scene("random-span", seed)
    span, half = scene.span, scene.span.span_length_m / 2
    views = plan_flight(stand(span), scene.capture)
    assert scene.name == f"random-span-{seed}" and 48 <= len(views) <= 120
    assert span != drawn(seed).span, "whole spans are draws of their own"
    for end, beyond in zip(scene.capture.filmed_m, (span.before_m, span.after_m), strict=True):
        assert abs(end) > half if beyond else 0.95 * half < abs(end) < half


@pytest.mark.slow
def test_draws_differ_from_seed_to_seed_and_return_with_it() -> None:
    assert random_scene(3) == drawn(3)
    assert_same_site(build_site(drawn(3).span), build_site(drawn(3).span))
    scenes = [drawn(seed) for seed in range(30)]
    flights = {tuple(type(leg).__name__ for leg in scene.capture.passes) for scene in scenes}
    assert len(flights) >= 4
    assert {scene.span.support.kind for scene in scenes} == {"lattice", "pole"}
    for some in (
        [len(scene.span.others) for scene in scenes],
        [any(abs(one.turn_deg) > 5 for one in scene.span.structures) for scene in scenes],
        [any(wire.swing_deg for wire in scene.span.wires) for scene in scenes],
        [any(wire.bundle > 1 for wire in scene.span.wires) for scene in scenes],
        [scene.capture.pose_noise_m > 0 for scene in scenes],
    ):
        assert 2 <= sum(map(bool, some)) <= 28


def test_drawn_flights_show_enough_of_the_line_to_measure_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Were nothing hidden: of most scenes 10 m of wire or more are observable."""

    def in_image(points, view, mask, capture):
        local = (points - view.centre) @ view.R_world_camera
        half = np.array([capture.width_px, capture.height_px]) / 2
        pixel = local[:, :2] / np.maximum(local[:, 2:], 1e-9) * capture.focal_px
        return ((local[:, 2] > 0.05) & (np.abs(pixel) < half).all(1)).astype(np.int64)

    monkeypatch.setattr(seen, "shown", in_image)
    lengths = []
    for seed in range(20):
        site = stand(drawn(seed).span)
        views = plan_flight(site, drawn(seed).capture)
        none = [np.zeros((1, 1), dtype=np.bool_)] * len(views)
        wires = [wire for span in site.lines[0].spans for wire in span.wires]
        found = seen.observable_stretches(wires, views, none, drawn(seed).capture)
        lengths.append(sum(high - low for stretches in found for low, high in stretches))
    assert np.mean(np.array(lengths) > 10.0) >= 0.6


def test_the_random_scene_is_named_by_its_seed() -> None:
    scene = SceneOptions(seed=5, samples=8).apply(find_scene("random", 5))
    assert scene.span == drawn(5).span and scene.image.samples_per_pixel == 8
    assert find_scene("random") == drawn(0)
    with pytest.raises(ConfigError, match="seed must be 0 or more"):
        find_scene("random", -1)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"structures": (StructureConfig(),)}, "1 spans hang on 2 structures, got 1"),
        ({"slack": ((1.0, 1.0),)}, "slack must name one factor, or one for each of 4 wires"),
        ({"others": (replace(BENT.line, name=""),)}, "every other line needs a name"),
        (
            {"structures": (StructureConfig("strain", 9.0), StructureConfig())},
            "does not turn at its first or last",
        ),
    ],
)
def test_impossible_lines_are_refused_in_words(change: dict[str, object], text: str) -> None:
    with pytest.raises(ConfigError, match=text):
        replace(SpanConfig(), **change)


def test_what_a_structure_cannot_do_is_refused() -> None:
    with pytest.raises(ConfigError, match="60 degrees at most"):
        StructureConfig("strain", 61.0)
    with pytest.raises(ConfigError, match="Make it a strain structure"):
        StructureConfig("suspension", 12.0)
    with pytest.raises(ConfigError, match="structures 0 to 1"):
        SceneConfig(capture=CaptureConfig(passes=(Orbit("far", 2, 9.0, 3.0, 9.0),)))


def test_lines_that_touch_are_refused() -> None:
    flat = TerrainConfig(waves=0.0)
    other = LineConfig(SpanConfig().wires, SpanConfig().support, 80.0, (40.0,), name="other")
    with pytest.raises(ConfigError, match=r"line \d comes within|wire of line \d comes within"):
        stand(SpanConfig(plants=BARE, terrain=flat, others=(other,)))
