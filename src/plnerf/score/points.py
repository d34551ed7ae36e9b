"""How well points of wires agree with the true wires: found, whole, and where they are.

Letters: n points, k cells of the true wires, w wires, t tolerances.  Points and truth are in one frame,
metres, z up.

Every wire is cut into short cells.  A cell is scored if it lies in a stretch that images show (`seen_m`) and
no nearer than `tower_m` to an attachment or to a structure's body.  Every point belongs to the
nearest true wire, so that of two conductors side by side each is scored by its own points.  A point counts
neither for nor against where its nearest cell is not scored, or where it is itself that near to a tower.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

from plnerf.line.polylines import onto_segments, resample
from plnerf.line.wire import Wire
from plnerf.score.config import DEFAULT, PointScoreConfig
from plnerf.score.truth import Truth

_ROUNDING_M = 1e-9


def rules(config: PointScoreConfig) -> dict[str, str]:
    """What the figures of a score mean, in words."""
    return {
        "recall": "share of the scored length with a point of this wire within the tolerance (a sphere's "
        "radius)",
        "precision": "share of the points within the tolerance of the true wire that is nearest, exact "
        f"duplicates dropped, each weighing 1 / (the points within {config.even_m} m of it), so that density "
        "does not count",
        "f1": "harmonic mean of the two",
        "scored": f"seen_m of truth.json without what is within {config.tower_m} m of an attachment or a "
        "tower's axis",
        "neutral": "points whose nearest true point is not scored, or that are themselves that near to a "
        "tower",
        "covered": f"share of the scored length that is in no gap longer than {config.join_m} m between "
        f"points within {config.cover_m} m of the wire; such gaps part fragments; what is not scored is cut "
        "out",
        "rmse": f"of the weighted points within {config.assign_m} m of their wire: horizontally across, and "
        "vertically",
    }


@dataclass(frozen=True)
class WireScore:
    """One true wire and the points that belong to it."""

    name: str
    kind: str
    scored_m: float
    """Length that is scored; with 0, all that follows has no meaning and counts in no mean."""
    recall: tuple[float, ...]
    """At each tolerance of the configuration."""
    covered_share: float
    longest_gap_m: float
    """Longest stretch without a point within `cover_m`."""
    longest_gap_from_m: float
    """Where it begins, along the wire's base."""
    fragments: int
    vertical_rmse_m: float | None
    """None without points within `assign_m`."""
    horizontal_rmse_m: float | None
    points: int
    """Distinct points within `assign_m`."""


@dataclass(frozen=True)
class PointScore:
    """All wires of a scene.  Tuples follow the tolerances."""

    recall: tuple[float, ...]
    """Of all wires together, by length."""
    precision: tuple[float, ...]
    f1: tuple[float, ...]
    wires: tuple[WireScore, ...]
    points: int
    distinct: int
    neutral: int
    """Of the distinct points."""
    far: int
    """Distinct points that count, farther than `assign_m` from every wire."""
    notes: tuple[str, ...]
    """What a reader of the numbers must know."""


@dataclass(frozen=True, eq=False)
class _Cells:
    """The true wires cut up; arrays over the cells of all wires, in order along each."""

    start: Float[np.ndarray, "k 3"]
    end: Float[np.ndarray, "k 3"]
    wire: Int[np.ndarray, " k"]
    scored: Bool[np.ndarray, " k"]

    @property
    def middle(self) -> Float[np.ndarray, "k 3"]:
        return (self.start + self.end) / 2

    @property
    def length_m(self) -> Float[np.ndarray, " k"]:
        length: Float[np.ndarray, " k"] = np.linalg.norm(self.end - self.start, axis=1)
        return length


@dataclass(frozen=True, eq=False)
class _Points:
    """Distinct points of a survey, and the true point nearest to each."""

    at: Float[np.ndarray, "n 3"]
    cell: Int[np.ndarray, " n"]
    share: Float[np.ndarray, " n"]
    """How far along its cell the nearest point lies, 0 to 1."""
    offset: Float[np.ndarray, "n 3"]
    """From the true point to this one."""
    counts: Bool[np.ndarray, " n"]
    weight: Float[np.ndarray, " n"]

    @property
    def distance_m(self) -> Float[np.ndarray, " n"]:
        distance: Float[np.ndarray, " n"] = np.linalg.norm(self.offset, axis=1)
        return distance


def score_points(
    points: Float[np.ndarray, "n 3"], truth: Truth, config: PointScoreConfig = DEFAULT.points
) -> PointScore:
    """Scores points of wires against the true wires, in the truth's frame; `rules` states how.

    No points, or none that counts, score 0, and `notes` states why.
    """
    cells = _cut(truth, config)
    survey = _assign(np.unique(points, axis=0), cells, truth, config)
    wires = tuple(_score_wire(wire, i, cells, survey, config) for i, wire in enumerate(truth.wires))
    total = sum(wire.scored_m for wire in wires)
    close = survey.distance_m[survey.counts]
    weight = survey.weight[survey.counts]
    recall, precision = [], []
    for t, tolerance in enumerate(config.tolerances_m):
        recall.append(sum(wire.recall[t] * wire.scored_m for wire in wires) / total if total else 0.0)
        right = weight[close <= tolerance + _ROUNDING_M].sum()
        precision.append(float(right / weight.sum()) if len(weight) else 0.0)
    f1 = [2 * r * p / (r + p) if r + p else 0.0 for r, p in zip(recall, precision, strict=True)]
    return PointScore(
        recall=tuple(recall),
        precision=tuple(precision),
        f1=tuple(f1),
        wires=wires,
        points=len(points),
        distinct=len(survey.at),
        neutral=int((~survey.counts).sum()),
        far=int((close > config.assign_m).sum()),
        notes=tuple(_notes(points, survey, wires)),
    )


def _cut(truth: Truth, config: PointScoreConfig) -> _Cells:
    starts, ends, owners, scored = [], [], [], []
    for i, wire in enumerate(truth.wires):
        samples = resample(wire.polyline(), config.cell_m)
        middle = (samples[1:] + samples[:-1]) / 2
        seen = np.ones(len(middle), np.bool_)
        if wire.evidence.seen_m is not None:
            s = wire.base.local(middle)[:, 0]
            stretches = ((s >= low) & (s <= high) for low, high in wire.evidence.seen_m)
            seen = np.any([np.zeros(len(s), np.bool_), *stretches], axis=0)
        starts.append(samples[:-1])
        ends.append(samples[1:])
        owners.append(np.full(len(middle), i))
        scored.append(seen & ~_near_structures(middle, truth, config.tower_m))
    return _Cells(*(np.concatenate(parts) for parts in (starts, ends, owners, scored)))


def _near_structures(points: Float[np.ndarray, "n 3"], truth: Truth, near_m: float) -> Bool[np.ndarray, " n"]:
    """Within so far of an attachment or a wire's end, or of the vertical line up from a structure's foot."""
    held = [wire.points(np.array([0.0, wire.base.length_m])) for wire in truth.wires]
    if truth.attachments is not None:
        held.append(truth.attachments)
    near: Bool[np.ndarray, " n"] = cKDTree(np.concatenate(held)).query(points)[0] <= near_m
    for structure in truth.structures:
        above = points - structure.foot
        above[:, 2] -= np.clip(above[:, 2], 0.0, structure.height_m)
        near |= np.linalg.norm(above, axis=1) <= near_m
    return near


def _assign(
    points: Float[np.ndarray, "n 3"], cells: _Cells, truth: Truth, config: PointScoreConfig
) -> _Points:
    # The cell with the nearest middle holds the nearest point: cells are short, and wires nearly straight.
    _, cell = cKDTree(cells.middle).query(points, workers=-1)
    start, end = cells.start[cell], cells.end[cell]
    share = onto_segments(points, start, end)
    counts = cells.scored[cell] & ~_near_structures(points, truth, config.tower_m)
    around = cKDTree(points).query_ball_point(points, config.even_m, return_length=True, workers=-1)
    return _Points(
        at=points,
        cell=cell.astype(np.int64),
        share=share,
        offset=points - (start + share[:, None] * (end - start)),
        counts=counts,
        weight=1.0 / np.maximum(np.asarray(around, dtype=np.float64), 1.0),
    )


def _score_wire(
    wire: Wire, index: int, cells: _Cells, survey: _Points, config: PointScoreConfig
) -> WireScore:
    mine = survey.at[cells.wire[survey.cell] == index]
    cell = np.flatnonzero((cells.wire == index) & cells.scored)
    length = cells.length_m[cell]
    nearest = np.full(len(cell), np.inf)
    if len(mine) and len(cell):
        nearest = cKDTree(mine).query(cells.middle[cell], workers=-1)[0]
    total = float(length.sum())
    recall = tuple(
        float(length[nearest <= tolerance + _ROUNDING_M].sum() / total) if total else 0.0
        for tolerance in config.tolerances_m
    )
    used = survey.counts & (cells.wire[survey.cell] == index)
    before = np.concatenate([[0.0], np.cumsum(length)])
    near = used & (survey.distance_m <= config.cover_m + _ROUNDING_M)
    slot = np.searchsorted(cell, survey.cell[near])
    found = np.sort(before[slot] + survey.share[near] * length[slot]) if len(cell) else np.empty(0)
    stops = np.concatenate([[0.0], found, before[-1:]])
    gaps = np.diff(stops)
    long = gaps > config.join_m
    longest = int(gaps.argmax())
    at = int(np.searchsorted(before[1:], stops[longest], side="right").clip(0, max(len(cell) - 1, 0)))
    close = used & (survey.distance_m <= config.assign_m)
    across, vertical = _parts(survey, cells, wire)
    return WireScore(
        name=wire.name or "",
        kind=wire.kind,
        scored_m=total,
        recall=recall,
        covered_share=float(1 - gaps[long].sum() / total) if total and len(found) else 0.0,
        longest_gap_m=float(gaps[longest]),
        longest_gap_from_m=float(wire.base.local(cells.start[cell[at]][None])[0, 0]) if len(cell) else 0.0,
        fragments=1 + int(long[1:-1].sum()) if len(found) else 0,
        vertical_rmse_m=_rmse(vertical[close], survey.weight[close]),
        horizontal_rmse_m=_rmse(across[close], survey.weight[close]),
        points=int(close.sum()),
    )


def _parts(
    survey: _Points, cells: _Cells, wire: Wire
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Each point's distance from the wire horizontally across it, and vertically: up or down to the wire.

    The part of an offset in the wire's vertical plane is perpendicular to the wire, which slopes.
    """
    across = survey.offset[:, :2] @ wire.base.n
    in_plane = np.sqrt(np.maximum(survey.distance_m**2 - across**2, 0.0))
    run = np.linalg.norm((cells.end - cells.start)[survey.cell, :2], axis=1) / cells.length_m[survey.cell]
    return across, in_plane / run


def _rmse(error: Float[np.ndarray, " n"], weight: Float[np.ndarray, " n"]) -> float | None:
    return float(np.sqrt(np.average(error**2, weights=weight))) if len(weight) else None


def _notes(points: Float[np.ndarray, "n 3"], survey: _Points, wires: tuple[WireScore, ...]) -> list[str]:
    notes = []
    if not len(points):
        notes.append("The survey holds no points, so all scores are 0.")
    elif not survey.counts.any():
        notes.append(
            "No point counts (all are near towers or stretches that are not scored): precision is 0."
        )
    if len(points) and survey.distance_m.min() > 10:
        notes.append(
            f"The point nearest to a true wire is {survey.distance_m.min():.0f} m away from it: is the "
            "survey in the world frame of the scene, in metres?"
        )
    unseen = [wire.name for wire in wires if not wire.scored_m]
    if unseen:
        notes.append(f"Not scored, being seen in too few images: {', '.join(unseen)}.")
    if len(survey.at) < len(points):
        notes.append(f"{len(points) - len(survey.at)} exact duplicates among the points were dropped.")
    return notes
