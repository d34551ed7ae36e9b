"""The points that the viewer shows: few enough for a browser, coloured by class, photos or height."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8

from plnerf.errors import SurveyError
from plnerf.line.cloud import CONDUCTOR, CONNECTOR, SHIELD, TOWER
from plnerf.line.frame import LineFrame
from plnerf.report.colours import CLASSES, OTHER, rgb
from plnerf.scene.ply import read_ply

MOST_POINTS = 400_000
"""Of those sent to a browser: 6 MB."""
THIN = (CONDUCTOR, SHIELD, TOWER, CONNECTOR)
"""Classes of thin things, kept before others."""
Colouring = Literal["class", "photos", "height"]
COLOURINGS: tuple[Colouring, ...] = get_args(Colouring)


@dataclass(frozen=True, eq=False)
class Points:
    """n points in the LineFrame."""

    xyz: Float[np.ndarray, "n 3"]
    label: UInt8[np.ndarray, " n"] | None
    """ASPRS class; None: they have none."""
    rgb: UInt8[np.ndarray, "n 3"] | None
    """Of the photos; None: not known."""
    total: int
    """How many there were before they were thinned."""

    @property
    def colourings(self) -> tuple[Colouring, ...]:
        """What they can be coloured by, the best first."""
        known = {"class": self.label is not None, "photos": self.rgb is not None, "height": True}
        return tuple(one for one in COLOURINGS if known[one])

    def colours(self, by: Colouring) -> UInt8[np.ndarray, "n 3"]:
        """Red, green and blue of each."""
        if by == "photos" and self.rgb is not None:
            return self.rgb
        if by == "class" and self.label is not None:
            table = np.full((256, 3), rgb(OTHER[1]), np.uint8)
            for code, (_, colour) in CLASSES.items():
                table[code] = rgb(colour)
            return table[self.label]
        z = self.xyz[:, 2]
        low, high = np.percentile(z, [2, 98]) if len(z) else (0.0, 1.0)
        share = np.clip((z - low) / max(float(high - low), 1e-9), 0, 1)
        map_ = cv2.applyColorMap(np.round(share * 255).astype(np.uint8)[:, None], cv2.COLORMAP_VIRIDIS)
        return map_[:, 0, ::-1].copy()


def thinned(
    xyz: Float[np.ndarray, "n 3"],
    label: UInt8[np.ndarray, " n"] | None = None,
    rgb: UInt8[np.ndarray, "n 3"] | None = None,
    most: int = MOST_POINTS,
) -> Points:
    """At most so many of the points, by lot; those of thin things stay up to half of that."""
    keep = np.flatnonzero(np.isfinite(xyz).all(1))
    if len(keep) > most:
        thin = np.isin(label[keep], THIN) if label is not None else np.zeros(len(keep), np.bool_)
        first = _some(keep[thin], most // 2)
        keep = np.sort(np.concatenate([first, _some(keep[~thin], most - len(first))]))
    return Points(
        xyz[keep], None if label is None else label[keep], None if rgb is None else rgb[keep], len(xyz)
    )


def _some(which: Int[np.ndarray, " n"], most: int) -> Int[np.ndarray, " k"]:
    return which if len(which) <= most else np.random.default_rng(0).choice(which, most, replace=False)


def read_survey_points(path: Path, frame: LineFrame) -> Points:
    """The points of a survey's cloud.ply.  Raises SurveyError where it is no such file."""
    rows = read_ply(path)["vertex"]
    names = set(rows.dtype.names or ())
    if not {"x", "y", "z"} <= names:
        raise SurveyError(
            f"{path} has no x, y and z among its properties ({', '.join(sorted(names)) or 'none'}). Survey "
            "again: plnerf survey."
        )
    xyz = np.stack([rows[axis] for axis in "xyz"], 1).astype(np.float64)
    # An unscaled survey's files hold coordinates of its LineFrame.
    places = xyz if frame.unit == "unscaled" else frame.from_world(xyz)
    label = rows["classification"].astype(np.uint8) if "classification" in names else None
    colours = ("red", "green", "blue")
    rgb = np.stack([rows[one].astype(np.uint8) for one in colours], 1) if set(colours) <= names else None
    return thinned(places, label, rgb)
