"""The true plants beside a line, and how near their leaves are to its wires."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from plnerf.capture.similarity import Similarity
from plnerf.errors import SurveyError
from plnerf.scene.json_fields import numbers_of
from plnerf.scene.strict_json import shown
from plnerf.score.truth_fields import name_of, number_of, points_of


@dataclass(frozen=True, eq=False)
class TrueLeaf:
    """The leaf of a plant that is nearest to a wire, or to a piece of it."""

    wire: str
    """Name of the wire."""
    place: Float[np.ndarray, "3"]
    clearance_m: float
    """From the leaf to the wire's surface."""
    observable: bool = True
    """Whether images show it well enough to measure; where that is not stated, they do."""


@dataclass(frozen=True, eq=False)
class TruePlant:
    """A plant beside the line."""

    foot: Float[np.ndarray, "3"]
    clearance_m: float
    """Least distance from its leaves to the surface of a wire."""
    wire: str
    """Name of that wire."""
    radius_m: float = 0.0
    observable: bool = True
    """Whether images show the leaf that is nearest to it well enough to measure; where that is not stated,
    they do."""
    leaves: tuple[TrueLeaf, ...] = ()
    """Those that are nearest to each piece of the wires around it; empty: they are not stated."""

    def moved(self, motion: Similarity) -> "TruePlant":
        """In another frame."""
        return replace(
            self,
            foot=motion(self.foot),
            clearance_m=motion.scale * self.clearance_m,
            radius_m=motion.scale * self.radius_m,
            leaves=tuple(
                replace(one, place=motion(one.place), clearance_m=motion.scale * one.clearance_m)
                for one in self.leaves
            ),
        )


def read_plant(entry: Mapping[str, Any], where: str) -> TruePlant:
    """One that has a clearance.  Raises SurveyError where the entry is none."""
    leaves = entry.get("leaves", {})
    if not isinstance(leaves, Mapping):
        raise SurveyError(
            f"{where}: its leaves must be an object, but are {shown(leaves)}. Correct the file."
        )
    return TruePlant(
        points_of([entry.get("foot")], f"{where}, foot")[0],
        number_of(entry["clearance_m"], f"{where}, clearance_m"),
        name_of(entry, "nearest_conductor", "", where),
        number_of(entry.get("radius_m", 0.0), f"{where}, radius_m"),
        entry.get("observable") is not False,
        tuple(leaf for wire, rows in leaves.items() for leaf in _read_leaves(wire, rows, where)),
    )


def _read_leaves(wire: str, rows: Any, where: str) -> list[TrueLeaf]:
    """Of x, y, z, the clearance and, where it is stated, 1 or 0: whether images show it."""
    table = numbers_of(rows)
    if table.ndim != 2 or table.shape[1] not in (4, 5) or not np.isfinite(table).all():
        raise SurveyError(
            f"{where}: its leaves beside {wire} must be rows of four or five finite numbers, but are "
            f"{str(rows)[:80]}. Correct the file, or make the truth again."
        )
    return [TrueLeaf(wire, row[:3], float(row[3]), not (row[4:] == 0).any()) for row in table]
