"""Every figure that a survey states with an interval, beside the true one: what shows whether intervals hold.

The true wire is its polyline in truth.json, not the catenary that is nearest to it: where wind makes a wire
bow off every plane curve, that is part of the error.  Figures of one survey share errors, above all those of
one wire and those to one obstacle.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from jaxtyping import Float

from plnerf.capture.similarity import Similarity
from plnerf.line.clearances import Group, WireClearance
from plnerf.line.ends import TWO_SIDED_95, Attached
from plnerf.line.survey import Survey
from plnerf.line.wire import Wire
from plnerf.score.compared import Compared
from plnerf.score.config import ScoreConfig
from plnerf.score.survey_score import score_survey
from plnerf.score.truth import read_truth
from plnerf.score.truth_fields import load_truth
from plnerf.score.wire_matches import Match, common_with

FigureKind = Literal[
    "sag", "wire across", "wire up", "attachment", "ground", "vegetation", "vegetation, at most", "building",
    "structure",
]
FIGURE_KINDS: tuple[FigureKind, ...] = get_args(FigureKind)
GROUPS: Mapping[FigureKind, Group] = {
    "vegetation": "vegetation", "building": "structures", "structure": "other",
}  # fmt: skip
"""Of the survey's clearances, by the kind of figure."""
LIMIT: FigureKind = "vegetation, at most"
"""An upper limit: too little of the air nearer than the nearest plant was seen."""
ANY_CURVE = ScoreConfig(truth_departs_m=2.0)
"""True wires need not hang in a plane: for what is matched with what, the nearest catenary is near enough."""
SPREAD = 0.6180339887
"""Places on wires are this share of a wire further along from one wire to the next, so that all places are as
common (the golden ratio)."""


@dataclass(frozen=True)
class Figure:
    """One figure and the true one; metres."""

    kind: FigureKind
    of: str
    """Name of the true wire."""
    true_m: float
    found_m: float
    sigma_m: float

    @property
    def error_m(self) -> float:
        """Found less true."""
        return self.found_m - self.true_m

    @property
    def deviations(self) -> float:
        """The error in stated standard deviations; infinite where none is stated but there is an error.  An
        upper limit has none where less is true."""
        error_m = min(self.error_m, 0.0) if self.kind == LIMIT else self.error_m
        if self.sigma_m > 0:
            return error_m / self.sigma_m
        return float(np.sign(error_m) * np.inf) if error_m else 0.0

    @property
    def within_95(self) -> bool:
        """Whether the true value lies in the stated 95 % interval."""
        return abs(self.deviations) <= TWO_SIDED_95


def figures_of(survey: Survey, truth_at: Path) -> tuple[Figure, ...]:
    """All figures of a survey whose wires have a true one.

    Distances to the ground and to things come from `clearances` of the truth's conductors where it has them,
    and then of wires that structures hold at both ends only; else from `score_survey`, those to plants of
    each wire or, where the truth does not state them, of all wires together.  Raises SurveyError where the
    truth cannot be read, or is in another frame.
    """
    truth = read_truth(truth_at, ANY_CURVE)
    score = score_survey(survey, truth, ANY_CURVE.wires)
    rows = {one.name: row for one, row in zip(truth.wires, load_truth(truth_at)["conductors"], strict=True)}
    by_id = {wire.id: wire for wire in survey.wires}
    stated = {} if survey.clearances is None else {one.wire: one for one in survey.clearances.wires}
    to_line = Similarity(*survey.frame.similarity)
    found: list[Figure] = []
    for number, match in enumerate(score.wires.matches):
        wire, row = by_id[match.conductor], rows[match.wire]
        line = to_line(np.array(row["polyline"], np.float64))
        found += _of_wire(match, wire, line, (number * SPREAD) % 1.0)
        if row.get("clearances") and wire.open is None and wire.id in stated:
            found += _of_clearances(match.wire, stated[wire.id], row["clearances"])
    if not any(row.get("clearances") for row in rows.values()):
        of = score.clearances
        least = () if of.vegetation is None else (of.vegetation,)
        plants = of.vegetation_of_wires or least  # a truth need not list leaves
        of_kinds: Sequence[tuple[FigureKind, Sequence[Compared]]] = (
            ("ground", of.ground), ("vegetation", plants),
        )  # fmt: skip
        for kind, compared in of_kinds:
            for one in compared:
                if one.found_m is not None and one.sigma_m is not None:
                    as_stated: FigureKind = LIMIT if one.at_most else kind
                    found.append(Figure(as_stated, one.wire, one.true_m, one.found_m, one.sigma_m))
    return tuple(found)


def _of_wire(match: Match, wire: Wire, line: Float[np.ndarray, "v 3"], share: float) -> Sequence[Figure]:
    """Sag, one place and the attachments of a wire; line: the true one."""
    found: list[Figure] = []
    if wire.sag is not None:
        found.append(Figure("sag", match.wire, _drop(line), wire.sag.value, wire.sag.sigma))
    shared = common_with(line, wire, ANY_CURVE.wires)
    if shared is not None:
        places = np.arange(len(shared.s))[shared.inner]
        k = int(places[int(share * len(places))])
        true, sigma = shared.true[k], wire.sigma_at(shared.s[k : k + 1])[0]
        at = true + shared.off[k]
        kinds: tuple[FigureKind, FigureKind] = ("wire across", "wire up")
        for axis, kind in enumerate(kinds):
            found.append(Figure(kind, match.wire, float(true[axis]), float(at[axis]), float(sigma[axis])))
    for off, end in zip(match.ends_off_m, wire.ends, strict=True):
        if off is not None and isinstance(end, Attached):
            found.append(Figure("attachment", match.wire, 0.0, off, end.sigma_m))
    return found


def _of_clearances(name: str, one: WireClearance, true: Mapping[str, Any]) -> Sequence[Figure]:
    found: list[Figure] = []
    if one.vertical is not None and true.get("ground") is not None:
        found.append(Figure("ground", name, true["ground"], one.vertical.distance_m, one.vertical.sigma_m))
    for kind, group in GROUPS.items():
        place = one.least(group)
        if place is not None and true.get(kind) is not None:
            found.append(Figure(kind, name, true[kind], place.distance_m, place.sigma_m))
    return found


def _drop(line: Float[np.ndarray, "v 3"]) -> float:
    """Greatest vertical drop below the chord between the ends of a line."""
    a, b = line[0], line[-1]
    u = (b - a)[:2] / np.linalg.norm((b - a)[:2])
    share = (line[:, :2] - a[:2]) @ u / np.linalg.norm((b - a)[:2])
    return float((a[2] + share * (b[2] - a[2]) - line[:, 2]).max())
