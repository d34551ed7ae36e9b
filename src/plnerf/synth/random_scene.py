"""Scenes drawn at random: line, land, plants, flight, camera and light; a seed gives always the same one.

What a method is tuned on it may be tuned to: these scenes are as many as there are seeds.
"""

from dataclasses import replace

import numpy as np

from plnerf.errors import ConfigError
from plnerf.synth.build import furnish, stand
from plnerf.synth.capture import plan_flight
from plnerf.synth.check import check_cameras, check_growth
from plnerf.synth.config import ImageConfig, PlantsConfig, SceneConfig, SpanConfig, TerrainConfig
from plnerf.synth.random_flight import draw_capture
from plnerf.synth.random_line import draw_line, draw_other, draw_spans, draw_wind

TRIES = 200  # of draws that cannot stand or be flown another one is made


def random_scene(seed: int, *, whole_span: bool = False) -> SceneConfig:
    """The first of this seed's draws that can stand and be flown.

    whole_span: a span is filmed from structure to structure, with up to 120 images in place of 48.
    """
    kind = 12 if whole_span else 11
    for attempt in range(TRIES):
        try:
            scene = _draw(seed, np.random.default_rng([seed, kind, attempt]), whole_span=whole_span)
            bare = stand(scene.span)
            views = plan_flight(bare, scene.capture)
            check_cameras(bare, views)  # soon refused, without plants
            check_growth(furnish(bare), views)
        except ConfigError:
            continue
        return scene
    raise ConfigError(
        f"synth: none of {TRIES} draws of the random scene {seed} can stand and be flown. Take another seed."
    )


def _draw(seed: int, rng: np.random.Generator, *, whole_span: bool) -> SceneConfig:
    drawn = draw_line(rng)
    before, after, structures, slack = draw_spans(rng, drawn)
    bends = any(abs(one.turn_deg) > 5 for one in structures)
    span = SpanConfig(
        seed=seed,
        span_length_m=drawn.length_m,
        line_azimuth_deg=float(rng.uniform(-180.0, 180.0)),
        wires=draw_wind(rng, drawn.wires),
        support=drawn.support,
        spacer_step_m=float(rng.uniform(12.0, 25.0)),
        before_m=before,
        after_m=after,
        structures=structures,
        slack=slack,
    )
    if rng.random() < 0.35:
        span = replace(span, others=(draw_other(rng, span.line),))
    terrain, houses = _terrain(rng, roads=not bends and not span.others)
    span = replace(span, terrain=terrain, houses=houses, plants=_plants(rng, open_land=bool(span.others)))
    name = f"random-span-{seed}" if whole_span else f"random-{seed}"
    return SceneConfig(name, span, draw_capture(rng, span, whole_span=whole_span), _image(rng))


def _terrain(rng: np.random.Generator, *, roads: bool) -> tuple[TerrainConfig, int]:
    """The land, and how many houses stand on it."""
    track = rng.choice(["dirt", "road", "none"], p=[0.2, 0.3, 0.5])
    track = "none" if track == "road" and not roads else track
    houses = int(rng.integers(0, 5)) if track == "road" else 0
    tint = rng.uniform(0.7, 1.3) * rng.uniform(0.85, 1.15, 3)
    return TerrainConfig(
        waves=float(rng.uniform(0.2, 1.2)),
        hills=float(rng.uniform(0.1, 1.2)),
        rise_m=float(rng.uniform(-5.0, 5.0)) if rng.random() < 0.4 else 0.0,
        track=str(track),  # type: ignore[arg-type]
        shift_m=(float(rng.uniform(-300, 300)), float(rng.uniform(-300, 300))),
        fine_m=(56.0, 56.0),
        texel_m=0.045,
        lush=float(rng.uniform(0.25, 0.75)),
        bare=float(rng.uniform(-1.5, -0.2)),
        tint=(float(tint[0]), float(tint[1]), float(tint[2])),
    ), houses


def _plants(rng: np.random.Generator, *, open_land: bool) -> PlantsConfig:
    across = float(rng.uniform(11.0, 18.0)) + (8.0 if open_land else 0.0)
    tall = float(rng.uniform(5.0, 8.0))
    near = int(rng.integers(3, 9)) if rng.random() < 0.3 else 0
    return PlantsConfig(
        trees=int(rng.integers(2, 22)),
        bushes=int(rng.integers(4, 50)),
        background=int(rng.integers(40, 200)),
        trees_across_m=(across, across + float(rng.uniform(6.0, 14.0))),
        tree_height_m=(0.8 * tall, 1.3 * tall),
        conifers=float(rng.uniform(0.0, 0.8)) if rng.random() < 0.6 else 0.0,
        near=near,
        near_across_m=(0.0, 8.0),
    )


def _image(rng: np.random.Generator) -> ImageConfig:
    elevation = float(rng.uniform(22.0, 70.0))
    automatic = bool(rng.random() < 0.6)
    low_sun = float(np.clip(np.sin(np.radians(46.0)) / np.sin(np.radians(elevation)), 0.8, 1.5))
    return ImageConfig(
        samples_per_pixel=16,
        sun_azimuth_deg=float(rng.uniform(0.0, 360.0)),
        sun_elevation_deg=elevation,
        exposure=2.9 * low_sun * float(rng.uniform(0.8, 1.2)),
        auto_exposure=automatic,
        exposure_drift=float(rng.uniform(0.0, 0.3)) if rng.random() < 0.5 else 0.0,
        white_balance_drift=float(rng.uniform(0.0, 0.06)) if rng.random() < 0.5 else 0.0,
        motion_blur_px=float(rng.uniform(0.0, 2.0)) if rng.random() < 0.5 else 0.0,
        noise=float(rng.uniform(0.0, 0.015)),
        jpeg_quality=int(rng.integers(75, 97)),
        turbidity=float(rng.uniform(2.0, 7.0)),
    )
