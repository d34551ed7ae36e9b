"""Colours and names of classes, the same in every picture of a report.

Told apart with colour-blind eyes by their lightness, not by hue alone: ground is brown, vegetation lighter
the lower it is, conductors are vermilion and shield wires blue (Okabe and Ito's).
"""

from plnerf.survey.model import (
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

CLASSES: dict[int, tuple[str, str]] = {
    GROUND: ("ground", "#a07a4a"),
    LOW_VEGETATION: ("low vegetation", "#c5d87a"),
    VEGETATION: ("medium vegetation", "#7fb055"),
    HIGH_VEGETATION: ("high vegetation", "#2c7a3d"),
    BUILDING: ("building", "#8a8fa3"),
    TOWER: ("tower", "#3a3a3a"),
    CONNECTOR: ("insulator, fitting", "#8e5aa8"),
    CONDUCTOR: ("conductor", "#d55e00"),
    SHIELD: ("shield wire", "#0072b2"),
    UNCLASSIFIED: ("unclassified", "#c9c9c9"),
}
"""Name and colour of each ASPRS class."""
OTHER = ("other class", "#c9c9c9")
KINDS = {"phase": CLASSES[CONDUCTOR][1], "shield": CLASSES[SHIELD][1]}
"""Colour of a fitted wire."""
MARK = "#a3195b"
"""Of the worst clearances."""
