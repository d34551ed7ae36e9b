"""The true wires of a scene, out of its truth.json.

World frame, z up, metres.  s is the horizontal distance from a wire's first attachment `a` along `direction`.
"""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from plnerf.errors import SurveyError


@dataclass(frozen=True, eq=False)
class TrueWire:
    """One conductor, or one of a bundle: its axis from attachment to attachment."""

    name: str
    kind: str
    """"phase" or "shield"."""
    polyline: Float[np.ndarray, "v 3"]
    a: Float[np.ndarray, "3"]
    direction: Float[np.ndarray, "2"]
    """Horizontal unit vector from a along the span."""
    seen_m: tuple[tuple[float, float], ...] | None = None
    """Stretches of s that show in enough images; None: all of it."""
    diameter_m: float = 0.0

    @property
    def span_m(self) -> float:
        """Horizontal distance between its ends."""
        return float(np.linalg.norm(self.polyline[-1, :2] - self.polyline[0, :2]))

    @property
    def sag_m(self) -> float:
        """Greatest drop of a vertex below the chord between its ends."""
        s, z = self.s_of(self.polyline), self.polyline[:, 2]
        chord = z[0] + (z[-1] - z[0]) * (s - s[0]) / (s[-1] - s[0])
        return float((chord - z).max())

    def s_of(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """Horizontal distances from a along the span."""
        s: Float[np.ndarray, " n"] = (points[:, :2] - self.a[:2]) @ self.direction
        return s


@dataclass(frozen=True, eq=False)
class TrueTower:
    """A tower's body: the vertical line from its foot up."""

    foot: Float[np.ndarray, "3"]
    height_m: float


@dataclass(frozen=True, eq=False)
class TruePlant:
    """A plant beside the line."""

    foot: Float[np.ndarray, "3"]
    clearance_m: float
    """The least distance from its leaves to the surface of a wire."""
    wire: str
    """The wire's name."""


@dataclass(frozen=True, eq=False)
class WireTruth:
    """What a survey of wires is compared with."""

    wires: tuple[TrueWire, ...]
    towers: tuple[TrueTower, ...] = ()
    attachments: Float[np.ndarray, "m 3"] | None = None
    """Where insulators hold the wires; None: at the wires' ends."""
    ground: Float[np.ndarray, "g 3"] | None = None
    """Points of the ground's surface, dense enough to interpolate between; None: it is not known."""
    plants: tuple[TruePlant, ...] = ()
    """Those whose clearance is known, the nearest ones among them."""
    houses: int = 0


def read_truth(path: Path) -> WireTruth:
    """Reads a scene's truth.json.  Raises SurveyError where it is none, or has no conductors."""
    data = _load(path)
    conductors = data.get("conductors")
    if not isinstance(conductors, list) or not conductors:
        raise SurveyError(
            f"{path} has no list 'conductors', so there are no true wires to compare with. Give the "
            "truth.json of a scene of `plnerf synth`, or one like it."
        )
    wires = []
    for i, entry in enumerate(conductors):
        where = f"{path}, conductor {i}"
        if not isinstance(entry, dict):
            raise SurveyError(f"{where}: expected an object, but found {entry!r}. Correct the file.")
        line = _points(entry.get("polyline"), f"{where}, polyline", least=2)
        flat = line[-1, :2] - line[0, :2]
        direction = np.array(entry.get("direction", flat), dtype=np.float64)
        if direction.shape != (2,) or not 0 < np.linalg.norm(direction) < math.inf:
            raise SurveyError(
                f"{where}: its direction must be two numbers, not both zero, but is {direction.tolist()}. "
                "Correct the file."
            )
        wires.append(
            TrueWire(
                name=str(entry.get("name", f"wire {i}")),
                kind=str(entry.get("kind", "phase")),
                polyline=line,
                a=_points([entry.get("a", line[0].tolist())], f"{where}, a")[0],
                direction=direction / np.linalg.norm(direction),
                seen_m=_stretches(entry.get("seen_m"), where),
                diameter_m=_number(entry.get("diameter_m", 0.0), f"{where}, diameter_m"),
            )
        )
    towers, held = [], []
    for i, entry in enumerate(data.get("towers") or []):
        where = f"{path}, tower {i}"
        foot = _points([entry.get("foot")], f"{where}, foot")[0]
        towers.append(TrueTower(foot, _number(entry.get("height_m", 0.0), f"{where}, height_m")))
        if entry.get("attachments"):
            held.append(_points(entry["attachments"], f"{where}, attachments"))
    return WireTruth(
        tuple(wires),
        tuple(towers),
        np.concatenate(held) if held else None,
        _ground(data.get("ground"), path),
        tuple(
            TruePlant(
                _points([entry.get("foot")], f"{path}, plant {i}, foot")[0],
                _number(entry["clearance_m"], f"{path}, plant {i}, clearance_m"),
                str(entry.get("nearest_conductor", "")),
            )
            for i, entry in enumerate(data.get("vegetation") or [])
            if "clearance_m" in entry
        ),
        len(data.get("houses") or []),
    )


def _ground(value: Any, path: Path) -> Float[np.ndarray, "g 3"] | None:
    """The points of all rows."""
    rows = value.get("rows") if isinstance(value, dict) else None
    if not rows:
        return None
    return np.concatenate([_points(row.get("points"), f"{path}, ground") for row in rows])


def _load(path: Path) -> Mapping[str, Any]:
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise SurveyError(
            f"The truth {path} cannot be read ({error.strerror or error}). Give the truth.json of the scene."
        ) from error
    except ValueError as error:  # of JSON, or of the encoding
        raise SurveyError(f"{path} is not valid JSON ({error}). Make the truth again.") from error
    if not isinstance(data, dict):
        raise SurveyError(f"{path} must hold a JSON object, but holds a {type(data).__name__}.")
    return data


def _points(value: Any, where: str, least: int = 1) -> Float[np.ndarray, "n 3"]:
    try:
        points = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        points = np.zeros(0)
    if points.ndim != 2 or points.shape[1] != 3 or len(points) < least or not np.isfinite(points).all():
        raise SurveyError(
            f"{where}: expected {least} or more points of three finite numbers, but found "
            f"{str(value)[:80]}. Correct the file, or make the truth again."
        )
    return points


def _number(value: Any, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise SurveyError(f"{where}: expected a finite number, but found {value!r}. Correct the file.")
    return float(value)


def _stretches(value: Any, where: str) -> tuple[tuple[float, float], ...] | None:
    if value is None:
        return None
    try:
        pairs = tuple((float(low), float(high)) for low, high in value)
    except (TypeError, ValueError):
        pairs = ((math.nan, math.nan),)
    if not all(low <= high for low, high in pairs):
        raise SurveyError(
            f"{where}: seen_m must be a list of stretches [from, to] in metres, but is {str(value)[:80]}. "
            "Correct the file, or make the truth again."
        )
    return pairs
