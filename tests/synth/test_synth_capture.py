"""The flight: proper cameras, close to the wires, and held-out views between training views."""

import numpy as np
import pytest

from plnerf.synth.build import build_site
from plnerf.synth.capture import look, plan_flight
from plnerf.synth.config import SceneConfig
from plnerf.synth.hints import hints_of
from plnerf.synth.synthesize import HOLD_OUT_EVERY, transforms_of

SCENE = SceneConfig()
CONFIG = SCENE.capture
SPAN = build_site(SCENE.span)
VIEWS = plan_flight(SPAN, CONFIG)
AXES = [wire.polyline(0.02) for wire in SPAN.wires]


def in_image(view, points):
    """Pixel coordinates and depths of world points, and which of them fall into the image."""
    local = (points - view.centre) @ view.R_world_camera
    half = np.array([CONFIG.width_px, CONFIG.height_px]) / 2
    pixel = local[:, :2] / local[:, 2:] * CONFIG.focal_px + half
    return pixel, local[:, 2], (local[:, 2] > 0.1) & (pixel > 0).all(1) & (pixel < 2 * half).all(1)


def test_rotations_are_proper_and_look_turns_as_it_says():
    for view in VIEWS:
        R = view.R_world_camera
        np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(R) == pytest.approx(1.0)
        gl = view.T_world_camera_opengl()
        assert np.linalg.det(gl[:3, :3]) == pytest.approx(1.0)
        np.testing.assert_allclose(gl[:3, 2], -R[:, 2])  # OpenGL looks along -z
    np.testing.assert_allclose(look(0.0, 0.0, 0.0), [[0, 0, 1], [-1, 0, 0], [0, -1, 0]], atol=1e-12)
    assert look(0.3, 0.2, 0.0)[2, 2] == pytest.approx(np.sin(0.2))  # pitch is upwards
    assert look(0.3, 0.2, 0.0)[2, 0] == pytest.approx(0.0)  # without roll the image's x axis is level
    assert look(0.3, 0.2, 0.1)[2, 0] < 0  # rolled clockwise the right side dips


def test_the_flight_is_close_and_the_nearest_wire_is_four_to_ten_pixels_wide():
    """The nearest conductor is 2 to 5 m away; between the towers the followed one is 4 to 10 px wide."""
    gaps = [[np.linalg.norm(axis - view.centre, axis=1).min() for axis in AXES] for view in VIEWS]
    distance = np.array(gaps)
    assert distance.min(axis=1).min() >= 2.0 and distance.min(axis=1).max() <= 5.0
    assert (distance.min(axis=0) < 3.0).all()  # every wire is passed closely by some camera
    for leg in {view.flight_pass for view in VIEWS}:
        name = next(p.follows for p in CONFIG.passes if p.name == leg)
        follows = next(i for i, wire in enumerate(SPAN.wires) if wire.name == name)
        rows = [
            CONFIG.focal_px * SPAN.wires[follows].diameter_m / distance[i, follows]
            for i, view in enumerate(VIEWS)
            if view.flight_pass == leg and abs(SPAN.along @ view.centre[:2]) < SCENE.span.span_length_m / 2
        ]
        assert min(rows) >= 4.0 and max(rows) <= 10.0


def test_every_metre_of_every_wire_is_seen_from_all_three_passes():
    for axis in AXES:
        middle = axis[len(axis) // 10 : -len(axis) // 10 : 25]
        for leg in ("right", "left", "above"):
            seen = sum(in_image(view, middle)[2].astype(int) for view in VIEWS if view.flight_pass == leg)
            assert (seen >= 1).mean() > 0.85


def test_every_view_shows_wires():
    for view in VIEWS:
        assert sum(in_image(view, axis)[2].any() for axis in AXES) >= 2


def test_held_out_views_have_training_neighbours_in_time_and_place_on_both_sides():
    count = len(VIEWS)
    for i in range(0, count, HOLD_OUT_EVERY):
        for j in ((i - 1) % count, (i + 1) % count):  # the flight is a loop
            assert j % HOLD_OUT_EVERY != 0
            assert VIEWS[j].flight_pass == VIEWS[i].flight_pass
            assert np.linalg.norm(VIEWS[j].centre - VIEWS[i].centre) < 2.5
            assert VIEWS[j].R_world_camera[:, 2] @ VIEWS[i].R_world_camera[:, 2] > np.cos(np.radians(15))


def test_cameras_keep_clear_of_plants_towers_and_ground():
    for view in VIEWS:
        for plant in SPAN.plants:
            away = view.centre - np.array(plant.foot)
            assert np.hypot(*away[:2]) > plant.radius_m + 0.5 or away[2] > plant.height_m + 0.5
        assert view.centre[2] - SPAN.ground.heights(view.centre[:1], view.centre[1:2])[0] > 5.0


def test_transforms_json_holds_every_pose_and_nothing_of_the_line():
    content = transforms_of(CONFIG, VIEWS)
    assert set(content["plnerf"]) == {"format_version", "unit", "crs", "up", "truth"}
    assert len(content["frames"]) == len(VIEWS) == 3 * CONFIG.views_per_pass
    assert "test" not in content["plnerf"]  # the default rule decides: every 8th by name
    names = [frame["file_path"] for frame in content["frames"]]
    assert names == sorted(names)
    held_out = [i for i, frame in enumerate(content["frames"]) if "depth_path" in frame]
    assert held_out == list(range(0, len(VIEWS), 8))


def test_hints_are_the_direction_of_the_line_and_a_box_around_the_span():
    hints = hints_of(SPAN, CONFIG)
    np.testing.assert_allclose(hints["line_axis"], [*SPAN.along, 0.0])
    low, high = (np.array(hints[key]) for key in ("span_min", "span_max"))
    for axis in AXES:
        assert (axis > low).all() and (axis < high).all()
    for tower in SPAN.towers:
        foot = np.array(tower.foot)
        assert (foot > low).all() and (foot + np.array([0, 0, tower.height_m]) < high).all()
