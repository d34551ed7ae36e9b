"""Why the images show no wire: their views are too alike, or wires may be too thin in them."""

from collections.abc import Sequence

import numpy as np

from plnerf.findings import Finding, harms
from plnerf.line.wire import Wire
from plnerf.survey.posed_photos import Photos
from plnerf.survey.surface import Surface

POINTS = 2000
"""Distances are measured to so many points of a surface."""
THIN_PX = 1.0
"""A wire that is narrower hardly stands out from what lies behind it."""


def why_none(found: Sequence[Wire], photos: Photos, surface: Surface, diameter_m: float) -> Finding:
    """What is known of the reason, where the place of no wire is certain.

    found: wires that were detected, whose place the views do not fix.  Wires hang nearer than what is behind
    them: at its distance they are at their thinnest.
    """
    if found:
        sigma, unit = min(wire.worst_sigma() for wire in found), photos.frame.unit
        return harms(
            "wires",
            f"The images show {len(found)} that may be wires, but the views are too alike to fix their "
            f"places: the best is known to {sigma:.2g} {unit}.",
            "Fly another pass farther to the side, or at another height.",
        )
    nothing, width_px = "The images show no line that hangs", _width_px(photos, surface, diameter_m)
    if width_px is None:
        return harms("wires", f"{nothing}.")
    wide = f"at the distance of what they show, a wire of {diameter_m * 100:g} cm is {width_px:.1f} px wide"
    if width_px < THIN_PX:
        do = "Fly nearer, or take photos with more pixels."
        return harms("wires", f"{nothing}. Wires may be too thin in them: {wide}.", do)
    return harms("wires", f"{nothing}; {wide}.")


def _width_px(photos: Photos, surface: Surface, diameter_m: float) -> float | None:
    """Width of a wire in the photos at their full size, as far away as surfaces; None where lengths are not
    metres or nothing is known of surfaces."""
    if photos.frame.unit != "m" or not len(surface.xyz):
        return None
    every = max(1, len(surface.xyz) // POINTS)
    apart = photos.distances(surface.xyz[::every])
    if not np.isfinite(apart).any():
        return None
    focal = photos.full_size().cameras.focal_px[list(photos.train)].mean(1).numpy()
    away = np.where(np.isfinite(apart), apart, np.nan)
    return float(np.nanmedian(diameter_m * focal[:, None] / away))
