"""What becomes of a picture between the renderer and the file, with a renderer that needs no Mitsuba."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from plnerf.synth.build import build_site
from plnerf.synth.capture import plan_flight
from plnerf.synth.config import ImageConfig, PlantsConfig, SceneConfig, SpanConfig
from plnerf.synth.effects import MID_GREY, luminance
from plnerf.synth.film import _photos, film
from plnerf.synth.flight_config import CaptureConfig, Pass
from plnerf.synth.render import Studio, to_srgb

SCENE = SceneConfig(
    "tiny",
    SpanConfig(plants=PlantsConfig(1, 0, 0)),
    CaptureConfig(width_px=48, height_px=32, focal_px=44.0, views_per_pass=6),
)
SPAN = build_site(SCENE.span)
VIEWS = plan_flight(SPAN, SCENE.capture)


class Wall(Studio):
    """A renderer that sees a wall of colours which turns brighter from view to view."""

    def __init__(self) -> None:
        object.__setattr__(self, "instants", [])

    def linear(self, instants, seed):
        self.instants.append(len(instants))
        picture = np.linspace(0.05, 0.5, 48)[None, :, None] * np.array([0.9, 1.0, 0.6])
        return np.broadcast_to(picture * (0.3 + 0.08 * seed), (32, 48, 3)).copy()

    def wire_coverage(self, view):
        coverage = np.zeros((32, 48))
        coverage[10], coverage[20] = 0.099, 0.1
        return coverage

    def depth_m(self, view):
        depth = np.full((32, 48), 3.25)
        depth[0], depth[1] = 0.0, 70.0
        return depth


def photos(**image: object) -> list[np.ndarray]:
    return list(_photos(Wall(), SPAN, VIEWS, replace(SCENE, image=ImageConfig(**image))))


def test_without_effects_the_light_is_what_the_renderer_gave() -> None:
    wall = Wall()
    given = [wall.linear([0], i) for i in range(len(VIEWS))]
    np.testing.assert_array_equal(np.stack(photos()), np.stack(given))


def test_automatic_exposure_keeps_the_brightness_that_the_scene_changes() -> None:
    plain = np.array([luminance(photo) for photo in photos()])
    automatic = np.array([luminance(photo) for photo in photos(auto_exposure=True)])
    assert plain[-1] / plain[0] > 3
    assert np.abs(np.log(automatic / MID_GREY)).max() < 0.5


def test_white_balance_changes_colours_and_exposure_does_not() -> None:
    plain = np.stack(photos())
    warm = np.stack(photos(white_balance_drift=0.2)) / plain
    np.testing.assert_allclose(warm[..., 1], 1.0)
    assert np.log(warm[:, 0, 0, 0] / warm[:, 0, 0, 2]).std() == pytest.approx(0.2)
    brighter = np.stack(photos(exposure_drift=0.5)) / plain
    np.testing.assert_allclose(brighter, brighter[:, :1, :1, :1] * np.ones((1, 32, 48, 3)))
    assert np.log2(brighter[:, 0, 0, 0]).std() == pytest.approx(0.5)


def test_noise_differs_between_views_and_returns_with_the_seed() -> None:
    plain, noisy = np.stack(photos()), np.stack(photos(noise=0.02))
    off = noisy - plain
    assert 0.01 < off.std() < 0.04
    assert abs(np.corrcoef(off[0].ravel(), off[1].ravel())[0, 1]) < 0.1
    np.testing.assert_array_equal(np.stack(photos(noise=0.02)), noisy)


@pytest.mark.parametrize(("blur_px", "samples", "instants"), [(0.0, 36, 1), (4.5, 36, 6), (9.0, 4, 4)])
def test_the_shutter_is_rendered_at_an_instant_a_pixel_if_there_are_samples(blur_px, samples, instants):
    wall = Wall()
    image = ImageConfig(samples_per_pixel=samples, motion_blur_px=blur_px)
    list(_photos(wall, SPAN, VIEWS, replace(SCENE, image=image)))
    assert set(wall.instants) == {instants}


def test_files_hold_what_was_seen(tmp_path) -> None:
    told = []
    masks = film(Wall(), SPAN, VIEWS, SCENE, tmp_path, lambda done, total: told.append((done, total)))
    assert told == [(i + 1, 18) for i in range(18)]
    photo = np.asarray(Image.open(tmp_path / "images" / "0003.jpg")).astype(int)
    assert np.abs(photo - to_srgb(photos()[3]).astype(int)).mean() < 2  # quality 95
    expected = np.zeros((32, 48), dtype=np.bool_)
    expected[20] = True
    for i, mask in enumerate(masks):
        np.testing.assert_array_equal(mask, expected)
        stored = np.asarray(Image.open(tmp_path / "wire_masks" / f"{i:04d}.png"))
        np.testing.assert_array_equal(stored, np.where(expected, 255, 0))
    depth = np.asarray(Image.open(tmp_path / "depth" / "0008.png"))
    assert (depth[2:] == 3250).all() and (depth[:2] == 0).all()
    assert len(list((tmp_path / "depth").iterdir())) == 3


def test_lower_quality_makes_smaller_files(tmp_path) -> None:
    sizes = []
    for quality in (95, 40):
        config = replace(SCENE, image=ImageConfig(jpeg_quality=quality))
        film(Wall(), SPAN, VIEWS[:1], config, tmp_path / str(quality))
        sizes.append((tmp_path / str(quality) / "images" / "0000.jpg").stat().st_size)
    assert sizes[1] < sizes[0]


@pytest.mark.parametrize("filmed_m", [(-5.0, 5.0), (4.0, 16.0)])
def test_a_flight_of_a_stretch_stays_within_it(filmed_m) -> None:
    legs = (Pass("there", "phase A", -2.5, 0.8, -1.0, 1.0, 40.0, 0.0, zigzag_m=0.5),
            Pass("back", "phase B", 2.5, 0.8, 1.0, -1.0, 40.0, 0.0))  # fmt: skip
    capture = replace(SCENE.capture, passes=legs, filmed_m=filmed_m)
    along = np.array([view.centre[:2] @ SPAN.along for view in plan_flight(SPAN, capture)])
    assert along.min() == pytest.approx(filmed_m[0]) and along.max() == pytest.approx(filmed_m[1])


def test_a_zigzag_swings_as_wide_and_as_often_as_asked_for() -> None:
    still = Pass("there", "phase A", -2.5, 0.8, -1.0, 1.0, 40.0, 0.0, weave_m=0.0)
    capture = replace(SCENE.capture, views_per_pass=200)
    swings = [
        np.array([
            [view.centre[:2] @ SPAN.along, view.centre[1] * SPAN.along[0] - view.centre[0] * SPAN.along[1]]
            for view in plan_flight(SPAN, replace(capture, passes=(leg,)))
        ])
        for leg in (still, replace(still, zigzag_m=1.5, zigzag_period_m=8.0))
    ]
    np.testing.assert_allclose(swings[0][:, 0], swings[1][:, 0], atol=1e-12)
    swing = swings[1][:, 1] - swings[0][:, 1]
    np.testing.assert_allclose(swing, 1.5 * np.sin(2 * np.pi * swings[0][:, 0] / 8.0), atol=1e-9)
