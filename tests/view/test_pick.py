"""What a click points at: wires near and far, cameras, the first point of a cloud."""

import numpy as np
import pytest
from tests.support.surveys import short

from plnerf.line.survey import Survey
from plnerf.view.display_frame import DisplayFrame
from plnerf.view.flights import flights_of
from plnerf.view.opened import Opened
from plnerf.view.pick import WIRE_RAD, pick_camera, pick_point, pick_wire
from plnerf.view.points import thinned


@pytest.fixture(scope="module")
def survey() -> Survey:
    return short(0.02)


def opened_of(survey: Survey, xyz: np.ndarray | None = None) -> Opened:
    points = None if xyz is None else thinned(xyz)
    return Opened("made", DisplayFrame(survey.frame, np.zeros(3)), survey, points)


def unit(x: np.ndarray) -> np.ndarray:
    return x / np.linalg.norm(x)


@pytest.mark.parametrize("distance", [0.3, 2.0, 40.0, 150.0])
def test_a_wire_is_picked_from_near_and_far(survey: Survey, distance: float) -> None:
    wire = survey.wires[1]
    s = np.array([13.37])
    at = wire.points(s)[0]
    eye = at + distance * unit(np.array([0.05, 0.02, -1.0]))
    found = pick_wire(opened_of(survey), eye, unit(at - eye))
    assert found is not None and found.number == wire.id
    assert np.linalg.norm(found.at - at) < 0.01
    assert found.sigma_m is not None and 0 < found.sigma_m == pytest.approx(wire.sigma_at(s).max(), rel=0.02)
    beside = unit(at - eye + np.array([0.0, 3 * WIRE_RAD * distance, 0.0]))
    missed = pick_wire(opened_of(survey), eye, beside)
    assert missed is None or missed.number != wire.id
    assert pick_wire(opened_of(survey), eye, -unit(at - eye)) is None  # it is behind


def test_of_points_the_first_along_the_ray_is_picked(survey: Survey) -> None:
    ray, xyz = unit(np.array([1.0, 2.0, -0.5])), np.zeros((4, 3))
    xyz[:] = [30 * ray, 10 * ray, -5 * ray, [10.0, -10.0, 3.0]]
    found = pick_point(opened_of(survey, xyz), np.zeros(3), ray)
    assert found is not None and found.number == 1 and np.allclose(found.at, 10 * ray)
    assert pick_point(opened_of(survey, xyz), np.zeros(3), unit(np.array([0.0, -1.0, 0.0]))) is None
    assert pick_point(opened_of(survey), np.zeros(3), ray) is None


def test_a_camera_is_picked_unless_the_eye_is_there(tiny_scene) -> None:  # type: ignore[no-untyped-def]
    from plnerf.view.opened import open_source

    opened = open_source(tiny_scene)
    assert opened.views is not None
    centre = opened.views.cameras.centre.numpy()
    eye = centre[4] + np.array([3.0, 1.0, 5.0])
    found = pick_camera(opened, eye, unit(centre[4] - eye))
    assert found is not None and found.number == 4
    assert pick_camera(opened, centre[4], unit(np.array([0.1, 0.2, 1.0]))) is None


def test_flights_keep_the_line_in_view(survey: Survey) -> None:
    (flight,) = flights_of(opened_of(survey))
    assert flight.name == "beside the line" and flight.length_m == pytest.approx(40.8, abs=0.2)
    u = survey.wires[0].base.u
    places = []
    for share in (0.0, 0.5, 1.0):
        eye = flight.at(share, 1.5)
        places.append(eye.centre)
        ahead = eye.R_line_camera[:, 2]
        assert ahead[:2] @ u > 0.5 and -0.6 < ahead[2] < 0
        assert 2 < eye.centre[2] - survey.wires[0].lowest[1] < 15
    assert (places[1] - places[0])[:2] @ u == pytest.approx(flight.length_m / 2, abs=0.2)
    assert (places[2] - places[0])[:2] @ u == pytest.approx(flight.length_m, abs=0.2)
