"""The scenes of the benchmark, as plain values: each is there for one reason, which stands above it.

`double-circuit` follows a real line in Groningen: airborne LiDAR (AHN4 tile 07CZ2, class 14 conductors, 15
towers).  Measured by fitting a catenary to every conductor of one span (residuals 3 to 4 cm): span 335 m;
twelve phase conductors, six twin bundles 0.40 m apart at 4.33, 3.81 and 3.31 m from the axis, clamped 20.6,
27.05 and 33.5 m above the foot, sags 8.0 to 8.2 m; two earth wires 3.0 m from the axis at 41.35 m, with sags
of 7.2 to 7.4 m; lattice towers 43.2 m high with arms at 23.2, 29.7 and 36.2 m that reach 7.9, 7.0 and 6.1 m
out, from which Vs of insulators hang, and an arm for the earth wires; 5.3 m wide at the foot, 2 m at the
lowest arm.
"""

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

from plnerf.synth import line_scenes
from plnerf.synth.config import ImageConfig, PlantsConfig, SceneConfig, SpanConfig, TerrainConfig
from plnerf.synth.flight_config import CaptureConfig, Pass
from plnerf.synth.line_config import SupportConfig, WireConfig

SPAN = SceneConfig()

DOUBLE_CIRCUIT = SceneConfig(
    "double-circuit",
    SpanConfig(
        seed=11,
        span_length_m=335.0,
        line_azimuth_deg=-6.0,
        wires=(
            *(
                WireConfig(f"{side} {level}", "phase", sign * y, z, 8.1, 0.032, 2, 0.40, "vee")
                for side, sign in (("left", 1.0), ("right", -1.0))
                for level, y, z in (("low", 4.33, 20.6), ("mid", 3.81, 27.05), ("top", 3.31, 33.5))
            ),
            WireConfig("left earth", "shield", 3.0, 41.35, 7.3, 0.022, insulator="none"),
            WireConfig("right earth", "shield", -3.0, 41.35, 7.3, 0.022, insulator="none"),
        ),
        support=SupportConfig(height_m=43.2, foot_m=5.4, waist_m=2.1, shoulder_m=1.3, string_length_m=2.65),
        terrain=TerrainConfig(waves=0.35, hills=0.12, track="none", centre_m=-130.0),
        plants=PlantsConfig(trees=22, bushes=26, background=230, trees_across_m=(14.0, 45.0)),
        spacer_step_m=45.0,
    ),
    CaptureConfig(
        width_px=576,
        height_px=384,
        focal_px=430.0,
        passes=(
            Pass("right low", "right low", -7.0, 3.0, -1.2, 0.8, 33.0, 4.0, zigzag_m=0.8),
            Pass("left low", "left low", 7.0, 3.0, 0.8, -1.2, 33.0, 4.0, zigzag_m=0.8),
            Pass("right high", "right top", -6.0, 3.5, -1.2, 0.8, 36.0, -8.0, zigzag_m=0.8),
            Pass("left high", "left top", 6.0, 3.5, 0.8, -1.2, 36.0, -8.0, zigzag_m=0.8),
        ),
        views_per_pass=24,
        filmed_m=(-165.0, -97.0),
    ),
)

DISTRIBUTION = SceneConfig(
    "distribution",
    SpanConfig(
        seed=23,
        span_length_m=48.0,
        line_azimuth_deg=9.0,
        wires=(
            WireConfig("phase A", "phase", -1.12, 10.1, 0.75, 0.0143, insulator="pin"),
            WireConfig("phase B", "phase", 0.40, 10.1, 0.75, 0.0143, insulator="pin"),
            WireConfig("phase C", "phase", 1.12, 10.1, 0.75, 0.0143, insulator="pin"),
            WireConfig("neutral", "neutral", -0.24, 8.2, 0.85, 0.0113, insulator="spool"),
        ),
        support=SupportConfig("pole", height_m=10.3, foot_m=0.32, waist_m=0.21),
        terrain=TerrainConfig(waves=0.3, hills=0.5, track="road"),
        plants=PlantsConfig(
            trees=11, bushes=20, background=150, trees_across_m=(9.0, 22.0), tree_height_m=(4.5, 7.5)
        ),
        houses=4,
    ),
    CaptureConfig(
        passes=(
            Pass("right", "phase A", -2.3, 0.5, -1.15, 0.78, 36.0, -7.0, zigzag_m=0.5),
            Pass("left", "phase C", 2.3, 0.9, 1.15, -0.78, 36.0, -8.0, zigzag_m=0.5),
            Pass("above", "phase B", -0.9, 2.4, -1.15, 0.78, 22.0, -18.0, zigzag_m=0.6),
        ),
        views_per_pass=20,
    ),
)

FOREST = SceneConfig(
    "forest",
    SpanConfig(
        seed=31,
        span_length_m=50.0,
        line_azimuth_deg=-3.0,
        support=SupportConfig(height_m=12.7),
        plants=PlantsConfig(
            trees=70,
            bushes=70,
            background=200,
            trees_across_m=(9.5, 22.0),
            tree_height_m=(6.0, 11.0),
            conifers=0.45,
            near=18,
            near_clearance_m=(2.0, 4.0),
            near_across_m=(0.0, 5.5),
            clearance_m=2.0,
        ),
        terrain=TerrainConfig(waves=0.8, track="none"),
    ),
    CaptureConfig(
        passes=(
            Pass("right", "phase A", -2.3, 0.9, -1.1, 0.74, 38.0, -5.0, zigzag_m=0.5),
            Pass("left", "phase B", 2.3, 1.0, 1.1, -0.74, 38.0, -5.0, zigzag_m=0.5),
            Pass("above", "phase A", -0.5, 2.7, -1.1, 0.74, 27.0, -8.0, zigzag_m=0.5),
        ),
        views_per_pass=22,
    ),
)

HILLS = SceneConfig(
    "hills",
    SpanConfig(
        seed=43,
        span_length_m=60.0,
        line_azimuth_deg=14.0,
        wires=(
            WireConfig("phase A", "phase", -2.0, 9.8, 1.9, 0.028),
            WireConfig("phase B", "phase", 2.0, 9.8, 1.9, 0.028),
            WireConfig("phase C", "phase", 1.6, 11.4, 1.9, 0.028),
            WireConfig("shield", "shield", 0.0, 13.28, 1.4, 0.018, insulator="none"),
        ),
        support=SupportConfig(height_m=13.4),
        terrain=TerrainConfig(waves=0.8, rise_m=12.0, track="none"),
        plants=PlantsConfig(trees=14, bushes=30, background=190, conifers=0.6),
    ),
    CaptureConfig(
        passes=(
            Pass("right", "phase A", -2.5, 0.8, -1.1, 0.76, 38.0, 4.0, zigzag_m=0.6),
            Pass("left", "phase B", 2.5, 1.0, 1.1, -0.76, 38.0, -10.0, zigzag_m=0.6),
            Pass("above", "phase A", -0.5, 2.8, -1.1, 0.76, 27.0, 4.0, zigzag_m=0.6),
        ),
        views_per_pass=24,
    ),
)

BUNDLE = SceneConfig(
    "bundle",
    SpanConfig(
        seed=53,
        span_length_m=70.0,
        line_azimuth_deg=5.0,
        wires=(
            WireConfig("phase A", "phase", -3.0, 11.0, 2.0, 0.030, bundle=2),
            WireConfig("phase B", "phase", 3.0, 11.0, 2.0, 0.030, bundle=2),
            WireConfig("phase C", "phase", 2.5, 13.9, 2.0, 0.030, bundle=2),
            WireConfig("shield", "shield", 0.0, 17.4, 1.5, 0.020, insulator="none"),
        ),
        support=SupportConfig(height_m=17.5, foot_m=3.2, waist_m=1.0, shoulder_m=0.8, string_length_m=1.5),
        terrain=TerrainConfig(waves=0.8, track="none"),
        plants=PlantsConfig(trees=12, bushes=24, background=180),
    ),
    CaptureConfig(
        passes=(
            Pass("right", "phase A", -2.7, 0.8, -1.12, 0.78, 38.0, 0.0, zigzag_m=0.6),
            Pass("left", "phase B", 2.9, 1.2, 1.12, -0.78, 38.0, 3.0, zigzag_m=0.6),
            Pass("above", "phase A", -0.3, 3.0, -1.12, 0.78, 27.0, -3.0, zigzag_m=0.6),
        ),
        views_per_pass=24,
    ),
)

FAR = SceneConfig(
    "far",
    SpanConfig(
        seed=61,
        span_length_m=60.0,
        wires=tuple(replace(wire, sag_m=1.5 * wire.sag_m) for wire in SpanConfig().wires),
        terrain=TerrainConfig(track="none"),
        plants=PlantsConfig(trees=9, trees_across_m=(19.0, 30.0)),
    ),
    CaptureConfig(
        focal_px=600.0,
        passes=(
            Pass("right", "phase A", -12.5, 2.0, -1.3, 0.8, 58.0, -8.0, weave_m=1.0, heave_m=0.7),
            Pass("left", "phase B", 13.0, 4.0, 1.3, -0.8, 58.0, -14.0, weave_m=1.0, heave_m=0.7),
            Pass("above", "phase A", -4.0, 12.0, -1.5, 0.55, 18.0, -32.0, weave_m=1.0, heave_m=0.7),
        ),
        views_per_pass=22,
    ),
)

EXPOSURE = SceneConfig(
    "exposure",
    image=ImageConfig(
        auto_exposure=True,
        exposure_drift=0.25,
        white_balance_drift=0.06,
        motion_blur_px=2.0,
        noise=0.012,
        jpeg_quality=80,
    ),
)

ALONG = Pass("right", "phase A", -2.5, 0.8, -1.2, 0.74, 40.0, -2.0, weave_m=0.0, heave_m=0.0)

PARALLEL = SceneConfig("parallel", capture=CaptureConfig(passes=(ALONG,), views_per_pass=48))

PARALLEL_TWO_PASSES = SceneConfig(
    "parallel-two-passes",
    capture=CaptureConfig(
        passes=(ALONG, Pass("left", "phase B", 2.8, 3.0, 1.2, -0.8, 32.0, -16.0, weave_m=0.0, heave_m=0.0)),
        views_per_pass=32,
    ),
)

SAME_WAY = SceneConfig(
    "same-way",
    capture=CaptureConfig(
        passes=(
            Pass("right", "phase A", -2.5, 0.8, -1.2, 0.74, 28.0, -4.0),
            Pass("left", "phase B", 2.4, 1.0, -1.2, 0.74, -28.0, -2.0),
            Pass("above", "shield", 0.0, 1.6, -1.2, 0.74, 0.0, -12.0),
        )
    ),
)
"""All passes look the way out, and neighbours by 28 degrees apart: each shares features with the next."""

BOTH_ENDS = SceneConfig(
    "both-ends",
    capture=CaptureConfig(
        passes=(
            Pass("right", "phase A", -2.5, 0.8, -1.75, 0.74, 28.0, -4.0),
            Pass("left", "phase B", 2.4, 1.0, -1.75, 0.74, -28.0, -2.0),
            Pass("above", "shield", 0.0, 1.6, -1.75, 0.74, 0.0, -12.0),
        )
    ),
)
"""`SAME_WAY` from 15 m before the first structure on, so that both structures lie ahead of some cameras."""

NOISY_POSES = SceneConfig("noisy-poses", capture=CaptureConfig(pose_noise_m=0.02, pose_noise_deg=0.1))

WHY: Mapping[str, str] = MappingProxyType({
    "span": "the span that comes with the package: four wires, 4 to 10 px wide, seen from three sides",
    "double-circuit": "many wires behind one another, on the figures of a real 335 m span; 1 to 3 px wide",
    "distribution": "thin wires on wooden poles before a street with houses",
    "forest": "vegetation around and 2 to 4 m below the wires, which is what a survey must find",
    "hills": "a steep slope: the lowest point of the curves lies outside the span",
    "bundle": "twin conductors 0.4 m apart with spacers, to be told apart",
    "far": "wires 1 to 2 px wide, filmed from 9 to 19 m",
    "exposure": "a camera's automatic: brightness and colours drift, and it blurs and is noisy",
    "parallel": "one pass along the wires, whose depth it cannot see: what no method can measure",
    "parallel-two-passes": "a second pass at another side and height gives the first the depth it lacks",
    "same-way": "`span` in passes that all look the way out, so that structure from motion joins them",
    "both-ends": "`same-way` begun 15 m before the first structure, so that images show both structures",
    "noisy-poses": "camera poses off by 2 cm and 0.1 degrees, as satellite positioning leaves them",
    **line_scenes.WHY,
})

SCENES: Mapping[str, SceneConfig] = MappingProxyType({
    scene.name: scene
    for scene in (
        SPAN, DOUBLE_CIRCUIT, DISTRIBUTION, FOREST, HILLS, BUNDLE, FAR,
        EXPOSURE, PARALLEL, PARALLEL_TWO_PASSES, SAME_WAY, BOTH_ENDS, NOISY_POSES,
        *line_scenes.LINE_SCENES.values(),
    )
})  # fmt: skip
