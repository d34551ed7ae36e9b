"""A lattice tower's steel and its footings, as meshes.

Tower axes: x along the line, y across it (left positive), z above the foot, metres; `to_world` turns and
moves them onto the ground.
"""

import math
from itertools import pairwise

import numpy as np

from plnerf.synth.line_config import LineConfig, WireConfig
from plnerf.synth.meshes import Mesh, angle_bar, beam, join, up
from plnerf.synth.site import Tower

FACES = ((1, 1), (-1, 1), (-1, -1), (1, -1))  # signs of the four legs' x and y, in order around the body


def steel(tower: Tower) -> Mesh:
    """Legs, bracing, cross-arms and peak."""
    return to_world(tower, join([*_body(tower.design), *_arms(tower.design)]))


def footings(tower: Tower) -> Mesh:
    """Four concrete blocks; they reach into the ground so that none floats on a slope."""
    blocks = []
    for sx, sy in FACES:
        w = half_width_m(tower.design, 0.0)
        centre = np.array([sx * w, sy * w, 0.0])
        wide = 0.5 * math.sqrt(_grown(tower.design))
        corner = np.array([wide / 2, 0.0, 0.0])
        low, high = centre + np.array([0, -wide / 2, -1.2]), centre + np.array([0, -wide / 2, 0.45])
        blocks.append(beam(low - corner, high - corner, np.array([1.0, 0, 0]), wide, wide))
    return to_world(tower, join(blocks))


def to_world(tower: Tower, mesh: Mesh) -> Mesh:
    """Tower axes to the world frame."""
    return Mesh(
        mesh.vertices @ tower.axes.T + np.array(tower.foot), mesh.faces, mesh.uv, mesh.colour, mesh.smooth
    )


def arm_tip(design: LineConfig, wire: WireConfig) -> tuple[float, float] | None:
    """Where the cross-arm of a wire ends (y, z); None for a wire clamped to the body itself."""
    length = design.support.string_length_m
    if wire.insulator == "string":
        return wire.across_m, wire.height_m + length
    if wire.insulator == "vee":  # the outer string of the V leans as far out as the inner one leans in
        return wire.across_m + math.copysign(vee_reach_m(design), wire.across_m), wire.height_m + length
    if wire.insulator == "tension":  # its strings pull at the arm's tip
        return wire.across_m, wire.height_m
    if abs(wire.across_m) > 0.5:
        return wire.across_m, wire.height_m + 0.18
    return None


def vee_reach_m(design: LineConfig) -> float:
    """Across the line from the clamp to where each string of a V is hung."""
    return 1.25 * design.support.string_length_m


def _tips(design: LineConfig) -> list[tuple[float, float]]:
    tips = (arm_tip(design, wire) for wire in design.wires)
    return [tip for tip in tips if tip is not None]


def _arm_heights(design: LineConfig) -> list[float]:
    return sorted({z for _, z in _tips(design)} or {0.9 * design.support.height_m})


def _grown(design: LineConfig) -> float:
    """Size of the tower's panels against those of the bundled one, whose waist is 72 cm wide."""
    return max(1.0, design.support.waist_m / 0.72)


def half_width_m(design: LineConfig, z: float) -> float:
    """Half the body's width at height z: a wide foot, a slim waist from the lowest arm up, a pointed peak."""
    arms = _arm_heights(design)
    support, shoulder = design.support, _shoulder(design)
    halves = [support.foot_m / 2, support.waist_m / 2, support.shoulder_m / 2, 0.03]
    return float(np.interp(z, [0.0, arms[0], shoulder, support.height_m], halves))


def _shoulder(design: LineConfig) -> float:
    """Where the peak begins."""
    return min(_arm_heights(design)[-1] + 0.75 * _grown(design), design.support.height_m - 0.3)


def _body(design: LineConfig) -> list[Mesh]:
    arms = _arm_heights(design)
    levels = [0.0]
    while levels[-1] < arms[0]:  # square panels, so they shorten as the body tapers
        levels.append(levels[-1] + max(0.75, 1.75 * half_width_m(design, levels[-1])))
    below = np.array(levels) * arms[0] / levels[-1]
    shoulder, grown = _shoulder(design), _grown(design)
    above = np.linspace(arms[0], shoulder, max(2, round((shoulder - arms[0]) / (0.75 * grown))) + 1)
    bold = math.sqrt(grown)
    z = [*below, *above[1:]]
    parts: list[Mesh] = []

    def corner(face: int, height: float) -> np.ndarray:
        sx, sy = FACES[face % 4]
        w = half_width_m(design, height)
        return np.array([sx * w, sy * w, height])

    for face in range(4):
        legs = [*z, design.support.height_m]
        parts += [
            angle_bar(corner(face, lo), corner(face, hi), corner(face, 0.0) * [1, 1, 0], 0.10 * bold)
            for lo, hi in pairwise(legs)
        ]
        outward = corner(face, 0.0) + corner(face + 1, 0.0)
        for i, (lo, hi) in enumerate(pairwise(z)):
            width = bold * (0.06 if lo < arms[0] else 0.045)
            parts.append(angle_bar(corner(face, lo), corner(face + 1, hi), outward, width))
            parts.append(angle_bar(corner(face + 1, lo), corner(face, hi), outward, width))
            if i % 2 == 1 or hi > arms[0] - 0.1:
                parts.append(angle_bar(corner(face, hi), corner(face + 1, hi), outward, width))
    return parts


def _arms(design: LineConfig) -> list[Mesh]:
    parts: list[Mesh] = []
    grown, bold = _grown(design), math.sqrt(_grown(design))
    for y, z in _tips(design):
        side = math.copysign(1.0, y)
        rise = min(0.75 * grown, design.support.height_m - z)
        tip = np.array([0.0, y, z])
        count = max(3, round((abs(y) - half_width_m(design, z)) / (1.15 * bold)))
        for sx in (1, -1):
            w = half_width_m(design, z)
            top_w = half_width_m(design, z + rise)
            root = np.array([sx * w, side * w, z])
            high = np.array([sx * top_w, side * top_w, z + rise])
            outward = np.array([float(sx), 0.0, 0.0])
            parts.append(angle_bar(root, tip, outward - up(1.0), 0.07 * bold))
            parts.append(angle_bar(high, tip, outward + up(1.0), 0.06 * bold))
            stations = np.linspace(0.0, 1.0, count + 1)
            lower, upper = root + stations[:, None] * (tip - root), high + stations[:, None] * (tip - high)
            for i in range(count):
                if i:
                    parts.append(angle_bar(lower[i], upper[i], outward, 0.04 * bold))
                parts.append(angle_bar(lower[i + 1], upper[i], outward, 0.04 * bold))
                if sx > 0 and i:  # ties between the two chords, seen from below
                    tie = lower[i] * [-1, 1, 1]
                    parts.append(angle_bar(lower[i], tie, np.array([0, 0, -1.0]), 0.04 * bold))
        parts.append(angle_bar(tip + up(0.05), tip - up(0.10), np.array([1.0, 0, 0]), 0.06))
    return parts
