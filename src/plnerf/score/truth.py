"""The true wires of a scene, and what stands around them, out of its truth.json.

World frame, z up, metres.  A true wire is a wire as surveys have them, known without uncertainty.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, get_args

import numpy as np
from jaxtyping import Float

from plnerf.capture.similarity import Similarity
from plnerf.errors import SurveyError
from plnerf.line.base import Base
from plnerf.line.catenary import p_of_sag
from plnerf.line.ends import Attached, Evidence
from plnerf.line.line import Structure, StructureKind
from plnerf.line.wire import Kind, Wire
from plnerf.scene.json_fields import numbers_of
from plnerf.scene.strict_json import shown
from plnerf.score.config import DEFAULT, ScoreConfig
from plnerf.score.true_curve import departure_m, moved, theta_of
from plnerf.score.true_plants import TruePlant, read_plant
from plnerf.score.truth_fields import load_truth, name_of, number_of, objects, points_of

Stretches = tuple[tuple[float, float], ...]
"""From one place s of a wire's base to another, each."""
MOST_TURNED = 0.9998
"""Cosine of the angle between a stated direction and that from end to end: 1 degree is rounding."""


@dataclass(frozen=True, eq=False)
class Truth:
    """What a survey is compared with."""

    wires: tuple[Wire, ...]
    """From attachment to attachment; each wire of a bundle is one.  All of them have names."""
    structures: tuple[Structure, ...] = ()
    attachments: Float[np.ndarray, "m 3"] | None = None
    """Where insulators hold the wires; None: at the wires' ends."""
    ground: Float[np.ndarray, "g 3"] | None = None
    """Points of the ground's surface, dense enough to interpolate between; None: it is not known."""
    plants: tuple[TruePlant, ...] = ()
    """Those whose clearance is known, the nearest ones among them."""
    houses: int = 0
    observable: tuple[Stretches, ...] = ()
    """Of each wire the stretches of s that images show well enough to measure; empty: it is not stated."""

    def moved(self, motion: Similarity) -> "Truth":
        """All of it in another frame."""
        wires = tuple(moved(wire, motion) for wire in self.wires)
        by = [new.base.length_m / old.base.length_m for new, old in zip(wires, self.wires, strict=True)]
        return replace(
            self,
            wires=wires,
            observable=tuple(
                tuple((low * factor, high * factor) for low, high in one)
                for one, factor in zip(self.observable, by, strict=bool(self.observable))
            ),
            structures=tuple(
                replace(one, foot=motion(one.foot), height_m=motion.scale * one.height_m)
                for one in self.structures
            ),
            attachments=None if self.attachments is None else motion(self.attachments),
            ground=None if self.ground is None else motion(self.ground),
            plants=tuple(plant.moved(motion) for plant in self.plants),
        )


def read_truth(path: Path, config: ScoreConfig = DEFAULT) -> Truth:
    """Reads a scene's truth.json.

    Raises SurveyError where it is none, has no conductors, or has one that hangs in no catenary.
    """
    data = load_truth(path)
    conductors = data.get("conductors")
    if not isinstance(conductors, list) or not conductors:
        raise SurveyError(
            f"{path} has no list 'conductors', so there are no true wires to compare with. Give the "
            "truth.json of a scene of `plnerf synth`, or one like it."
        )
    structures, held = [], []
    for i, entry in enumerate(objects(data, "towers", path), 1):
        where = f"{path}, tower {i}"
        foot = points_of([entry.get("foot")], f"{where}, foot")[0]
        height = number_of(entry.get("height_m", 0.0), f"{where}, height_m")
        structures.append(_true_structure(entry, i, foot, height, where))
        if entry.get("attachments"):
            held.append(points_of(entry["attachments"], f"{where}, attachments"))
    wires = [
        _wire(entry, i, f"{path}, conductor {i}", structures, config) for i, entry in enumerate(conductors, 1)
    ]
    return Truth(
        tuple(wires),
        tuple(structures),
        np.concatenate(held) if held else None,
        _ground(data.get("ground"), path),
        tuple(
            read_plant(entry, f"{path}, plant {i}")
            for i, entry in enumerate(objects(data, "vegetation", path), 1)
            if "clearance_m" in entry
        ),
        len(objects(data, "houses", path)),
        _observable(conductors, path),
    )


def _true_structure(
    entry: Mapping[str, Any], number: int, foot: Float[np.ndarray, "3"], height_m: float, where: str
) -> Structure:
    """A tower or pole, with its kind and the angle of its line where they are stated."""
    kind = entry.get("structure", "unknown")
    if kind not in get_args(StructureKind):
        raise SurveyError(
            f"{where}: its structure must be one of {', '.join(get_args(StructureKind))}, but is "
            f"{shown(kind)}. Correct the file."
        )
    angle = entry.get("line_angle_deg")
    return Structure(
        number,
        foot,
        height_m,
        0.0,
        "the truth",
        kind,
        None if entry.get("name") is None else name_of(entry, "name", "", where),
        None if angle is None else number_of(angle, f"{where}, line_angle_deg"),
    )


def _observable(entries: Sequence[Mapping[str, Any]], path: Path) -> tuple[Stretches, ...]:
    """Of each conductor; empty where not all of them state it."""
    found = [
        _stretches(entry.get("observable_m"), f"{path}, conductor {i}", "observable_m")
        for i, entry in enumerate(entries, 1)
    ]
    stated = [one for one in found if one is not None]
    return tuple(stated) if len(stated) == len(found) else ()


def _wire(entry: Any, number: int, where: str, structures: Sequence[Structure], config: ScoreConfig) -> Wire:
    """One of the list's, by its stated numbers if it has them, else by its polyline."""
    if not isinstance(entry, dict):
        raise SurveyError(f"{where}: expected an object, but found {shown(entry)}. Correct the file.")
    states = {"a", "b"} <= entry.keys() and bool({"p_m", "sag_m"} & entry.keys())
    if states and "polyline" not in entry:
        entry = entry | {"polyline": [entry["a"], entry["b"]]}
    line = points_of(entry.get("polyline"), f"{where}, polyline", least=2)
    a = points_of([entry.get("a", line[0].tolist())], f"{where}, a")[0]
    b = points_of([entry.get("b", line[-1].tolist())], f"{where}, b")[0]
    base = Base(a[:2], b[:2])
    if base.length_m == 0:
        raise SurveyError(f"{where}: both of its ends are at {a[:2].tolist()}. Correct the file.")
    _check_direction(entry, base, where)
    theta = _stated(entry, a, b, where) if states else theta_of(line, base)
    departs_m = departure_m(line, base, theta)
    if departs_m > config.truth_departs_m:
        raise SurveyError(
            f"{where}: its polyline departs by {departs_m:.3f} m from the catenary that "
            f"{'the entry states' if states else 'is nearest to it'}, but at most "
            f"{config.truth_departs_m:g} m are allowed. A wire hangs from one attachment to the next: give "
            "each span of it an entry of its own, and correct what is not on the wire."
        )
    kind = entry.get("kind", "phase")
    if kind not in get_args(Kind):
        raise SurveyError(
            f"{where}: its kind must be one of {', '.join(get_args(Kind))}, but is {shown(kind)}. "
            "Correct the file."
        )
    diameter_m = number_of(entry.get("diameter_m", 0.0), f"{where}, diameter_m")
    first, last = (Attached(_structure(end, structures, i), end, 0.0) for i, end in enumerate((a, b), 1))
    return Wire(
        id=number,
        base=base,
        theta=theta,
        covariance=np.zeros((6, 6)),
        ends=(first, last),
        evidence=Evidence("the truth", 0, seen_m=_stretches(entry.get("seen_m"), where)),
        kind=kind,
        diameter_m=diameter_m or None,
        name=name_of(entry, "name", f"wire {number}", where),
    )


def _stated(
    entry: Mapping[str, Any], a: Float[np.ndarray, "3"], b: Float[np.ndarray, "3"], where: str
) -> Float[np.ndarray, "6"]:
    """theta of a wire whose parameter or sag is stated, upright unless its swing is too."""
    key = "p_m" if "p_m" in entry else "sag_m"
    value = number_of(entry[key], f"{where}, {key}")
    if value <= 0:
        raise SurveyError(f"{where}: its {key} must be greater than 0, but is {value}. Correct the file.")
    L = math.dist(a[:2], b[:2])
    swing = math.radians(number_of(entry.get("swing_deg", 0.0), f"{where}, swing_deg"))
    if swing and key == "sag_m":
        raise SurveyError(f"{where}: a wire with a swing_deg must state its p_m too. Add it to the file.")
    p = value if key == "p_m" else p_of_sag(L, float(b[2] - a[2]), value)
    return np.array([0.0, 0.0, a[2], b[2], L**2 / (8 * p), swing])


def _check_direction(entry: Mapping[str, Any], base: Base, where: str) -> None:
    """seen_m counts along it."""
    direction = numbers_of(entry.get("direction", base.u.tolist()))
    if direction.shape != (2,) or not 0 < np.linalg.norm(direction) < math.inf:
        raise SurveyError(
            f"{where}: its direction must be two numbers, not both zero, but is {direction.tolist()}. "
            "Correct the file."
        )
    if direction @ base.u < MOST_TURNED * np.linalg.norm(direction):
        raise SurveyError(
            f"{where}: its direction is {direction.tolist()}, but from its first end to its last it is "
            f"{base.u.round(6).tolist()}. Correct the file."
        )


def _structure(end: Float[np.ndarray, "3"], structures: Sequence[Structure], number: int) -> int:
    """Id of the structure that holds an end: the nearest; without any, they are numbered as the ends are."""
    away = [(float(np.linalg.norm(one.foot[:2] - end[:2])), one.id) for one in structures]
    return min(away)[1] if away else number


def _ground(value: Any, path: Path) -> Float[np.ndarray, "g 3"] | None:
    """The points of all rows."""
    if value is None:
        return None
    if not isinstance(value, dict):
        raise SurveyError(f"{path}: ground must be an object, but is {shown(value)}. Correct the file.")
    if not (rows := objects(value, "rows", path)):
        return None
    return np.concatenate([points_of(row.get("points"), f"{path}, ground") for row in rows])


def _stretches(value: Any, where: str, key: str = "seen_m") -> Stretches | None:
    if value is None:
        return None
    array = np.zeros((0, 2)) if value == [] else numbers_of(value)
    fits = array.shape[1:] == (2,)
    pairs = tuple((low, high) for low, high in array.tolist()) if fits else ((math.nan, math.nan),)
    if not all(low <= high for low, high in pairs):
        raise SurveyError(
            f"{where}: {key} must be a list of stretches [from, to] in metres, but is {str(value)[:80]}. "
            "Correct the file, or make the truth again."
        )
    return pairs
