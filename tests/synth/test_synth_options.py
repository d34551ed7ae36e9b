"""Changes to a named scene: what is not given stays, what is given arrives, what cannot be is refused."""

from dataclasses import fields

import pytest

from plnerf.cli.capture import synth
from plnerf.errors import ConfigError
from plnerf.synth.config import SceneConfig
from plnerf.synth.scene_options import SceneOptions, find_scene
from plnerf.synth.scenes import SCENES

SCENE = SceneConfig()


@pytest.mark.parametrize("name", SCENES)
def test_no_options_change_nothing(name: str) -> None:
    assert find_scene(name).name == name
    assert SceneOptions().apply(find_scene(name)) == find_scene(name)


def test_every_option_arrives() -> None:
    options = SceneOptions(11, 5, 240, 100, 9, 2.0, 0.01, 60, True, 0.3, 0.1, 0.02, 0.2)
    assert all(getattr(options, field.name) is not None for field in fields(options))
    scene = options.apply(SCENE)
    capture, image = scene.capture, scene.image
    assert scene.span.seed == scene.seed == 11
    assert (capture.width_px, capture.height_px, capture.focal_px) == (240, 100, 220.0)
    assert (capture.views_per_pass, capture.pose_noise_m, capture.pose_noise_deg) == (9, 0.02, 0.2)
    assert (image.samples_per_pixel, image.motion_blur_px, image.noise) == (5, 2.0, 0.01)
    assert (image.jpeg_quality, image.auto_exposure) == (60, True)
    assert (image.exposure_drift, image.white_balance_drift) == (0.3, 0.1)


def test_a_smaller_picture_shows_the_same() -> None:
    capture = SceneOptions(width=120).apply(SCENE).capture
    assert (capture.width_px, capture.height_px, capture.focal_px) == (120, 80, 110.0)


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (SceneOptions(seed=-1), "seed must be 0 or more, got -1"),
        (SceneOptions(samples=0), "samples_per_pixel must be greater than 0, got 0"),
        (SceneOptions(width=0), "width_px must be greater than 0, got 0"),
        (SceneOptions(views=2), "views_per_pass must be at least 4, got 2"),
        (SceneOptions(jpeg_quality=101), "jpeg_quality must be in 1 to 100, got 101"),
        (SceneOptions(noise=-0.1), "noise must be 0 or more, got -0.1"),
    ],
)
def test_impossible_values_are_refused_in_words(options: SceneOptions, text: str) -> None:
    with pytest.raises(ConfigError, match=text):
        options.apply(SCENE)


def test_an_unknown_scene_is_answered_with_those_there_are() -> None:
    with pytest.raises(ConfigError, match="span") as caught:
        find_scene("nowhere")
    assert "'nowhere'" in str(caught.value) and all(name in str(caught.value) for name in SCENES)


def test_the_help_names_every_scene() -> None:
    text = " ".join((synth.__doc__ or "").split())
    listed = text.split("is left out: ")[1].split(". seed:")[0]
    listed, drawn = listed.split(", random (whose seed draws everything), ")
    assert sorted(listed.split(", ")) == sorted(SCENES)
    assert drawn == "random-span (likewise, filmed from structure to structure)"
