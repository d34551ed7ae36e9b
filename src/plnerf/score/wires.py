"""How far a survey's conductors are from the true wires, and whether they are as certain as they say.

Letters: w true wires, c conductors of the survey, k places along a conductor; s, y and z as in a conductor's
`Base`: along it, across to the left, and up.  World frame, metres.

Wires and conductors are matched one to one, so that the distances of all matches together are least.  What is
left over is a missing wire, one that was found again, or an invention.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.optimize import linear_sum_assignment

from plnerf.errors import SurveyError
from plnerf.report.data import TWO_SIDED_95
from plnerf.score.points import ASSIGN_M
from plnerf.score.truth import TrueWire
from plnerf.survey.fit import Base
from plnerf.survey.model import Conductor

PLACE_M = 0.1
"""Between the places that are compared, or less."""
END_M = 0.3
"""Cut off either end of the common stretch: clamps and insulators are there."""
LEAST_COMMON_M = 2.0
"""Of a wire and a conductor; along less than this, neither says anything of the other."""

RULES = {
    "match": f"a true wire and a conductor that share a stretch of {LEAST_COMMON_M:g} m or more, with a "
    f"root mean square distance of {ASSIGN_M:g} m or less there; one to one, with the least sum of "
    "distances; each wire of a bundle is a wire",
    "again": "a conductor that is left over, but runs along a wire as a match does; a second piece of a wire "
    "is one too",
    "invented": "a conductor that runs along no true wire",
    "compared": f"the common stretch without {END_M:g} m at either end, every {PLACE_M:g} m or less, at the "
    "same place along the conductor: horizontally across it, and up",
    "sag": "the greatest drop below the chord between the ends of each; a true wire's are its attachments",
    "sag_common": "the same between the ends of the common stretch: what is wrong of the sag where the ends "
    "are not",
    "within_95": f"the true value lies within {TWO_SIDED_95} stated standard deviations; of places along a "
    "wire the share. Their errors are much alike all along it, so that of few wires it is hardly ever 95 %",
}


@dataclass(frozen=True)
class Match:
    """One true wire and the conductor that is it."""

    wire: str
    conductor: int
    """Its id."""
    kind: str
    kind_found: str
    sag_m: float
    sag_found_m: float
    sag_sigma_m: float
    """As stated."""
    sag_common_m: float
    """Of the true wire, between the ends of the common stretch."""
    sag_common_found_m: float
    span_m: float
    span_found_m: float
    common_m: float
    """Length of the common stretch, horizontally."""
    rmse_across_m: float
    rmse_up_m: float
    worst_m: float
    """Greatest distance at a place, of both parts together."""
    within_95_across: float
    within_95_up: float

    @property
    def sag_error_m(self) -> float:
        return self.sag_found_m - self.sag_m

    @property
    def sag_common_error_m(self) -> float:
        return self.sag_common_found_m - self.sag_common_m

    @property
    def sag_within_95(self) -> bool:
        return abs(self.sag_error_m) <= TWO_SIDED_95 * self.sag_sigma_m

    @property
    def kind_right(self) -> bool:
        return self.kind == self.kind_found


@dataclass(frozen=True)
class ConductorScore:
    """Of all wires and conductors."""

    matches: tuple[Match, ...]
    """In the order of the true wires."""
    missing: tuple[str, ...]
    """Names of true wires that images show, but the survey does not have."""
    unseen: tuple[str, ...]
    """Those that it does not have, and too few images show: they count as neither."""
    again: tuple[tuple[int, str], ...]
    """Conductors that are left over, and the wire each runs along."""
    invented: tuple[int, ...]

    def share_within_95(self, name: str) -> float | None:
        """Of sags, or of places across or up, the share within what is stated; None without matches."""
        if not self.matches:
            return None
        if name == "sag":
            return float(np.mean([match.sag_within_95 for match in self.matches]))
        shares = [getattr(match, f"within_95_{name}") for match in self.matches]
        return float(np.average(shares, weights=[match.common_m for match in self.matches]))


@dataclass(frozen=True, eq=False)
class Common:
    """The stretch that a true wire and a conductor share."""

    s: Float[np.ndarray, " k"]
    """Places from one of its ends to the other."""
    true: Float[np.ndarray, "k 2"]
    """y and z of the true wire."""
    off: Float[np.ndarray, "k 2"]
    """y and z of the conductor without those of the true wire."""

    @property
    def sags_m(self) -> tuple[float, float]:
        """Between its ends, of the true wire and of the conductor."""
        share = np.linspace(0.0, 1.0, len(self.s))
        sags = [z[0] + share * (z[-1] - z[0]) - z for z in (self.true[:, 1], (self.true + self.off)[:, 1])]
        return float(sags[0].max()), float(sags[1].max())

    @property
    def inner(self) -> slice:
        """The places that are compared."""
        cut = int(np.ceil(END_M / (self.s[1] - self.s[0]) - 1e-9))
        return slice(cut, len(self.s) - cut)

    @property
    def rms_m(self) -> float:
        """Of the distances at the compared places."""
        return float(np.sqrt((self.off[self.inner] ** 2).sum(1).mean()))


def common_stretch(wire: TrueWire, conductor: Conductor) -> Common | None:
    """None where they share less than `LEAST_COMMON_M`, or the wire turns back on the conductor's base."""
    base = conductor.fit.base
    local = _along(wire, base)
    low, high = max(0.0, float(local[0, 0])), min(base.length_m, float(local[-1, 0]))
    if high - low < LEAST_COMMON_M or (np.diff(local[:, 0]) <= 0).any():
        return None
    s = np.linspace(low, high, int(np.ceil((high - low) / PLACE_M)) + 1)
    true = np.stack([np.interp(s, local[:, 0], local[:, axis]) for axis in (1, 2)], 1)
    return Common(s, true, base.at(conductor.fit.q, s) - true)


def _along(wire: TrueWire, base: Base) -> Float[np.ndarray, "v 3"]:
    """s, y and z of the wire's vertices, from the end with the lesser s on."""
    local = base.local(wire.polyline)
    return local if local[-1, 0] >= local[0, 0] else local[::-1]


def score_conductors(conductors: Sequence[Conductor], wires: Sequence[TrueWire]) -> ConductorScore:
    """Compares; `RULES` says how in words.

    Raises SurveyError where every conductor is farther from every wire than the wires are long: then they are
    in another frame.
    """
    check_frame(conductors, wires)
    common = [[common_stretch(wire, one) for one in conductors] for wire in wires]
    # Costs of what is no match exceed those of all matches together, so that none is given up for it.
    none = (len(wires) + len(conductors) + 1) * ASSIGN_M
    distance = np.full((len(wires), len(conductors)), none)
    for i, row in enumerate(common):
        for j, shared in enumerate(row):
            if shared is not None and shared.rms_m <= ASSIGN_M:
                distance[i, j] = shared.rms_m
    pairs = [(int(i), int(j)) for i, j in zip(*linear_sum_assignment(distance), strict=True)]
    pairs = [(i, j) for i, j in pairs if distance[i, j] < none]
    left = set(range(len(conductors))) - {j for _, j in pairs}
    again = {j: int(distance[:, j].argmin()) for j in left if distance[:, j].min() < none}
    lost = [wire for i, wire in enumerate(wires) if i not in {i for i, _ in pairs}]
    return ConductorScore(
        matches=tuple(_match(wires[i], conductors[j]) for i, j in sorted(pairs)),
        missing=tuple(wire.name for wire in lost if _seen(wire)),
        unseen=tuple(wire.name for wire in lost if not _seen(wire)),
        again=tuple((conductors[j].id, wires[i].name) for j, i in sorted(again.items())),
        invented=tuple(conductors[j].id for j in sorted(left - again.keys())),
    )


def check_frame(conductors: Sequence[Conductor], wires: Sequence[TrueWire]) -> None:
    """Raises SurveyError where conductors and wires cannot be in one frame."""
    if not conductors:
        return
    true = np.concatenate([wire.polyline for wire in wires])
    found = np.array([end for one in conductors for end in (one.fit.curve.a, one.fit.curve.b)])
    nearest = float(np.linalg.norm(found[:, None] - true, axis=2).min())
    longest = max(wire.span_m for wire in wires)
    if nearest > longest:
        raise SurveyError(
            f"The end of a conductor that is nearest to a true wire is {nearest:,.0f} m away from it, but "
            f"the longest of these wires is {longest:.0f} m: the survey is not in the truth's frame. Compare "
            "surveys in the world frame of the truth's scene, or of the same images with --by-cameras."
        )


def _seen(wire: TrueWire) -> bool:
    return wire.seen_m is None or any(high > low for low, high in wire.seen_m)


def _match(wire: TrueWire, conductor: Conductor) -> Match:
    shared = common_stretch(wire, conductor)
    assert shared is not None  # they were matched by it
    off = shared.off[shared.inner]
    stated = TWO_SIDED_95 * conductor.fit.sigma_at(shared.s[shared.inner])
    within = (np.abs(off) <= stated).mean(0)
    rmse = np.sqrt((off**2).mean(0))
    sag, sag_found = shared.sags_m
    curve = conductor.fit.curve
    return Match(
        wire=wire.name,
        conductor=conductor.id,
        kind=wire.kind,
        kind_found=conductor.kind,
        sag_m=wire.sag_m,
        sag_found_m=curve.sag_m,
        sag_sigma_m=conductor.fit.sag_sigma_m,
        sag_common_m=sag,
        sag_common_found_m=sag_found,
        span_m=wire.span_m,
        span_found_m=curve.span_m,
        common_m=float(shared.s[-1] - shared.s[0]),
        rmse_across_m=float(rmse[0]),
        rmse_up_m=float(rmse[1]),
        worst_m=float(np.hypot(off[:, 0], off[:, 1]).max()),
        within_95_across=float(within[0]),
        within_95_up=float(within[1]),
    )
