"""What a survey without wires says of the reason."""

import re

import numpy as np
import pytest
from tests.support.drawn import hanging, pinhole_cameras, uncertain

from plnerf.line.frame import LineFrame
from plnerf.scene.photos import PhotoFiles
from plnerf.survey.no_wires import why_none
from plnerf.survey.posed_photos import Photos
from plnerf.survey.surface import Surface


def looking_down(height_m: float, zigzag: float = 2.0) -> Photos:
    """Six cameras without pictures, 160 px to the unit of depth, at a height above the ground."""
    frame = LineFrame(np.eye(3), 1.0, np.zeros(3), "m", None, scene_per_unit=1.0)
    centres = np.array([[x, zigzag * (-1) ** x, height_m] for x in range(6)])
    cameras = frame.cameras(pinhole_cameras(centres, centres * [1, 1, 0] + [0, 0.01, 0]))
    images = PhotoFiles(())  # no picture is read
    return Photos(
        frame, cameras, images, images, cameras.size_px.numpy(), tuple("012345"), tuple(range(6)),
        np.array([[-50.0] * 3, [50.0] * 3]),
    )  # fmt: skip


def ground() -> Surface:
    x, y = np.meshgrid(np.linspace(-1, 6, 20), np.linspace(-1, 1, 10))
    xyz = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], 1)
    return Surface(xyz, np.zeros((len(xyz), 3), np.uint8), np.full(len(xyz), 0.1), np.zeros((len(xyz), 3)))


@pytest.mark.parametrize(("height_m", "thin"), [(30.0, True), (2.0, False)])
def test_wires_too_thin_are_told_by_the_distance(height_m: float, thin: bool) -> None:
    photos = looking_down(height_m)
    finding = why_none([], photos, ground(), 0.03)
    focal = float(photos.cameras.focal_px[0].mean())
    told = re.search(r"([0-9.]+) px wide", finding.text)
    # What is seen aslant is farther away than the height.
    assert (
        told is not None and 0.85 * 0.03 * focal / height_m - 0.05 < float(told[1]) <= 0.03 * focal / height_m
    )
    assert ("too thin" in finding.text) == ("Fly nearer" in finding.text) == thin


def test_views_that_are_alike_are_told() -> None:
    finding = why_none([uncertain(hanging(0.1, 0.2))], looking_down(5.0), ground(), 0.03)
    assert "too alike" in finding.text and "another pass" in finding.do


@pytest.mark.parametrize(("zigzag", "one"), [(0.0, True), (0.2, True), (2.0, False)])
def test_a_single_straight_track_is_told(zigzag: float, one: bool) -> None:
    finding = why_none([], looking_down(20.0, zigzag), ground(), 0.03)
    assert ("one straight line" in finding.text) == ("another pass" in (finding.do or "")) == one
    assert not one or "20 m from what they show" in finding.text


def test_without_a_surface_nothing_is_claimed() -> None:
    assert (
        why_none([], looking_down(5.0), Surface.empty(), 0.03).text == "The images show no line that hangs."
    )
