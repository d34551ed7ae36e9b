"""Coordinates as a report shows them.

They are those of the world where the survey has a scale and the world's z is up; else those of the LineFrame.
Drawings are made in the LineFrame, whose heights differ from the shown ones by a constant.
"""

import numpy as np
from jaxtyping import Float

from plnerf.line.frame import LineFrame
from plnerf.line.survey import Survey
from plnerf.report.figures import Units


def units_of(survey: Survey) -> Units:
    """Of the lengths in tables and cards: feet where the settings ask for them.  Drawings, coordinates and
    findings are in metres."""
    if survey.frame.unit == "m" and survey.report_units == "feet":
        return Units("ft")
    return Units(survey.frame.unit)


def shows_world(frame: LineFrame) -> bool:
    """Whether shown coordinates are those of the world."""
    return frame.unit == "m" and frame.upright


def shown(frame: LineFrame, points: Float[np.ndarray, "*b 3"]) -> Float[np.ndarray, "*b 3"]:
    """Shown coordinates of points of the LineFrame."""
    return frame.to_world(points) if shows_world(frame) else points


def height_shift(frame: LineFrame) -> float:
    """What is added to a height of the LineFrame for the shown one."""
    return float(shown(frame, np.zeros(3))[2])
