"""Why the images show no wire: their views are too alike, or wires may be too thin in them."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from plnerf.findings import Finding, harms
from plnerf.line.wire import Wire
from plnerf.survey.posed_photos import Photos
from plnerf.survey.surface import Surface

POINTS = 2000
"""Distances are measured to so many points of a surface."""
ONE_TRACK = 0.03
"""A flight is one straight track where it leaves it by so small a share of the distance to what it shows."""
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
    if alike := _one_track(photos, surface):
        return alike
    nothing, width_px = "The images show no line that hangs", _width_px(photos, surface, diameter_m)
    if width_px is None:
        return harms("wires", f"{nothing}.")
    wide = f"at the distance of what they show, a wire of {diameter_m * 100:g} cm is {width_px:.1f} px wide"
    if width_px < THIN_PX:
        do = "Fly nearer, or take photos with more pixels."
        return harms("wires", f"{nothing}. Wires may be too thin in them: {wide}.", do)
    return harms("wires", f"{nothing}; {wide}.")


def _one_track(photos: Photos, surface: Surface) -> Finding | None:
    """That all photos were taken along one straight line, and so show each wire along it in one plane."""
    unit, away = photos.frame.unit, _distances(photos, surface)
    centres = photos.cameras.centre[list(photos.train)].double().numpy()
    if away is None or len(centres) < 3:
        return None
    aside = float(np.linalg.svd(centres - centres.mean(0), compute_uv=False)[1] / np.sqrt(len(centres)))
    if aside > ONE_TRACK * np.nanmedian(away):
        return None
    return harms(
        "wires",
        f"All photos were taken within about {2 * aside:.2g} {unit} of one straight line, "
        f"{np.nanmedian(away):.2g} {unit} from what they show: they do not tell where a wire along it hangs.",
        "Fly another pass farther to the side, or at another height.",
    )


def _width_px(photos: Photos, surface: Surface, diameter_m: float) -> float | None:
    """Width of a wire in the photos at their full size, as far away as surfaces; None where lengths are not
    metres or nothing is known of surfaces."""
    away = _distances(photos, surface)
    if photos.frame.unit != "m" or away is None:
        return None
    focal = photos.full_size().cameras.focal_px[list(photos.train)].mean(1).numpy()
    return float(np.nanmedian(diameter_m * focal[:, None] / away))


def _distances(photos: Photos, surface: Surface) -> Float[np.ndarray, "n p"] | None:
    """Distances of points of surfaces from photos, NaN where a photo does not see one; None if none does."""
    every = max(1, len(surface.xyz) // POINTS)
    apart = photos.distances(surface.xyz[::every])
    return np.where(np.isfinite(apart), apart, np.nan) if np.isfinite(apart).any() else None
