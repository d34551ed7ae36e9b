"""What may be near to a wire though too few images show it: a table, and parts of photos to judge it by."""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from plnerf.line.clearances import Place, Possible
from plnerf.line.ends import Quantity
from plnerf.line.survey import Crop, Survey
from plnerf.report.colours import MARK, rgb
from plnerf.report.figures import Units
from plnerf.report.overlay import Shown, jpeg_url
from plnerf.report.shown import shown, units_of
from plnerf.report.tables import XYZ, Table

CROP_PX = 420
"""Longer side of a crop in the page, to which it is enlarged or reduced."""
RING_PX = 22
"""Radius of the ring around the obstacle: what is inside of it is to be judged."""


@dataclass(frozen=True)
class CropRow:
    """Parts of photos of one obstacle, and what they show."""

    title: str
    crops: tuple[Shown, ...]


def possible_table(survey: Survey) -> Table | None:
    """A row for each; None without any."""
    found = survey.clearances.possible if survey.clearances is not None else ()
    if not found:
        return None
    units = units_of(survey)
    rows = [
        [
            str(k), one.place.to, str(one.place.wire),
            units.interval(Quantity(one.place.distance_m, one.place.sigma_m)), str(one.seen), str(one.past),
            _doubt(one),
            units.length(one.place.s_m, 1), units.place(shown(survey.frame, one.place.on_obstacle)),
        ]
        for k, one in enumerate(found, 1)
    ]  # fmt: skip
    return Table(
        ["", "to", "wire", *units.heads_95("distance, if it is there"), "images see it", "see past it",
         "in doubt by", *units.heads("at"), f"where {XYZ}"],
        rows,
        "Not counted as clearances and without a verdict. In doubt by images: too few of them see something "
        "at the place, or no more than see past it; most such places are wrong matches, but a thin twig can "
        "be one too. By an open end: it stands where a wire is seen last, and may be a structure that was "
        "not found. By a structure: it stands beside one, about as high as its wires, and may be a part of "
        "it. By shape: it is thin and in the air, with nothing seen below it, and may be a wire that was not "
        "found, a wrong match or the tip of a branch.",
        frozenset({1, 6}),
    )  # fmt: skip


def _doubt(one: Possible) -> str:
    if one.at_open_end:
        return "open end"
    if one.at_structure:
        return "structure"
    return "shape" if one.floats else "images"


def or_nearer(survey: Survey, least: Place) -> str:
    """Words beside the least distance to a group: what may be nearer; empty if nothing may."""
    possible = survey.clearances.possible if survey.clearances is not None else ()
    places = [one.place for one in possible if one.place.to == least.to]
    nearest = min(places, key=lambda place: place.distance_m, default=least)
    if nearest.distance_m >= least.distance_m:
        return ""
    distance = units_of(survey).with_unit(nearest.distance_m)
    return f"; something may be {distance} from wire {nearest.wire}: see “Possible, look here”"


def possible_crops(survey: Survey) -> list[CropRow]:
    """Each obstacle's parts of photos, with a ring around its place and a line from there to the wire."""
    found = survey.clearances.possible if survey.clearances is not None else ()
    units = units_of(survey)
    return [
        CropRow(_title(k, one, units), tuple(shown_crop(crop) for crop in survey.crops if crop.of == k - 1))
        for k, one in enumerate(found, 1)
    ]


def _title(number: int, one: Possible, units: Units) -> str:
    return f"{number}: {units.with_unit(one.place.distance_m)} from wire {one.place.wire}, if it is there"


def shown_crop(crop: Crop) -> Shown:
    """As the page shows it."""
    height, width = crop.rgb.shape[:2]
    factor = CROP_PX / max(height, width)
    size = (max(1, round(width * factor)), max(1, round(height * factor)))
    interpolation = cv2.INTER_AREA if factor < 1 else cv2.INTER_CUBIC
    drawn = cv2.resize(crop.rgb, size, interpolation=interpolation).astype(np.uint8)
    return Shown(jpeg_url(_marked(drawn, crop.at * factor, crop.wire * factor)), *size, crop.name)


def _marked(
    picture: UInt8[np.ndarray, "h w 3"], at: Float[np.ndarray, "2"], wire: Float[np.ndarray, "2"]
) -> UInt8[np.ndarray, "h w 3"]:
    """With the ring, and the line from it to the wire."""
    colour, centre = rgb(MARK), tuple(np.round(at - 0.5).astype(int).tolist())
    cv2.circle(picture, centre, RING_PX, colour, 2, cv2.LINE_AA)
    towards = wire - at
    apart = float(np.linalg.norm(towards))
    if apart > RING_PX and np.abs(wire).max() < 10 * CROP_PX:
        ends = np.round(np.stack([at + towards * RING_PX / apart, wire]) - 0.5).astype(int).tolist()
        cv2.line(picture, ends[0], ends[1], colour, 1, cv2.LINE_AA)
    return picture
