"""Scenes of lines with several spans, as plain values: each is there for one reason, stated in `WHY`."""

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

from plnerf.synth.config import PlantsConfig, SceneConfig, SpanConfig, TerrainConfig
from plnerf.synth.flight_config import CaptureConfig, Grid, Orbit, Pass
from plnerf.synth.line_config import LineConfig, StructureConfig, SupportConfig, WireConfig

_OPEN = TerrainConfig(track="none", fine_m=(66.0, 44.0), texel_m=0.04)
"""Open ground, fine enough around several spans."""

THREE_SPANS = SceneConfig(
    "three-spans",
    SpanConfig(
        seed=71,
        span_length_m=38.0,
        line_azimuth_deg=12.0,
        wires=tuple(replace(wire, sag_m=0.95 * wire.sag_m) for wire in SpanConfig().wires),
        terrain=_OPEN,
        plants=PlantsConfig(trees=14, bushes=30, background=170, trees_across_m=(13.0, 22.0), reach_m=60.0),
        before_m=(34.0,),
        after_m=(40.0,),
        structures=(
            StructureConfig("suspension"),
            StructureConfig("strain", 20.0),
            StructureConfig("suspension"),
            StructureConfig("terminal"),
        ),
        slack=((1.1,), (1.0,), (0.9, 0.95, 1.0, 0.85)),
    ),
    CaptureConfig(
        passes=(
            Pass("right", "phase A", -2.8, 0.9, -1.0, 0.96, 40.0, -3.0, zigzag_m=0.5),
            Pass("left", "phase B", 2.8, 1.1, 0.96, -1.0, 38.0, 2.0, zigzag_m=0.5),
            Pass("above", "phase A", -0.6, 5.0, -1.0, 0.96, 26.0, -22.0, zigzag_m=0.5),
        ),
        views_per_pass=56,
        filmed_m=(-53.0, 61.0),
        seen_px=1.0,
    ),
)

CROSSING = SceneConfig(
    "crossing",
    SpanConfig(
        seed=73,
        line_azimuth_deg=-8.0,
        terrain=_OPEN,
        plants=PlantsConfig(trees=10, bushes=24, background=170, trees_across_m=(24.0, 40.0)),
        others=(
            LineConfig(
                (
                    WireConfig("phase A", "phase", -1.1, 6.3, 0.55, 0.0143, insulator="pin"),
                    WireConfig("phase B", "phase", 0.35, 6.3, 0.55, 0.0143, insulator="pin"),
                    WireConfig("phase C", "phase", 1.1, 6.3, 0.55, 0.0143, insulator="pin"),
                ),
                SupportConfig("pole", height_m=6.5, foot_m=0.30, waist_m=0.2),
                azimuth_deg=52.0,
                lengths_m=(36.0, 40.0, 36.0),
                name="low",
                main=1,
                middle_m=(2.0, 1.0),
            ),
        ),
    ),
    CaptureConfig(
        passes=(
            Pass("right", "phase A", -2.6, 0.7, -1.2, 0.8, 40.0, -9.0, zigzag_m=0.5),
            Pass("left", "phase B", 2.6, 0.9, 1.2, -0.8, 38.0, -7.0, zigzag_m=0.5),
            Pass("above", "phase A", -0.6, 4.5, -1.2, 0.8, 27.0, -24.0, zigzag_m=0.5),
            Pass("low", "phase A", -3.0, -1.6, 0.8, -0.9, 50.0, -14.0, zigzag_m=0.5),
        ),
        views_per_pass=24,
        seen_px=1.0,
    ),
)

ORBIT = SceneConfig(
    "orbit",
    SpanConfig(
        seed=79,
        span_length_m=42.0,
        line_azimuth_deg=33.0,
        terrain=_OPEN,
        plants=PlantsConfig(trees=10, bushes=24, background=170, trees_across_m=(24.0, 40.0)),
        before_m=(45.0,),
        after_m=(40.0,),
        slack=((0.9,), (1.0,), (1.1,)),
    ),
    CaptureConfig(
        passes=(
            Orbit("low", 1, 11.0, 10.0, 12.0, 20.0, 360.0, 10.5),
            Orbit("high", 1, 12.0, 15.0, 17.0, 200.0, 360.0, 10.0),
            Orbit("climb", 1, 9.5, 6.0, 17.0, 95.0, 40.0, 10.5),
        ),
        views_per_pass=32,
        filmed_m=(-46.0, 4.0),
        seen_px=1.0,
    ),
)

GRID = SceneConfig(
    "grid",
    SpanConfig(
        seed=83,
        line_azimuth_deg=21.0,
        terrain=_OPEN,
        plants=PlantsConfig(trees=10, bushes=30, background=170, trees_across_m=(10.0, 20.0)),
        before_m=(44.0,),
        after_m=(44.0,),
    ),
    CaptureConfig(
        passes=(
            Grid("along", (-23.0, 23.0), 4.5, 5, 21.0),
            Grid("across", (-21.0, 21.0), 4.5, 9, 22.0, 8.0, crosses=True),
        ),
        focal_px=500.0,
        views_per_pass=60,
        filmed_m=(-26.0, 26.0),
        seen_px=1.0,
    ),
)

WIND = SceneConfig(
    "wind",
    SpanConfig(
        seed=89,
        wires=tuple(
            replace(wire, swing_deg=15.0 if wire.kind == "shield" else 12.0) for wire in SpanConfig().wires
        ),
    ),
)

LONG = SceneConfig(
    "long",
    SpanConfig(
        seed=97,
        span_length_m=40.0,
        line_azimuth_deg=-4.0,
        terrain=replace(_OPEN, fine_m=(138.0, 60.0), texel_m=0.06),
        plants=PlantsConfig(trees=40, bushes=80, background=240, trees_across_m=(13.0, 24.0), reach_m=120.0),
        before_m=(38.0, 42.0, 36.0),
        after_m=(44.0, 40.0, 38.0, 42.0),
        structures=(
            StructureConfig(),
            StructureConfig("strain", 25.0),
            StructureConfig(),
            StructureConfig(),
            StructureConfig(),
            StructureConfig(),
            StructureConfig("strain", -18.0),
            StructureConfig(),
            StructureConfig("terminal"),
        ),
        slack=((1.0,), (1.1,), (0.9,), (1.0,), (1.05,), (0.95,), (1.0,), (1.1,)),
    ),
    CaptureConfig(
        passes=(
            Pass("right", "phase A", -2.8, 0.9, -1.0, 0.98, 40.0, -3.0, zigzag_m=0.5),
            Pass("left", "phase B", 2.8, 1.1, 0.98, -1.0, 38.0, 2.0, zigzag_m=0.5),
            Pass("above", "phase A", -0.6, 5.0, -1.0, 0.98, 26.0, -22.0, zigzag_m=0.5),
        ),
        views_per_pass=168,
        filmed_m=(-136.0, 184.0),
        seen_px=1.0,
    ),
)

WHY: Mapping[str, str] = MappingProxyType({
    "three-spans": "a line that bends by 20 degrees and ends: structures shared by spans, and a terminal",
    "crossing": "a second, lower line at an angle of 60 degrees: wires in another direction, on poles",
    "orbit": "flights around a tower, whose wires go on to both sides",
    "grid": "rows from above, looking down: wires before nothing but the ground",
    "wind": "wires swung by 12 and 15 degrees",
    "long": "eight spans with two bends: whether time and memory stay those of one span",
})

LINE_SCENES: Mapping[str, SceneConfig] = MappingProxyType({
    scene.name: scene for scene in (THREE_SPANS, CROSSING, ORBIT, GRID, WIND, LONG)
})
