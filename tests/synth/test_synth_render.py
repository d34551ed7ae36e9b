"""One small picture by Mitsuba, and the errors of `plnerf synth`."""

import importlib.util
import json
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from plnerf.errors import ConfigError, SceneError
from plnerf.synth import parts, render
from plnerf.synth.build import build_site
from plnerf.synth.capture import View, look, plan_flight
from plnerf.synth.config import ImageConfig, PlantsConfig, SceneConfig, SpanConfig, TerrainConfig
from plnerf.synth.flight_config import CaptureConfig
from plnerf.synth.meshes import grid, tube
from plnerf.synth.parts import Part, Surface, site_parts
from plnerf.synth.render import open_studio, to_srgb
from plnerf.synth.synthesize import synthesize

needs_mitsuba = pytest.mark.skipif(
    importlib.util.find_spec("mitsuba") is None, reason="mitsuba is not installed (extra: synth)"
)
TINY = SceneConfig(
    "tiny",
    SpanConfig(terrain=TerrainConfig(texel_m=0.2), plants=PlantsConfig(1, 0, 0)),
    CaptureConfig(width_px=48, height_px=32, focal_px=44.0, views_per_pass=4),
    ImageConfig(samples_per_pixel=4),
)


def coarsen(monkeypatch):
    """Coarser ground: its fine textures take seconds to make."""
    coarse = tuple((x, y, step, 8 * texel) for x, y, step, texel in parts.GROUND_PATCHES)
    monkeypatch.setattr(parts, "GROUND_PATCHES", coarse)


@needs_mitsuba
def test_a_rod_before_a_wall_is_seen_where_and_as_far_away_as_it_is(tmp_path):
    """A horizontal rod 10 cm thick, 5 m ahead, 0.5 m above the axis; a floor 1 m below the camera."""
    rod = tube(np.stack([np.full(9, 5.0), np.linspace(-9, 9, 9), np.full(9, 0.5)], axis=1), 0.05, 24)
    floor = grid(np.linspace(-50, 50, 5), np.linspace(-50, 50, 5), np.full((5, 5), -1.0))
    grey = Surface("matt", (0.3, 0.3, 0.3))
    bodies = [Part("rod", rod, grey, wire=True), Part("floor", floor, grey)]
    capture = CaptureConfig(width_px=96, height_px=64, focal_px=80.0)
    studio = open_studio(bodies, capture, ImageConfig(samples_per_pixel=4), tmp_path)
    view = View("0000", "right", look(0.0, 0.0, 0.0), np.zeros(3))

    coverage = studio.wire_coverage(view)
    middle = coverage[:, 48]
    centre_row = (middle * (np.arange(64) + 0.5)).sum() / middle.sum()
    assert centre_row == pytest.approx(32 - 80 * 0.5 / 5, abs=0.1)
    assert middle.sum() == pytest.approx(80 * 0.1 / 5, abs=0.12)  # the rod's width in pixels

    depth = studio.depth_m(view)
    row = int(centre_row)
    np.testing.assert_allclose(depth[row, 20:76], 4.95, atol=0.02)  # along the axis: equal across the image
    np.testing.assert_allclose(depth[60, 5:90], 80 * 1.0 / (60.5 - 32), rtol=1e-3)
    assert (depth[:20] == 0).all()  # sky

    photo = studio.photo(view, 0)
    assert photo.shape == (64, 96, 3)
    assert photo[:15, :, 2].mean() > photo[:15, :, 0].mean()  # the sky is blue
    assert photo[50:].mean() > 30


@needs_mitsuba
def test_strips_of_wires_are_what_the_whole_picture_shows(tmp_path, monkeypatch):
    """Both are 36 random samples a pixel: one at 1/2 has a deviation of 1/12 at most, stratified or not."""
    coarsen(monkeypatch)
    span = build_site(TINY.span)
    capture = CaptureConfig(width_px=120, height_px=77, focal_px=110.0, views_per_pass=4)
    wires = [part for part in site_parts(span) if part.wire]
    studio = open_studio(wires, capture, ImageConfig(samples_per_pixel=4), tmp_path)
    integrator = studio.mi.load_dict({"type": "path", "max_depth": 1})
    sampler = {"type": "stratified", "sample_count": 36, "seed": 1}
    for view in plan_flight(span, capture)[::3]:
        whole = studio._render(studio.wires_only, integrator, view, sampler)[..., 0]
        strips = studio.wire_coverage(view)
        assert whole.sum() > 20
        assert np.abs(strips - whole).max() < 0.45
        assert strips.sum() == pytest.approx(whole.sum(), rel=0.02)
        assert (strips[whole > 0.35] > 0).all()


@needs_mitsuba
def test_blur_is_the_mean_of_its_instants(tmp_path):
    floor = grid(np.linspace(-50, 50, 5), np.linspace(-50, 50, 5), np.full((5, 5), -1.0))
    capture = CaptureConfig(width_px=48, height_px=32, focal_px=40.0)
    ways = (look(0.0, -0.2, 0.0), look(0.1, -0.2, 0.0))
    views = [View("0000", "right", R, np.zeros(3)) for R in ways]
    bodies = [Part("floor", floor, Surface("matt", (0.3, 0.3, 0.3)))]
    open_shutter, short = (
        open_studio(bodies, capture, ImageConfig(samples_per_pixel=count), tmp_path) for count in (8, 4)
    )
    both = open_shutter.linear(views, 5)
    first, second = short.linear(views[:1], 5), short.linear(views[1:], 5 + (1 << 16))
    np.testing.assert_allclose(both, (first + second) / 2, rtol=1e-6)
    assert both.mean() == pytest.approx((first.mean() + second.mean()) / 2, rel=1e-6)


@pytest.mark.slow
@needs_mitsuba
def test_a_seed_gives_the_same_truth_to_the_byte_and_the_same_images(tmp_path, monkeypatch):
    """Every sample of a picture is a function of the seed; only sums could differ, by a grey level."""
    coarsen(monkeypatch)
    effects = ImageConfig(samples_per_pixel=2, noise=0.02, motion_blur_px=1.0, exposure_drift=0.2)
    config = replace(TINY, image=effects, capture=replace(TINY.capture, pose_noise_m=0.05))
    first, again = (synthesize(tmp_path / name, config) for name in "ab")
    for name in ("truth.json", "transforms.json"):
        assert (first / name).read_bytes() == (again / name).read_bytes()
    for path in sorted((first / "images").iterdir()):
        one, two = (
            np.asarray(Image.open(root / "images" / path.name)).astype(int) for root in (first, again)
        )
        assert np.abs(one - two).max() <= 1
    truth = json.loads((first / "truth.json").read_text())
    written = json.loads((first / "transforms.json").read_text())["frames"]
    off = [
        np.subtract(pose["T_world_camera"], frame["transform_matrix"])[:3, 3]
        for pose, frame in zip(truth["poses"], written, strict=True)
    ]
    assert 0.02 < np.std(off) < 0.1  # 36 values of deviation 0.05
    other = synthesize(tmp_path / "c", config.with_seed(8))
    assert (other / "truth.json").read_bytes() != (first / "truth.json").read_bytes()


@needs_mitsuba
def test_a_tiny_span_becomes_a_complete_scene_folder(tmp_path, monkeypatch):
    coarsen(monkeypatch)
    calls = []
    out = synthesize(tmp_path / "a" / "span", TINY, progress=lambda done, total: calls.append((done, total)))
    assert calls == [(i + 1, 12) for i in range(12)]
    assert sorted(path.name for path in out.iterdir()) == [
        "depth",
        "images",
        "transforms.json",
        "truth.json",
        "wire_masks",
    ]
    assert [path.name for path in out.parent.iterdir()] == ["span"]  # nothing half-written stays behind
    content = json.loads((out / "transforms.json").read_text())
    for frame in content["frames"]:
        assert Image.open(out / frame["file_path"]).size == (48, 32)
        assert Image.open(out / frame["wire_mask_path"]).mode == "L"
        if "depth_path" in frame:
            assert np.asarray(Image.open(out / frame["depth_path"])).dtype == np.uint16
    photo = np.asarray(Image.open(out / content["frames"][0]["file_path"]))
    assert 40 < photo.mean() < 200 and photo.std() > 10
    assert json.loads((out / "truth.json").read_text())["config"]["capture"]["width_px"] == 48
    with pytest.raises(SceneError, match="exists and is not empty"):
        synthesize(out, TINY)


def test_without_mitsuba_the_error_says_how_to_get_it(tmp_path, monkeypatch):
    def missing(name: str):
        raise ModuleNotFoundError(name)

    monkeypatch.setattr(render.importlib, "import_module", missing)
    with pytest.raises(ConfigError) as caught:
        synthesize(tmp_path / "span", TINY)
    assert 'pip install "plnerf[synth]"' in str(caught.value)
    assert not (tmp_path / "span").exists()


def test_srgb_is_the_standard_curve():
    linear = np.array([0.0, 0.0031308, 0.18, 0.5, 1.0, 7.0])[None, :, None].repeat(3, axis=2)
    np.testing.assert_array_equal(to_srgb(linear)[0, :, 0], [0, 10, 118, 188, 255, 255])
