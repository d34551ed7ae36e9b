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
from plnerf.synth.flight_config import CaptureConfig, Grid, Leg, Orbit, Pass
from plnerf.synth.random_line import draw_line, draw_other, draw_spans, draw_wind

IMAGES = 48
TRIES = 200  # of draws that cannot stand or be flown another one is made


def random_scene(seed: int) -> SceneConfig:
    """The first of this seed's draws that can stand and be flown."""
    for attempt in range(TRIES):
        try:
            scene = _draw(seed, np.random.default_rng([seed, 11, attempt]))
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


def _draw(seed: int, rng: np.random.Generator) -> SceneConfig:
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
    return SceneConfig(f"random-{seed}", span, _capture(rng, span), _image(rng))


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


def _capture(rng: np.random.Generator, span: SpanConfig) -> CaptureConfig:
    half = span.span_length_m / 2
    low, high = (
        half * float(rng.uniform(0.75, 1.25 if more else 0.98)) for more in (span.before_m, span.after_m)
    )
    pattern = rng.choice(["sides", "two sides", "zigzag", "oblique", "orbit", "grid", "climb"])
    focal = float(rng.uniform(380.0, 560.0))
    if pattern == "oblique":
        focal = float(rng.uniform(560.0, 820.0))
    legs = _legs(rng, str(pattern), span, (low, high))
    poses_off = rng.random() < 0.35
    return CaptureConfig(
        focal_px=focal,
        passes=legs,
        views_per_pass=IMAGES // len(legs),
        filmed_m=(-low, high),
        pose_noise_m=float(rng.uniform(0.0, 0.02)) if poses_off else 0.0,
        pose_noise_deg=float(rng.uniform(0.0, 0.06)) if poses_off else 0.0,
        seen_px=1.0,
    )


def _legs(
    rng: np.random.Generator, pattern: str, span: SpanConfig, filmed_m: tuple[float, float]
) -> tuple[Leg, ...]:
    right = min(span.wires, key=lambda wire: wire.across_m)
    left = max(span.wires, key=lambda wire: wire.across_m)
    top = max(span.wires, key=lambda wire: wire.height_m)
    clear = span.support.height_m - top.height_m + max(one.raised_m for one in span.structures)

    def value(low: float, high: float) -> float:
        return float(rng.uniform(low, high))

    def beside(name: str, far: float, above: float, toward: float, pitch: float) -> Pass:
        """Forth on the right or back on the left, so that the line is always on the camera's left."""
        side, sign = (right, -1.0) if name == "right" else (left, 1.0)
        start, end = (-1.0, 1.0) if name == "right" else (1.0, -1.0)
        return Pass(name, side.name, sign * far, above, start, end, toward, pitch, zigzag_m=value(0.2, 0.8))

    about = len(span.before_m) + int(rng.integers(2))
    bearing, radius = value(0.0, 360.0), value(9.5, 13.0)
    tall = span.support.height_m
    if pattern in ("sides", "two sides"):
        legs: list[Leg] = [
            beside(name, value(2.4, 4.5), value(0.0, 1.6), value(32.0, 55.0), value(-14.0, 2.0))
            for name in ("right", "left")
        ]
        if pattern == "sides":
            up = top.height_m - right.height_m + clear + value(2.0, 3.5)
            over = Pass(
                "above", right.name, value(-1.0, 0.5), up, -1.0, 1.0, value(5.0, 25.0), value(-34.0, -22.0),
                zigzag_m=value(0.2, 1.0),
            )  # fmt: skip
            legs.append(over)
        return tuple(legs)
    if pattern == "zigzag":
        up, wide, period = clear + value(2.5, 4.5), value(3.0, 6.0), value(14.0, 26.0)
        forth = Pass(
            "forth", top.name, 0.0, up, -1.0, 1.0, value(-15.0, 15.0), value(-48.0, -30.0),
            zigzag_m=wide, zigzag_period_m=period,
        )  # fmt: skip
        back = replace(forth, name="back", above_m=up + value(0.5, 2.0), start=1.0, end=-1.0, zigzag_m=-wide)
        return forth, replace(back, toward_deg=value(-15.0, 15.0), pitch_deg=value(-48.0, -30.0))
    if pattern == "oblique":
        return (
            beside("right", value(7.0, 12.0), value(3.0, 8.0), value(55.0, 80.0), value(-32.0, -16.0)),
            beside("left", value(7.0, 12.0), value(3.0, 8.0), value(55.0, 80.0), value(-32.0, -16.0)),
        )
    if pattern == "orbit":
        return (
            Orbit("low", about, radius, 0.7 * tall, 0.95 * tall, bearing, 360.0, 0.85 * tall),
            Orbit(
                "high",
                about,
                radius + value(0.0, 3.0),
                tall + 2.0,
                tall + 5.0,
                bearing + 90.0,
                -360.0,
                0.8 * tall,
            ),
        )
    if pattern == "grid":
        along, up = (-filmed_m[0], filmed_m[1]), tall + value(6.0, 9.0)
        wide = 0.5 * left.across_m + value(2.0, 3.5)  # what is farther out shows no wire
        return (
            Grid("along", along, wide, int(rng.integers(3, 5)), up),
            Grid("across", along, wide, int(rng.integers(6, 9)), up + 1.0, value(0.0, 12.0), crosses=True),
        )
    return (
        Orbit("climb", about, radius, 4.0, tall + 4.0, bearing, value(20.0, 70.0), 0.85 * tall),
        beside("right", value(2.4, 4.5), value(0.0, 1.6), value(32.0, 55.0), value(-14.0, 2.0)),
        beside("left", value(2.4, 4.5), value(1.0, 2.5), value(32.0, 55.0), value(-20.0, -2.0)),
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
