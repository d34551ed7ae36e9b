"""What is drawn: what of a corridor was seen, a photo wiped over a field, the photos of a wire."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("viser", reason="plnerf[view] is not installed")

from tests.support.surveys import short

from plnerf.line.coverage import Coverage
from plnerf.line.frame import LineFrame
from plnerf.line.hang import hang
from plnerf.view.backdrop import NEAR, composed
from plnerf.view.display_frame import DisplayFrame
from plnerf.view.field_pictures import FAR, FieldPicture, strips
from plnerf.view.frustums import SmallPhotos, frustum_height, scale_of
from plnerf.view.line_drawing import AMBER, GREEN, RED, clearances_shown, ribbons
from plnerf.view.opened import open_source
from plnerf.view.wire_panel import photos_of_wire, with_wire


def test_what_was_not_seen_is_red_or_amber() -> None:
    survey = short(0.02)
    edges = np.linspace(0.0, 40.8, 5)
    coverage = Coverage(
        1, 1, edges[:-1], edges[1:], np.array([0.9, 0.1, 0.9, 0.1]), np.array([0.9, 0.9, 0.2, 0.2]),
        np.array([9.0, 9.0, 2.0, 1.0]), 0.5,
    )  # fmt: skip
    found = list(ribbons(replace(survey, coverage=(coverage,))))
    assert [one.colour for one in found] == [GREEN, AMBER, AMBER, RED]
    along = np.array([one.corners[:, 0].mean() for one in found])
    assert np.allclose(np.diff(along), 10.2, atol=0.01) and abs(along.mean()) < 0.1  # of the span
    y = np.concatenate([one.corners[:, 1] for one in found])
    assert -7 < y.min() < -4.5 and 4.5 < y.max() < 7  # below the wires, and a little beside them
    assert all(one.corners[:, 2].max() < 3 for one in found)  # on the ground
    assert list(ribbons(survey)) == []


def test_all_that_is_too_near_is_shown() -> None:
    survey = short(0.05)
    shown = clearances_shown(survey)
    assert {one.to for one in shown} >= {"ground", "vegetation"}
    assert survey.clearances is not None
    near = [one for one in survey.clearances.least_places() if one.distance_m < 4.5 and one.kind == "phase"]
    assert near and {id(one) for one in near} <= {id(one.place) for one in shown}


def field_picture() -> FieldPicture:
    return FieldPicture(np.full((5, 8, 3), 60, np.uint8), np.full((5, 8), 3.0), None)


def test_a_photo_is_wiped_from_the_left() -> None:
    photo, inside = np.full((40, 100, 3), 200, np.uint8), np.ones((40, 100), np.bool_)
    inside[:, :10] = False  # beside the photo
    image, depth = composed(field_picture(), (photo, inside), 0.5)
    assert image is not None and depth is not None
    assert (image[:, 10:48] == 200).all() and (depth[:, 10:49] == NEAR).all()
    assert (image[:, :10] == 60).all() and (image[:, 52:] == 60).all() and (depth[:, 52:] == 3.0).all()
    alone, far = composed(None, (photo, inside), 0.5)
    assert alone is not None and far is not None
    assert (alone[:, 52:] == 255).all() and (far[:, 52:] == FAR).all()
    whole, _ = composed(None, (photo, inside), 1.0)
    assert whole is not None and (whole[:, 10:] == 200).all()
    assert composed(None, None, 0.5) == (None, None)


def test_the_photos_of_a_wire_are_those_that_show_it(tiny_scene: Path) -> None:
    views = open_source(tiny_scene).views
    frame = open_source(tiny_scene).frame.line
    assert views is not None
    ends = frame.from_world(np.array([[-0.5, 0.0, 0.6], [0.5, 0.0, 0.6]]))
    wire = hang(tuple(ends[0]), tuple(ends[1]), 0.05, id=1)
    order = photos_of_wire(views, wire)
    assert len(order) == 12  # it hangs before the ball that all of them show
    # Seen from aside it is longer than seen along itself: cameras 0 and 8 look along x.
    assert order[-1] in {0, 8} and order[0] not in {0, 8}
    drawn, photo = with_wire(views, order[0], wire), views.photo(order[0], 960)
    assert drawn is not None and photo is not None and (drawn != photo).any()
    above = frame.from_world(np.array([[-0.5, 0.0, 60.0], [0.5, 0.0, 60.0]]))
    assert photos_of_wire(views, hang(tuple(above[0]), tuple(above[1]), 0.05, id=1)) == []


def test_strips_are_the_picture(tiny_scene: Path) -> None:
    views = open_source(tiny_scene).views
    assert views is not None
    camera = views.cameras[[2]]
    parts = strips(camera, 5 * 48 + 7)
    assert [one.size_px[0, 1].item() for one in parts] == [5] * 6 + [2]
    assert [one.principal_px[0, 1].item() for one in parts] == [16.0 - 5 * k for k in range(7)]
    assert all(one.size_px[0, 0] == 48 and one.principal_px[0, 0] == 24 for one in parts)


def test_frustums_are_as_high_as_they_are_to_be(tiny_scene: Path) -> None:
    opened = open_source(tiny_scene)
    assert opened.views is not None
    from plnerf.view.eye import eye_of

    eye = eye_of(opened.views.cameras, 0, 1.5)
    tall = np.tan(eye.fov_rad / 2)
    drawn = 2 * tall / np.cbrt(tall * tall * eye.aspect / 3) * scale_of(eye, 0.2)  # as viser draws it
    assert drawn == pytest.approx(0.2)
    step = np.linalg.norm(np.diff(opened.views.cameras.centre.numpy(), axis=0), axis=1)
    assert 0 < frustum_height(opened.views.cameras.centre.numpy()) < np.median(step)
    assert frustum_height(np.zeros((1, 3))) > 0
    small = SmallPhotos(opened.views)
    photo = small.of(3)
    assert photo is not None and photo is small.of(3)  # read once for all browsers
    assert DisplayFrame(LineFrame.of_cloud(np.zeros((1, 3)), None), np.zeros(3)).to_viewer(np.ones(3))[0] < 1
