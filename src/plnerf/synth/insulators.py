"""What carries the wires: insulators, with clamps, dampers, yokes, spacers and jumpers, as meshes.

World frame, metres.  Bodies of glazed porcelain and bodies of metal are kept apart.
"""

import math
from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from plnerf.line.wire import Wire
from plnerf.synth.line_config import WireConfig
from plnerf.synth.meshes import Mesh, beam, join, lathe, tube, up
from plnerf.synth.pole import pin_foot
from plnerf.synth.site import Line, Span, Tower, radius_m
from plnerf.synth.tower import arm_tip, vee_reach_m

Points = Float[np.ndarray, "n 3"]
JUMPER_DROP = 1.3  # of a jumper's loop below its ends, in lengths of a tension string


def insulators(line: Line, tower: Tower) -> tuple[Mesh | None, Mesh]:
    """The porcelain of a support (None if it has none), and the metal: rods, clamps, dampers, yokes, ties."""
    glazed: list[Mesh] = []
    metal: list[Mesh] = []
    sides = [(sign, [wires for _, wires in span.grouped]) for sign, span in line.beside(tower)]
    held = iter(tower.held)
    for i, wire in enumerate(tower.design.wires):
        clamps = [np.array(next(held)) for _ in range(wire.bundle)]
        discs, fittings = _carrier(tower, wire, clamps)
        glazed += discs
        metal += fittings
        for sign, groups in sides:
            for tip, conductor in zip(clamps, groups[i], strict=True):
                if wire.insulator == "tension":
                    discs, rod = _string(_end(conductor, sign), tip)
                    glazed += discs
                    metal.append(rod)
                if wire.insulator in ("pin", "spool"):
                    metal.append(_tie(conductor, sign))
                else:
                    metal += _clamp(conductor.points, conductor.base.length_m, wire.diameter_m, sign)
    return join(glazed) if glazed else None, join(metal)


def jumpers(line: Line, tower: Tower) -> Mesh | None:
    """Loops of conductor below the arms, from the tension strings of one span to those of the next."""
    sides = line.beside(tower)
    if len(sides) < 2 or not any(wire.insulator == "tension" for wire in tower.design.wires):
        return None
    loops = []
    groups = zip(tower.design.wires, *(span.grouped for _, span in sides), strict=True)
    for wire, (_, before), (_, after) in groups:
        if wire.insulator != "tension":
            continue
        for one, other in zip(before, after, strict=True):
            a, b = _end(one, -1.0), _end(other, 1.0)
            t = np.linspace(0.0, 1.0, 25)[:, None]
            drop = 4 * t * (1 - t) * JUMPER_DROP * tower.design.support.string_length_m
            loops.append(tube((1 - t) * a + t * b - drop * up(1.0), radius_m(one), 10))
    return join(loops)


def _end(wire: Wire, sign: float) -> Float[np.ndarray, "3"]:
    """Where a wire begins (1) or ends (-1)."""
    return wire.points(np.array([0.0 if sign > 0 else wire.base.length_m]))[0]


def _carrier(tower: Tower, wire: WireConfig, ends: list[np.ndarray]) -> tuple[list[Mesh], list[Mesh]]:
    """Insulators of one wire, from the support to the middle of its clamps, and a bundle's yoke."""
    if wire.insulator == "tension":
        return [], []
    length = tower.design.support.string_length_m
    bottom = ends[0] if len(ends) == 1 else np.mean(ends, axis=0) + up(0.16)
    left = tower.axes[:, 1]
    yoke = [] if len(ends) == 1 else _yoke(ends, bottom)
    if wire.insulator == "string":
        top = ends[0] + up(length) if len(ends) == 1 else np.mean(ends, axis=0) + up(length)
        discs, rod = _string(bottom, top)
        return discs, [*yoke, rod]
    if wire.insulator == "vee":
        middle = np.mean(ends, axis=0)
        reach = vee_reach_m(tower.design) * math.copysign(1.0, wire.across_m)
        # The inner string ends at the body, which may stand closer than the arm's tip reaches out.
        inner = max(-abs(reach), -abs(wire.across_m) + 0.6 * tower.design.support.waist_m / 2)
        meshes = [_string(bottom, middle + up(length) + left * at)
                  for at in (reach, math.copysign(inner, reach) * -1.0)]  # fmt: skip
        return [disc for discs, _ in meshes for disc in discs], [*yoke, *(rod for _, rod in meshes)]
    if wire.insulator == "pin":
        foot = pin_foot(tower, wire.across_m)
        rod = tube(np.array([foot - up(0.16), foot + up(0.12)]), 0.011, 8)
        return [lathe(_pin_profile(float(bottom[2] - foot[2])), foot)], [rod]
    if wire.insulator == "spool":
        pole = np.array([tower.foot[0], tower.foot[1], bottom[2]])
        bracket = tube(np.array([pole, bottom + 0.04 * (bottom - pole)]), 0.012, 8)
        pin = tube(np.array([bottom - up(0.08), bottom + up(0.08)]), 0.009, 8)
        return [lathe(_spool_profile(), bottom)], [bracket, pin]
    tip = arm_tip(tower.design, wire)
    if tip is None:
        return [], yoke
    hung = np.array([bottom, bottom + up(tip[1] - wire.height_m)])
    return [], [*yoke, tube(hung, 0.016, 8)]


def spacers(spans: Sequence[Span]) -> Mesh | None:
    """Rigid spacers between neighbours of a bundle, evenly spaced along each span; None without bundles."""
    meshes: list[Mesh] = []
    for line, config, wires in ((one.line, *group) for one in spans for group in one.grouped):
        if len(wires) < 2:
            continue
        length = wires[0].base.length_m
        fields = max(1, math.ceil(length / line.spacer_step_m))
        for s in (np.arange(fields) + 0.5) * length / fields:
            at = [wire.points(np.array([s]))[0] for wire in wires]
            ahead = wires[0].points(np.array([s + 0.05]))[0] - at[0]
            ahead /= np.linalg.norm(ahead)
            thick = config.diameter_m / 2
            for a, b in pairwise(at):
                meshes.append(tube(np.linspace(a, b, 5), np.array([0.012, 0.014, 0.019, 0.014, 0.012]), 10))
            for point in at:
                grip = np.linspace(point - 0.05 * ahead, point + 0.05 * ahead, 5)
                meshes.append(tube(grip, thick + np.array([0.002, 0.012, 0.016, 0.012, 0.002]), 12))
    return join(meshes) if meshes else None


def _string(bottom: Float[np.ndarray, "3"], top: Float[np.ndarray, "3"]) -> tuple[list[Mesh], Mesh]:
    """Discs on a rod from the clamp up to where it is hung, upright or leaning."""
    length = round(float(np.linalg.norm(top - bottom)), 9)
    axis = (top - bottom) / length
    spacing = 0.115 if length < 1.5 else 0.155
    count = max(2, round((length - 0.25) / spacing))
    heights = np.linspace(0.17, length - 0.12, count)
    discs = [lathe(_disc_profile(), bottom + up(z)) for z in heights]
    if abs(axis[2]) < 1 - 1e-9:
        side = np.cross(axis, [0.0, 0.0, 1.0])
        side /= np.linalg.norm(side)
        turn = np.stack([side, np.cross(axis, side), axis], axis=1)
        discs = [Mesh((disc.vertices - bottom) @ turn.T + bottom, disc.faces) for disc in discs]
    return discs, tube(np.linspace(bottom, top, 3), 0.012, 8)


def _yoke(ends: list[np.ndarray], bottom: Float[np.ndarray, "3"]) -> list[Mesh]:
    """A triangle of bars from the string's end to the sub-conductors' clamps."""
    bars = [tube(np.array([bottom, end]), 0.018, 8) for end in ends]
    return [*bars, tube(np.array([ends[0] + up(0.03), ends[-1] + up(0.03)]), 0.018, 8)]


def _tie(wire: Wire, sign: float) -> Mesh:
    """Thin wire wound around the conductor and the insulator's groove."""
    end = 0.0 if sign > 0 else wire.base.length_m
    points = wire.points(end + sign * np.linspace(0.0, 0.16, 5))
    thick = radius_m(wire)
    return tube(points, thick + np.array([0.006, 0.005, 0.005, 0.004, 0.001]), 10)


def _pin_profile(high_m: float) -> Float[np.ndarray, "n 2"]:
    """A porcelain pin insulator: two bells below a grooved head, whose groove holds the wire."""
    profile = np.array([
        [0.030, 0.30],
        [0.045, 0.28],
        [0.095, 0.28],
        [0.100, 0.34],
        [0.070, 0.50],
        [0.060, 0.56],
        [0.080, 0.58],
        [0.085, 0.64],
        [0.055, 0.84],
        [0.038, 0.92],
        [0.034, 0.97],
        [0.046, 1.03],
        [0.040, 1.10],
        [0.002, 1.13],
    ])
    return profile * [1.0, high_m]


def _spool_profile() -> Float[np.ndarray, "n 2"]:
    """A spool with a groove at half its height."""
    return np.array([
        [0.002, -0.055], [0.042, -0.052], [0.046, -0.035], [0.026, -0.012], [0.024, 0.0],
        [0.026, 0.012], [0.046, 0.035], [0.042, 0.052], [0.002, 0.055],
    ])  # fmt: skip


def _disc_profile() -> Float[np.ndarray, "n 2"]:
    """A cap-and-pin disc of 25 cm: pin, ribbed underside, bell and cap."""
    return np.array([
        [0.012, -0.030],
        [0.050, -0.026],
        [0.055, -0.014],
        [0.085, -0.020],
        [0.090, -0.010],
        [0.122, -0.016],
        [0.127, -0.008],
        [0.110, 0.012],
        [0.070, 0.030],
        [0.040, 0.042],
        [0.036, 0.075],
        [0.012, 0.080],
    ])


def _clamp(
    points: Callable[[np.ndarray], Points], span_m: float, diameter_m: float, sign: float
) -> list[Mesh]:
    """A boat-shaped clamp around the wire's end and a damper hung below it half a metre out."""
    end = 0.0 if sign > 0 else span_m

    def at(distance: float) -> np.ndarray:
        return points(np.array([end + sign * distance]))[0]

    boat = np.array([at(d) for d in np.linspace(0.0, 0.16, 5)])
    parts = [tube(boat, np.array([0.020, 0.030, 0.028, 0.024, diameter_m / 2 + 0.003]), 10)]
    middle = at(0.75) - up(diameter_m / 2 + 0.05)
    direction = (at(0.8) - at(0.7)) / np.linalg.norm(at(0.8) - at(0.7))
    parts.append(tube(np.array([middle - 0.2 * direction, middle, middle + 0.2 * direction]), 0.006, 8))
    for lo, hi in ((-0.24, -0.13), (0.13, 0.24)):
        ends = np.array([lo, lo + 0.001, hi - 0.001, hi])[:, None]
        parts.append(tube(middle + ends * direction, np.array([0.004, 0.026, 0.026, 0.004]), 10))
    parts.append(beam(middle - up(0.01), at(0.75), direction, 0.03, 0.02))
    return parts
