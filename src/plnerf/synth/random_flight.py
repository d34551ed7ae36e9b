"""Flights drawn at random: passes beside and above, zigzag, oblique corridor, orbits, grid, climb.

A drawn flight can measure what it films: its lens makes the nearest phases about 2 to 3 px wide where they
are looked at, and it films no more of the line than its images overlap on.
"""

import math

import numpy as np

from plnerf.synth.config import SpanConfig
from plnerf.synth.flight_config import CaptureConfig, Grid, Leg, Orbit, Pass

IMAGES = 48
PATTERNS = ("sides", "two sides", "zigzag", "oblique", "orbit", "grid", "climb")
STRETCH_PER_DIAMETER = 800.0  # filmed length over the phases' diameter: one image shows 480 px / width
MOST_IMAGES = 120
BEYOND_SPAN = 1.08
"""So many times as far as to its structures is a whole span filmed where the line goes on."""
FOCAL_PX = (360.0, 1000.0)


def draw_capture(rng: np.random.Generator, span: SpanConfig, *, whole_span: bool = False) -> CaptureConfig:
    """A flight, its lens, and the errors of its poses.

    whole_span: from structure to structure, with more images; else what 48 images show of it.
    """
    thick = max(wire.diameter_m for wire in span.wires if wire.kind == "phase")
    filmed = _whole(span) if whole_span else _filmed(rng, span, thick)
    pattern = str(rng.choice([one for one in PATTERNS if not (whole_span and one == "orbit")]))
    legs, away_m = _Flights(rng, span).draw(pattern, filmed)
    wide_px = rng.uniform(1.6, 2.0) if pattern == "grid" else rng.uniform(2.2, 3.4)
    focal = float(np.clip(wide_px * away_m / thick, *FOCAL_PX))
    poses_off = rng.random() < 0.35
    return CaptureConfig(
        focal_px=focal,
        passes=legs,
        views_per_pass=_images(filmed, thick) // len(legs),
        filmed_m=filmed,
        pose_noise_m=float(rng.uniform(0.0, 0.02)) if poses_off else 0.0,
        pose_noise_deg=float(rng.uniform(0.0, 0.06)) if poses_off else 0.0,
        seen_px=1.0,
    )


def _whole(span: SpanConfig) -> tuple[float, float]:
    """The main span, and a little of the next ones if the line goes on there."""
    half = span.span_length_m / 2
    before, after = (BEYOND_SPAN if beyond else 0.98 for beyond in (span.before_m, span.after_m))
    return -before * half, after * half


def _images(filmed_m: tuple[float, float], thick_m: float) -> int:
    """So many that a metre of a longer stretch is seen as often."""
    stretches = (filmed_m[1] - filmed_m[0]) / (STRETCH_PER_DIAMETER * thick_m)
    return min(round(IMAGES * max(stretches, 1.0)), MOST_IMAGES)


def _filmed(rng: np.random.Generator, span: SpanConfig, thick_m: float) -> tuple[float, float]:
    """A stretch around the main span's middle, or around one of its structures if the line goes on there."""
    half = span.span_length_m / 2
    length = min(2 * half * rng.uniform(0.85, 1.2), STRETCH_PER_DIAMETER * thick_m)
    low, high = (-1.3 * half if span.before_m else -0.98 * half, 1.3 * half if span.after_m else 0.98 * half)
    length = min(length, high - low)
    middle = half * float(rng.choice([-1.0, 0.0, 1.0])) * rng.uniform(0.6, 1.0)
    start = float(np.clip(middle - length / 2, low, high - length))
    return start, start + float(length)


class _Flights:
    """The patterns for one line; each draw gives legs, and how far away the phases are that they look at."""

    def __init__(self, rng: np.random.Generator, span: SpanConfig) -> None:
        self.rng, self.tall = rng, span.support.height_m
        self.right = min(span.wires, key=lambda wire: wire.across_m)
        self.left = max(span.wires, key=lambda wire: wire.across_m)
        self.top = max(span.wires, key=lambda wire: wire.height_m)
        self.clear = self.tall - self.top.height_m + max(one.raised_m for one in span.structures)
        self.drop = self.top.height_m - min(self.right.height_m, self.left.height_m)
        self.about = len(span.before_m) + int(rng.integers(2))
        self.near = (1.6, 2.4) if span.support.kind == "pole" else (2.0, 3.2)

    def draw(self, pattern: str, filmed_m: tuple[float, float]) -> tuple[tuple[Leg, ...], float]:
        """One of PATTERNS over the filmed stretch."""
        match pattern:
            case "sides" | "two sides":
                return self._sides(over=pattern == "sides")
            case "zigzag":
                return self._zigzag()
            case "oblique":
                return self._oblique()
            case "orbit":
                return self._orbit()
            case "grid":
                return self._grid(filmed_m)
        legs, away = self._sides(over=False)
        radius, bearing = self._value(8.0, 10.0), self._value(0.0, 360.0)
        climb = Orbit(
            "climb",
            self.about,
            radius,
            4.0,
            self.tall + 4.0,
            bearing,
            self._value(20.0, 70.0),
            0.85 * self.tall,
        )
        return (climb, *legs), away

    def _value(self, low: float, high: float) -> float:
        return float(self.rng.uniform(low, high))

    def _beside(self, name: str, far_m: float, above_m: float, toward_deg: float, pitch_deg: float) -> Pass:
        """Forth on the right or back on the left, so that the line is always on the camera's left."""
        wire, sign = (self.right, -1.0) if name == "right" else (self.left, 1.0)
        return Pass(
            name, wire.name, sign * far_m, above_m, sign, -sign, toward_deg, pitch_deg,
            zigzag_m=self._value(0.5, 1.0),
        )  # fmt: skip

    def _sides(self, *, over: bool) -> tuple[tuple[Leg, ...], float]:
        far = self._value(*self.near)
        legs = [
            self._beside(
                name, far * self._value(0.9, 1.2), self._value(0.0, 1.6), self._value(18.0, 32.0),
                self._value(-9.0, 1.0),
            )
            for name in ("right", "left")
        ]  # fmt: skip
        if over:
            legs.append(
                Pass(
                    "above", self.right.name, self._value(-1.0, 0.5),
                    self.top.height_m - self.right.height_m + self.clear + self._value(1.6, 2.4), -1.0, 1.0,
                    self._value(5.0, 25.0), self._value(-36.0, -24.0), zigzag_m=self._value(0.2, 1.0),
                )
            )  # fmt: skip
        return tuple(legs), 3.0 * far

    def _zigzag(self) -> tuple[tuple[Leg, ...], float]:
        up, wide, period = self.clear + self._value(1.8, 3.0), self._value(1.5, 3.0), self._value(9.0, 16.0)
        legs = tuple(
            Pass(
                name, self.top.name, 0.0, up + more, start, -start, self._value(-15.0, 15.0),
                self._value(-46.0, -32.0), zigzag_m=sign * wide, zigzag_period_m=period,
            )
            for name, start, sign, more in (("forth", -1.0, 1.0, 0.0), ("back", 1.0, -1.0, 0.8))
        )  # fmt: skip
        return legs, 1.6 * (up + self.drop)

    def _oblique(self) -> tuple[tuple[Leg, ...], float]:
        far, above = self._value(4.5, 7.0), self._value(1.5, 4.0)
        legs = tuple(
            self._beside(
                name, far, above * self._value(0.8, 1.2), self._value(50.0, 72.0),
                -math.degrees(math.atan2(above, far)) + self._value(-6.0, 4.0),
            )
            for name in ("right", "left")
        )  # fmt: skip
        return legs, 1.15 * math.hypot(far, above)

    def _orbit(self) -> tuple[tuple[Leg, ...], float]:
        radius, bearing = self._value(7.5, 10.0), self._value(0.0, 360.0)
        low = Orbit(
            "low", self.about, radius, 0.7 * self.tall, 0.95 * self.tall, bearing, 360.0, 0.85 * self.tall
        )
        high = Orbit(
            "high", self.about, radius + self._value(0.0, 1.5), self.tall + 1.0, self.tall + 3.5,
            bearing + 90.0, -360.0, 0.8 * self.tall,
        )  # fmt: skip
        return (low, high), 0.9 * radius

    def _grid(self, filmed_m: tuple[float, float]) -> tuple[tuple[Leg, ...], float]:
        """Rows along the line within sight of its wires, and rows across it."""
        up = self.clear + self._value(3.5, 5.0)
        wide = 0.5 * self.left.across_m + self._value(1.5, 2.5)
        height = self.top.height_m + up
        legs = (
            Grid("along", filmed_m, wide, 3, height),
            Grid("across", filmed_m, wide, int(self.rng.integers(5, 8)), height + 0.8, self._value(0.0, 10.0),
                 crosses=True),
        )  # fmt: skip
        return legs, up + 1.1 * self.drop
