"""Where wires are hung in a captured scene: drawn places and directions, judged by what the photos show."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from plnerf.errors import SceneError
from plnerf.line.hang import hang
from plnerf.line.wire import Wire
from plnerf.synth.hang_config import ChooseConfig, DrawConfig, Material
from plnerf.synth.hang_depth import Depth
from plnerf.synth.hang_sights import Sights, sights
from plnerf.synth.hang_views import PhotoView

MIDDLE = (0.15, 0.85)
"""Candidates go through this part of a photo's width and height."""
BEYOND = (0.04, 0.15)
"""Wires end so far beyond what the photos show of them, as a share of that length."""
TOO_NEAR = 0.4
"""No photo may have a wire nearer than this share of its typical depth: it would be a beam."""
SLOPE = 0.02
"""Greatest difference of the two ends' heights, as a share of the span."""
MATERIALS: tuple[Material, ...] = ("aluminium", "weathered", "copper")
WIDE_QUANTILE = 0.9
"""Of a wire's widths: what the nearest tenth has at least."""


@dataclass(frozen=True, eq=False)
class HungWire:
    """A wire, and what it is made of."""

    wire: Wire
    group: int
    material: Material


@dataclass(frozen=True, eq=False)
class _Candidate:
    a: Float[np.ndarray, "3"]
    b: Float[np.ndarray, "3"]
    sag: float
    turn: float
    """Of its horizontal direction, from x towards y, in [0, pi)."""
    observable: float
    """Length of what photos fix."""


@dataclass(frozen=True)
class Place:
    """What all draws need: the photos, their depths, and the settings."""

    views: Sequence[PhotoView]
    depths: Sequence[Depth]
    choose: ChooseConfig
    draw: DrawConfig

    @property
    def typical(self) -> float:
        """Median of the photos' typical depths."""
        return float(np.median([depth.typical for depth in self.depths]))

    def sights(self, points: Float[np.ndarray, "n 3"]) -> Sights:
        """How the photos show a curve."""
        return sights(points, self.views, self.depths, self.draw.behind)


def choose_wires(place: Place, random: np.random.Generator) -> list[HungWire]:
    """Groups of wires whose places the photos fix.

    Raises SceneError where no place is found that enough photos show from two sides.
    """
    found: list[HungWire] = []
    taken: list[float] = []
    for group in range(place.choose.groups):
        azimuth = place.choose.azimuth_deg if group == 0 else None
        drawn = [_candidate(place, random, azimuth, taken) for _ in range(place.choose.candidates)]
        usable = [one for one in drawn if one is not None and one.observable > 0]
        if not usable:
            continue
        best = max(one.observable for one in usable)
        good = [one for one in usable if one.observable >= place.choose.good_share * best]
        first = good[int(random.integers(len(good)))]
        taken.append(first.turn)
        found += _group(place, first, group + 1, random)
    if not found:
        choose = place.choose
        raise SceneError(
            f"In {len(place.views)} photos no wire at {choose.depth[0]:.0%} to {choose.depth[1]:.0%} of the "
            f"scene's depth would be seen in {choose.least_images} of them from sides that differ by "
            f"{choose.least_angle_deg:g} degrees. Take photos from more than one track, or allow other "
            "depths, fewer images or a smaller angle."
        )
    return found


def _candidate(
    place: Place, random: np.random.Generator, azimuth_deg: float | None, taken: Sequence[float]
) -> _Candidate | None:
    """A wire through a drawn pixel's ray, as long as photos show it; None where it cannot hang there."""
    choose = place.choose
    k = int(random.integers(len(place.views)))
    view, depth = place.views[k], place.depths[k]
    pixel = random.uniform(*MIDDLE, (1, 2)) * (view.width, view.height)
    plane = view.plane(pixel)
    z = random.uniform(*choose.depth) * min(float(depth.at(plane)[0]), depth.typical)
    x = np.append(plane[0], 1.0) * z @ view.R_world_camera.T + view.centre
    turn = random.uniform(0, np.pi) if azimuth_deg is None else np.radians(90.0 - azimuth_deg) % np.pi
    sag_share, slope, beyond = (
        random.uniform(*choose.sag),
        random.uniform(-SLOPE, SLOPE),
        random.uniform(*BEYOND),
    )
    turned = [abs((turn - other + np.pi / 2) % np.pi - np.pi / 2) for other in taken]
    if turned and min(turned) < np.radians(choose.turned_deg):
        return None
    u = np.array([np.cos(turn), np.sin(turn), 0.0])
    spread = float(np.ptp(np.array([one.centre for one in place.views]) @ u))
    reach = 3 * place.typical + spread
    s = np.linspace(-reach, reach, 4 * choose.stations)
    shown = place.sights(x + s[:, None] * u).seen.any(0)
    if not shown.any():
        return None
    low, high = float(s[shown].min()), float(s[shown].max())
    low, high = min(low, 0.0), max(high, 0.0)
    more = beyond * (high - low)
    low, high = low - more, high + more
    length, share = high - low, -low / (high - low)
    rise = sag_share * length * 4 * share * (1 - share)
    a, b = x + low * u, x + high * u
    a[2] += rise - slope * length * share
    b[2] += rise + slope * length * (1 - share)
    return _judged(place, a, b, sag_share * length, float(turn))


def _judged(
    place: Place, a: Float[np.ndarray, "3"], b: Float[np.ndarray, "3"], sag: float, turn: float
) -> _Candidate | None:
    if np.linalg.norm((b - a)[:2]) < 0.2 * place.typical:
        return None
    wire = hang(a, b, sag)
    seen = place.sights(wire.points(np.linspace(0, wire.base.length_m, place.choose.stations)))
    if not seen.inside.any() or np.nanmin(seen.ratio) < TOO_NEAR:
        return None
    length = float(_good(seen, place.choose).mean() * wire.length_m)
    return _Candidate(a, b, sag, turn, length)


def _good(seen: Sights, choose: ChooseConfig) -> Bool[np.ndarray, " n"]:
    """Stations whose place photos fix, at the depths that are asked for in half of those photos."""
    good = seen.observable(choose.least_images, choose.least_angle_deg)
    at = np.flatnonzero(good)
    middle = np.nanmedian(np.where(seen.seen, seen.ratio, np.nan)[:, at], 0)
    good[at] = (middle >= choose.depth[0]) & (middle <= choose.depth[1])
    return good


def _group(place: Place, first: _Candidate, group: int, random: np.random.Generator) -> list[HungWire]:
    """The first wire and its neighbours on both sides, each with its own gauge and nearly the same sag."""
    choose = place.choose
    count = int(random.integers(choose.wires[0], choose.wires[1] + 1))
    material = place.draw.material or MATERIALS[int(random.integers(len(MATERIALS)))]
    n = np.array([-np.sin(first.turn), np.cos(first.turn), 0.0])
    lean = random.uniform(-np.pi / 3, np.pi / 3)
    side = (np.cos(lean) * n + np.sin(lean) * np.array([0.0, 0.0, 1.0])) * place.typical
    found: list[HungWire] = []
    at = 0.0
    for rank in range(count):
        # To both sides in turn: 0, 1, -1, 2, ...
        step = random.uniform(*choose.spacing)
        offset = 0.0 if rank == 0 else (at + step if rank % 2 else -at)
        at = at + step if rank % 2 else at
        sag = first.sag * (1.0 if rank == 0 else random.uniform(0.92, 1.08))
        low, high = np.log(choose.width_px)
        width_px = float(np.exp(random.uniform(low, high)))
        one = _judged(place, first.a + offset * side, first.b + offset * side, sag, first.turn)
        if one is None or one.observable < choose.kept_share * first.observable:
            continue
        wire = hang(one.a, one.b, sag)
        seen = place.sights(wire.points(np.linspace(0, wire.base.length_m, choose.stations)))
        use = seen.seen & _good(seen, choose)
        diameter = width_px / float(np.quantile(seen.px_per_unit[use], WIDE_QUANTILE))
        name = f"hung {group}.{len(found) + 1}"
        found.append(HungWire(hang(one.a, one.b, sag, diameter_m=diameter, name=name), group, material))
    return found
