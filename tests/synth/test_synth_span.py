"""The span as geometry: plants keep their places, meshes their shapes, and a seed gives one span."""

import numpy as np
import pytest
from scipy.spatial.distance import cdist
from tests.support.synth_spans import assert_same_site

from plnerf.errors import ConfigError
from plnerf.synth.build import build_site
from plnerf.synth.config import ImageConfig, PlantsConfig, SceneConfig, SpanConfig, TerrainConfig
from plnerf.synth.flight_config import CaptureConfig
from plnerf.synth.foliage import plant_meshes
from plnerf.synth.insulators import insulators
from plnerf.synth.line_config import SupportConfig
from plnerf.synth.meshes import beam, grid, lathe, tube, without, write_ply
from plnerf.synth.near_plants import BESIDE_M, LISTED_M, near_plants
from plnerf.synth.terrain import Ground
from plnerf.synth.texture import ground_texture, noise, strand_texture
from plnerf.synth.tower import steel
from plnerf.synth.truth import truth_of

SMALL = SpanConfig(plants=PlantsConfig(background=6))
GROUND = Ground(TerrainConfig(), (1.0, 0.0), 40.0)


def volume(mesh) -> float:
    """Signed volume of a closed mesh, positive when its faces look outwards."""
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    return float((np.cross(a, b) * c).sum() / 6)


def test_the_same_seed_gives_the_same_span_and_another_another():
    assert_same_site(build_site(SMALL), build_site(SMALL))
    assert build_site(SMALL).plants != build_site(SpanConfig(seed=8, plants=SMALL.plants)).plants


def test_origin_is_on_the_ground_at_mid_span_and_towers_are_a_span_apart():
    span = build_site(SMALL)
    west, east = (np.array(tower.foot) for tower in span.towers)
    assert span.ground.heights(np.zeros(1), np.zeros(1))[0] == 0.0
    np.testing.assert_allclose((west + east)[:2], 0.0, atol=1e-12)
    assert np.hypot(*(east - west)[:2]) == pytest.approx(SMALL.span_length_m)


def test_wires_keep_their_sags_and_stay_clear_of_each_other_and_of_the_ground():
    span = build_site(SMALL)
    lines = [wire.polyline(0.1) for wire in span.wires]
    for i, wire in enumerate(span.wires):
        assert abs(wire.sag.value - SMALL.wire(wire.name).sag_m) < 1e-9
        assert (lines[i][:, 2] - span.ground.heights(lines[i][:, 0], lines[i][:, 1])).min() > 6.0
        for other in lines[:i]:
            assert np.linalg.norm(lines[i][:, None] - other[None], axis=2).min() > 1.2


def test_plants_stand_on_the_ground_off_the_track_and_their_leaves_stay_in_their_cylinders():
    span = build_site(SMALL)
    assert len(span.plants) == SMALL.plants.trees + SMALL.plants.bushes + SMALL.plants.background
    for plant in span.plants:
        foot = np.array(plant.foot)
        assert foot[2] == span.ground.heights(foot[:1], foot[1:2])[0]
        assert abs(span.ground.track_offset(foot[:1], foot[1:2])[0]) > plant.radius_m
        for mesh in plant_meshes(plant):
            if mesh is not None:
                away = mesh.vertices - foot
                assert np.hypot(away[:, 0], away[:, 1]).max() <= plant.radius_m
                assert away[:, 2].max() <= plant.height_m


def test_clearances_agree_with_brute_force():
    span = build_site(SMALL)
    listed = truth_of(span, SceneConfig(span=SMALL), (), near_plants(span))["vegetation"]
    near = [i for i, entry in enumerate(listed) if "clearance_m" in entry]
    assert len(near) >= SMALL.plants.trees
    bushes = [i for i in near if listed[i]["kind"] == "bush"]  # fewer leaves than a tree
    for i in bushes[:2]:
        leaves = plant_meshes(span.plants[i])[1].vertices
        gaps = {
            wire.name: min(cdist(leaves, part).min() for part in np.array_split(wire.polyline(0.1), 40))
            - wire.diameter_m / 2
            for wire in span.wires
        }
        best = min(gaps, key=gaps.get)
        assert listed[i]["nearest_conductor"] == best
        assert listed[i]["clearance_m"] == pytest.approx(gaps[best], abs=1e-3)
        rows = {name: np.array(some) for name, some in listed[i]["leaves"].items()}
        near = {name: gap for name, gap in gaps.items() if gap <= LISTED_M or name == best}
        assert {name: some[:, 3].min() for name, some in rows.items()} == pytest.approx(near, abs=1e-3)
        for wire in span.wires:
            if wire.name in rows:
                _check_pieces(wire, rows[wire.name], leaves)


def _check_pieces(wire, rows, leaves):
    """Beside every piece of the wire the nearest leaf is listed, unless it is far."""
    away = np.min([cdist(leaves, part).min(1) for part in np.array_split(wire.polyline(0.1), 40)], axis=0)
    away -= wire.diameter_m / 2
    pieces = np.clip(wire.base.local(leaves)[:, 0], 0, wire.base.length_m) // BESIDE_M
    least = {piece: away[pieces == piece].min() for piece in np.unique(pieces)}
    least = {piece: gap for piece, gap in least.items() if gap <= LISTED_M}
    at = np.clip(wire.base.local(rows[:, :3])[:, 0], 0, wire.base.length_m) // BESIDE_M
    assert len(at) == len(least) and np.linalg.norm(rows[:, None, :3] - leaves, axis=2).min(1).max() < 2e-3
    # A leaf at the border of two pieces, rounded to millimetres, may come into the other one.
    assert np.abs(np.sort(rows[:, 3]) - np.sort(list(least.values()))).max() < 5e-3


def test_towers_are_as_tall_as_stated_and_strings_end_at_the_clamps():
    span = build_site(SMALL)
    for tower in span.towers:
        top = steel(tower).vertices[:, 2].max() - tower.foot[2]
        assert top == pytest.approx(tower.height_m, abs=0.1)
        discs, metal = insulators(span.lines[0], tower)
        for clamp, wire in zip(tower.attachments, span.wires, strict=True):
            assert np.linalg.norm(metal.vertices - np.array(clamp), axis=1).min() < 0.05
            ends = wire.points(np.array([0.0, wire.base.length_m]))
            assert np.linalg.norm(ends - np.array(clamp), axis=1).min() < 1e-9
            if wire.kind == "phase":
                above = discs.vertices[np.linalg.norm((discs.vertices - clamp)[:, :2], axis=1) < 0.2]
                heights = above[:, 2] - clamp[2]
                assert 0 < heights.min() < heights.max() < SMALL.support.string_length_m


def test_bodies_have_the_volume_and_the_outside_of_what_they_stand_for():
    axis = np.stack([np.linspace(0, 3, 7), np.zeros(7), np.zeros(7)], axis=1)
    pipe = tube(axis, 0.5, 12)
    assert volume(pipe) == pytest.approx(2 / 3 * np.pi * 0.25 * 3, rel=1e-9)  # without its two lids
    box = beam(np.zeros(3), np.array([0, 0, 2.0]), np.array([1.0, 0, 0]), 0.3, 0.1)
    assert volume(box) == pytest.approx(0.3 * 0.1 * 2)
    cone = lathe(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]), np.array([5.0, 6.0, 7.0]), 64)
    assert volume(cone) == pytest.approx(np.pi / 3, rel=5e-3)


def test_ground_faces_the_sky_and_a_hole_is_cut_exactly():
    x = y = np.linspace(-4.0, 4.0, 9)
    mesh = grid(x, y, np.zeros((9, 9)))
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    areas = np.cross(b - a, c - a)[:, 2] / 2
    assert (areas > 0).all()
    assert areas.sum() == pytest.approx(64.0)
    ring = without(mesh, (-2.0, 2.0), (-1.0, 1.0))
    a, b, c = (ring.vertices[ring.faces[:, i]] for i in range(3))
    assert (np.cross(b - a, c - a)[:, 2] / 2).sum() == pytest.approx(64.0 - 8.0)
    assert set(ring.faces.ravel()) == set(range(len(ring.vertices)))


def test_ply_holds_every_vertex_and_face(tmp_path):
    mesh = tube(np.array([[0.0, 0, 0], [1, 0, 0]]), 0.1, 6)
    write_ply(mesh, tmp_path / "a.ply")
    header, body = (tmp_path / "a.ply").read_bytes().split(b"end_header\n", 1)
    assert f"element vertex {len(mesh.vertices)}".encode() in header
    table = np.frombuffer(body[: len(mesh.vertices) * 20], "<f4").reshape(-1, 5)
    np.testing.assert_allclose(table[:, :3], mesh.vertices, atol=1e-6)
    assert len(body) == len(mesh.vertices) * 20 + len(mesh.faces) * 13


def test_ground_colour_belongs_to_the_place_not_to_the_patch():
    """Two overlapping patches of the same texel agree where they overlap."""
    large = ground_texture(GROUND, (-4.0, 4.0), (-3.0, 3.0), 0.1, 7)
    small = ground_texture(GROUND, (-1.0, 2.0), (0.0, 3.0), 0.1, 7)
    np.testing.assert_allclose(large[:30, 30:60], small, atol=2e-3)
    x, y = np.meshgrid(np.linspace(0, 900, 300), np.linspace(0, 900, 300))
    values = noise(x, y, 2.0, 5)
    assert abs(values.mean()) < 0.05
    assert 0.5 < values.std() < 1.5


def test_textures_are_reflectances():
    for texture in (ground_texture(GROUND, (-30.0, 30.0), (-20.0, 20.0), 0.2, 7), strand_texture(10.0, 7)):
        assert 0.0 < texture.min() < texture.max() < 1.0


@pytest.mark.parametrize(
    ("kind", "change", "text"),
    [
        (SpanConfig, {"span_length_m": 0.0}, "span_length_m must be greater than 0, got 0.0"),
        (SpanConfig, {"wires": ()}, "at least one wire"),
        (SpanConfig, {"support": SupportConfig(height_m=9.0)}, "Raise the support or lower the wire"),
        (CaptureConfig, {"views_per_pass": 1}, "views_per_pass must be at least 4, got 1"),
        (CaptureConfig, {"passes": ()}, "there would be no image"),
        (CaptureConfig, {"width_px": 0}, "width_px must be greater than 0, got 0"),
        (CaptureConfig, {"filmed_m": (3.0, 3.0)}, "filmed_m must run from low to high"),
        (ImageConfig, {"sun_elevation_deg": -3.0}, "sun_elevation_deg must be in 5 to 85"),
    ],
)
def test_impossible_scenes_are_refused_in_words(kind, change, text):
    with pytest.raises(ConfigError, match=text):
        kind(**change)
