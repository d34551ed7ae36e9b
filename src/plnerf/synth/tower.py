"""A lattice tower's steel, its insulator strings and its clamps, as meshes.

Tower axes: x along the line, y across it (left positive), z above the foot, metres; `to_world` turns and
moves them onto the ground.
"""

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from plnerf.synth.config import SpanConfig, WireConfig
from plnerf.synth.meshes import Mesh, angle_bar, beam, join, lathe, tube, up
from plnerf.synth.span import Span, Tower

Points = Float[np.ndarray, "n 3"]
FACES = ((1, 1), (-1, 1), (-1, -1), (1, -1))  # signs of the four legs' x and y, in order around the body


def steel(span: Span, tower: Tower) -> Mesh:
    """Legs, bracing, cross-arms and peak."""
    config = span.config
    parts = [*_body(config), *_arms(config)]
    return to_world(span, tower, join(parts))


def footings(span: Span, tower: Tower) -> Mesh:
    """Four concrete blocks; they reach into the ground so that none floats on a slope."""
    blocks = []
    for sx, sy in FACES:
        w = _half_width(span.config, 0.0)
        centre = np.array([sx * w, sy * w, 0.0])
        corner = np.array([0.25, 0.0, 0.0])
        low, high = centre + np.array([0, -0.25, -1.2]), centre + np.array([0, -0.25, 0.45])
        blocks.append(beam(low - corner, high - corner, np.array([1.0, 0, 0]), 0.5, 0.5))
    return to_world(span, tower, join(blocks))


def insulators(span: Span, tower: Tower) -> tuple[Mesh, Mesh]:
    """The discs of all strings, and the metal: rods, suspension clamps and vibration dampers."""
    config, length = span.config, span.config.support.string_length_m
    discs: list[Mesh] = []
    metal: list[Mesh] = []
    sign = 1.0 if tower == span.towers[0] else -1.0  # the span lies ahead of the first tower
    for i, clamp in enumerate(tower.attachments):
        conductor = span.conductors[i]
        bottom = np.array(clamp)
        if config.wire(conductor.wire).insulator == "string":
            top = bottom + up(length)
            count = max(2, round((length - 0.25) / 0.115))
            heights = np.linspace(0.17, length - 0.12, count)
            discs += [lathe(_disc_profile(), bottom + up(z)) for z in heights]
            metal.append(tube(np.linspace(bottom, top, 3), 0.012, 8))
        metal += _clamp(conductor.curve.points, conductor.curve.span_m, conductor.diameter_m, sign)
    return join(discs), join(metal)


def to_world(span: Span, tower: Tower, mesh: Mesh) -> Mesh:
    """Tower axes to the world frame."""
    ux, uy = span.along
    turn = np.array([[ux, -uy, 0.0], [uy, ux, 0.0], [0.0, 0.0, 1.0]])
    return Mesh(mesh.vertices @ turn.T + np.array(tower.foot), mesh.faces, mesh.uv, mesh.colour, mesh.smooth)


def _strung(config: SpanConfig) -> list[WireConfig]:
    return [wire for wire in config.wires if wire.insulator == "string"]


def _arm_heights(config: SpanConfig) -> list[float]:
    return sorted({wire.height_m + config.support.string_length_m for wire in _strung(config)})


def _half_width(config: SpanConfig, z: float) -> float:
    """Half the body's width at height z: a wide foot, a slim waist from the lowest arm up, a pointed peak."""
    arms = _arm_heights(config)
    shoulder = min(arms[-1] + 0.75, config.support.height_m - 0.3)
    return float(np.interp(z, [0.0, arms[0], shoulder, config.support.height_m], [1.15, 0.36, 0.30, 0.03]))


def _body(config: SpanConfig) -> list[Mesh]:
    arms = _arm_heights(config)
    levels = [0.0]
    while levels[-1] < arms[0]:  # square panels, so they shorten as the body tapers
        levels.append(levels[-1] + max(0.75, 1.75 * _half_width(config, levels[-1])))
    below = np.array(levels) * arms[0] / levels[-1]
    shoulder = min(arms[-1] + 0.75, config.support.height_m - 0.3)
    above = np.linspace(arms[0], shoulder, max(2, round((shoulder - arms[0]) / 0.75)) + 1)
    z = [*below, *above[1:]]
    parts: list[Mesh] = []

    def corner(face: int, height: float) -> np.ndarray:
        sx, sy = FACES[face % 4]
        w = _half_width(config, height)
        return np.array([sx * w, sy * w, height])

    for face in range(4):
        legs = [*z, config.support.height_m]
        parts += [
            angle_bar(corner(face, lo), corner(face, hi), corner(face, 0.0) * [1, 1, 0], 0.10)
            for lo, hi in pairwise(legs)
        ]
        outward = corner(face, 0.0) + corner(face + 1, 0.0)
        for i, (lo, hi) in enumerate(pairwise(z)):
            width = 0.06 if lo < arms[0] else 0.045
            parts.append(angle_bar(corner(face, lo), corner(face + 1, hi), outward, width))
            parts.append(angle_bar(corner(face + 1, lo), corner(face, hi), outward, width))
            if i % 2 == 1 or hi > arms[0] - 0.1:
                parts.append(angle_bar(corner(face, hi), corner(face + 1, hi), outward, width))
    return parts


def _arms(config: SpanConfig) -> list[Mesh]:
    parts: list[Mesh] = []
    for wire in _strung(config):
        y, z = wire.across_m, wire.height_m + config.support.string_length_m
        side = math.copysign(1.0, y)
        rise = min(0.75, config.support.height_m - z)
        tip = np.array([0.0, y, z])
        for sx in (1, -1):
            w = _half_width(config, z)
            top_w = _half_width(config, z + rise)
            root = np.array([sx * w, side * w, z])
            high = np.array([sx * top_w, side * top_w, z + rise])
            outward = np.array([float(sx), 0.0, 0.0])
            parts.append(angle_bar(root, tip, outward - up(1.0), 0.07))
            parts.append(angle_bar(high, tip, outward + up(1.0), 0.06))
            stations = np.linspace(0.0, 1.0, 4)
            lower, upper = root + stations[:, None] * (tip - root), high + stations[:, None] * (tip - high)
            for i in range(3):
                if i:
                    parts.append(angle_bar(lower[i], upper[i], outward, 0.04))
                parts.append(angle_bar(lower[i + 1], upper[i], outward, 0.04))
                if sx > 0 and i:  # ties between the two chords, seen from below
                    parts.append(angle_bar(lower[i], lower[i] * [-1, 1, 1], np.array([0, 0, -1.0]), 0.04))
        parts.append(angle_bar(tip + up(0.05), tip - up(0.10), np.array([1.0, 0, 0]), 0.06))
    return parts


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
