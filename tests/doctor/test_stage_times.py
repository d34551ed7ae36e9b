"""Estimates of stages grow with what a stage works on, and are of its order of magnitude."""

from dataclasses import replace
from pathlib import Path

import pytest
from tests.capture.test_capture import photos_with_positions

from plnerf.doctor import stage_times
from plnerf.pipeline import bundled_span
from plnerf.reconstruct import first_config
from plnerf.scene.formats import read_listing
from plnerf.survey.config import SurveyConfig


def test_estimates_follow_images_and_pixels() -> None:
    listing = read_listing(bundled_span())
    half = replace(listing, shots=listing.shots[::2])
    full, first = SurveyConfig(), first_config(listing)
    assert stage_times.survey_s(half, full) < stage_times.survey_s(listing, full)
    assert stage_times.survey_s(listing, first) < stage_times.survey_s(listing, full)
    for name, estimate in stage_times.ESTIMATES.items():
        assert 0 < estimate(listing, 1) < 600, name
        assert name == "survey" or estimate(listing, 2) == pytest.approx(estimate(listing, 1) / 4)


def test_poses_of_photos_are_estimated_and_those_of_a_video_are_not(tmp_path: Path) -> None:
    photos_with_positions(tmp_path / "photos")
    seconds = stage_times.capture_s(tmp_path / "photos")
    assert seconds is not None and seconds > 1
    (tmp_path / "video.mp4").write_bytes(b"")
    assert stage_times.capture_s(tmp_path / "video.mp4") is None
