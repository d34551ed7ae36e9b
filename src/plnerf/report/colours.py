"""Colours and names of classes and of kinds of wires, the same in every drawing of a report.

They differ in lightness and not in hue alone, for colour-blind eyes: ground is brown, vegetation lighter the
lower it is; wires have the colours of Okabe and Ito.
"""

from plnerf.line.cloud import (
    BUILDING,
    CONDUCTOR,
    CONNECTOR,
    GROUND,
    HIGH_VEGETATION,
    LOW_VEGETATION,
    SHIELD,
    TOWER,
    UNCLASSIFIED,
    VEGETATION,
)
from plnerf.line.wire import Kind

CLASSES: dict[int, tuple[str, str]] = {
    GROUND: ("ground", "#a07a4a"),
    LOW_VEGETATION: ("low vegetation", "#c5d87a"),
    VEGETATION: ("medium vegetation", "#7fb055"),
    HIGH_VEGETATION: ("high vegetation", "#2c7a3d"),
    BUILDING: ("building", "#8a8fa3"),
    TOWER: ("structure", "#3a3a3a"),
    CONNECTOR: ("insulator, fitting", "#8e5aa8"),
    CONDUCTOR: ("conductor", "#d55e00"),
    SHIELD: ("shield wire", "#0072b2"),
    UNCLASSIFIED: ("unclassified", "#c9c9c9"),
}
"""Name and colour of each ASPRS class."""
OTHER = ("other class", "#c9c9c9")
KINDS: dict[Kind, tuple[str, str]] = {
    "phase": ("phase conductor", CLASSES[CONDUCTOR][1]),
    "shield": ("shield wire", CLASSES[SHIELD][1]),
    "neutral": ("neutral conductor", "#009e73"),
    "communication": ("communication cable", "#b3569a"),
    "unknown": ("unclassified wire", "#5a4b00"),
}
"""Name and colour of each kind of wire."""
DASHED: tuple[Kind, ...] = ("shield", "communication")
"""Kinds that carry no current, drawn dashed."""
MARK = "#a3195b"
"""Of the worst clearances."""


def rgb(colour: str) -> tuple[int, int, int]:
    """Red, green and blue of #rrggbb."""
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)
