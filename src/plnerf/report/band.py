"""The band below a profile: which structures and spans are above it, with bends, lengths and directions."""

from collections.abc import Sequence

from plnerf.line.frame import LineFrame
from plnerf.line.line import Structure
from plnerf.line.stations import Chain, azimuth_deg
from plnerf.report.figures import Units, degrees
from plnerf.report.side import BOTTOM, TOP, Scale
from plnerf.report.words import length_of

BAND = 40
"""Its height, in pixels."""
LETTER_PX = 6.0
"""Mean width of a letter."""


def band(
    scale: Scale, frame: LineFrame, sheet: Chain, masts: Sequence[tuple[Structure, float]], units: Units
) -> list[str]:
    """Structures and their bends, and between them spans; texts that do not fit are shortened or left out.

    masts: structures with their stations.
    """
    top = TOP + scale.height + BOTTOM
    bottom = top + BAND - 2
    parts = [
        f'<line x1="{scale.x(t):.1f}" x2="{scale.x(t):.1f}" y1="{top:.1f}" y2="{bottom:.1f}" class="axis"/>'
        for t in sorted({t for one in sheet for t in (one.from_m, one.to_m)})
    ]
    for one in sheet:
        left, right = scale.x(one.from_m), scale.x(one.to_m)
        length, azimuth = length_of(one, units), degrees(azimuth_deg(frame, one.base), 1)
        texts = [f"span {one.span.id}: {length}, {azimuth}", f"{one.span.id}: {length}", f"{one.span.id}"]
        text = next((text for text in texts if LETTER_PX * len(text) + 8 < right - left), None)
        if text is not None:
            parts.append(_text((left + right) / 2, top + 12, text))
    for mast, t in masts:
        angle = mast.line_angle_deg
        turns = f", turns {degrees(angle, 1)}" if angle is not None and angle >= 0.05 else ""
        x = scale.x(t)
        first, last = x < scale.x(sheet[0].from_m) + 1, x > scale.x(sheet[-1].to_m) - 1
        anchor = "start" if first else "end" if last else "middle"
        text = f"{mast.id}: {mast.kind}{turns}" if len(sheet) <= 4 else f"{mast.id}{turns}"
        parts.append(_text(x + (4 if first else -4 if last else 0), top + 30, text, anchor, "halo"))
    return parts


def _text(x: float, y: float, text: str, anchor: str = "middle", kind: str = "") -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" class="{kind}" font-size="11">{text}</text>'
