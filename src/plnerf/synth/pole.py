"""A wooden pole with its crossarm.

Pole axes: x along the line, y across it (left positive), z above the foot, metres.
"""

import numpy as np

from plnerf.synth.line_config import LineConfig
from plnerf.synth.meshes import Mesh, beam, join, tube, up
from plnerf.synth.site import Site, Tower
from plnerf.synth.tower import to_world

PIN_M = 0.30  # from the crossarm's upper face to the wire
ARM_HIGH_M = 0.12
ARM_THICK_M = 0.10


def wood(site: Site, tower: Tower) -> Mesh:
    """The pole, grey-brown with streaks, and its crossarm."""
    design, rng = tower.design, np.random.default_rng([site.config.seed, 6, len(tower.name)])
    heights = np.linspace(-1.2, design.support.height_m, 60)
    share = np.clip(heights / design.support.height_m, 0.0, 1.0)
    radius = 0.5 * ((1 - share) * design.support.foot_m + share * design.support.waist_m)
    axis = np.column_stack([np.zeros(60), np.zeros(60), heights])
    pole = tube(axis, radius, 40)
    top = tube(
        axis[-2:] + np.array([[0, 0, axis[-1, 2] - axis[-2, 2]], [0, 0, 0.02]]),
        np.array([radius[-1], 0.01]),
        40,
    )
    streaks = rng.uniform(0.72, 1.25, 41)
    streaks[-1] = streaks[0]
    mottle = np.clip(1 + 0.10 * rng.normal(size=(60, 41)), 0.6, 1.4)
    grey = np.array([0.215, 0.175, 0.135]) * (1 - 0.25 * (share < 0.06))[:, None, None]
    colour = (grey * (streaks * mottle)[..., None]).reshape(-1, 3)
    parts = [
        Mesh(pole.vertices, pole.faces, None, colour, smooth=True),
        Mesh(top.vertices, top.faces, None, np.tile([0.25, 0.21, 0.16], (len(top.vertices), 1)), smooth=True),
    ]
    arm = arm_height_m(design)
    if arm is not None:
        reach = max(abs(wire.across_m) for wire in design.wires if wire.insulator == "pin") + 0.15
        front = 0.5 * design.support.waist_m + 0.005
        low = np.array([front, -reach, arm - ARM_HIGH_M])
        box = beam(low, low + np.array([0, 2 * reach, 0]), np.array([1.0, 0, 0]), ARM_THICK_M, -ARM_HIGH_M)
        tint = np.array([0.23, 0.185, 0.14]) * rng.uniform(0.85, 1.15, (len(box.vertices), 1))
        parts.append(Mesh(box.vertices, box.faces, None, tint, smooth=True))
    return to_world(tower, join(parts))


def irons(tower: Tower) -> list[Mesh]:
    """Flat braces from the crossarm down to the pole, and the bolt through both."""
    design, arm = tower.design, arm_height_m(tower.design)
    if arm is None:
        return []
    front = 0.5 * design.support.waist_m + 0.005
    meshes = []
    for side in (1.0, -1.0):
        outer = np.array([front - 0.012, side * 0.62, arm - 0.06])
        inner = np.array([front + 0.012, side * 0.02, arm - 0.70])
        meshes.append(beam(outer, inner, np.array([0, side, 0.6]), 0.035, 0.008))
    bolt = np.array([[-front - 0.03, 0, arm - 0.06], [front + ARM_THICK_M + 0.03, 0, arm - 0.06]])
    meshes.append(tube(bolt, 0.012, 8))
    return [to_world(tower, mesh) for mesh in meshes]


def arm_height_m(design: LineConfig) -> float | None:
    """The crossarm's upper face above the foot: a pin's length below the wires it carries."""
    carried = [wire.height_m for wire in design.wires if wire.insulator == "pin"]
    return min(carried) - PIN_M if carried else None


def arm_ahead_m(design: LineConfig) -> float:
    """How far the crossarm's middle stands before the pole's axis, along the line; so do its wires."""
    return 0.5 * design.support.waist_m + 0.005 + ARM_THICK_M / 2


def pin_foot(tower: Tower, across_m: float) -> np.ndarray:
    """The world point on the crossarm under a wire."""
    arm = arm_height_m(tower.design)
    if arm is None:
        raise AssertionError("asked for only where pins are")
    ux, uy = tower.along
    out = arm_ahead_m(tower.design)
    x, y, z = tower.foot
    return np.array([x + ux * out - uy * across_m, y + uy * out + ux * across_m, z]) + up(arm)
