"""Encroachments in the plan: their outlines in the colour of their priority, and the numbers of the first."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from plnerf.line.encroachments import IN_WORDS
from plnerf.line.survey import Survey
from plnerf.report.shown import shown

COLOURS = {1: "#b71c1c", 2: "#e64a19", 3: "#ef8f00", 4: "#8d6e63", 5: "#78909c"}
"""By priority."""
NUMBERED = 40
"""Of more, the less urgent have no number; the pointer shows it."""
DOT_PX = 2.6


def encroachment_marks(
    survey: Survey, at: Callable[[Float[np.ndarray, "n d"]], Float[np.ndarray, "n 2"]]
) -> list[str]:
    """SVG of all; at: from shown coordinates to pixels."""
    parts = []
    for one in survey.encroachments.records if survey.encroachments is not None else ():
        colour = COLOURS[one.priority]
        title = f"<title>encroachment {one.id}: {IN_WORDS[one.priority]}</title>"
        if len(one.outline):
            corners = np.column_stack([one.outline, np.full(len(one.outline), one.highest[2])])
            path = " ".join(f"{x:.1f},{y:.1f}" for x, y in at(shown(survey.frame, corners)))
            parts.append(
                f'<polygon points="{path}" fill="{colour}" fill-opacity="0.35" stroke="{colour}">{title}'
                "</polygon>"
            )
        x, y = at(shown(survey.frame, one.highest[None]))[0]
        parts.append(
            f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{DOT_PX}" fill="{colour}">{title}</circle>'
        )
        if one.id <= NUMBERED:
            parts.append(
                f'<text x="{x + DOT_PX + 1:.1f}" y="{y:.1f}" dy="-2" font-size="9.5" font-weight="700" '
                f'class="halo" style="fill:{colour}">{one.id}</text>'
            )
    return parts


def about_marks(survey: Survey) -> str:
    """What they are; empty without any."""
    found = survey.encroachments.records if survey.encroachments is not None else ()
    return "; numbered areas: encroachments, red those that are too near already" if found else ""
