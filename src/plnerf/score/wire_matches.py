"""How far a survey's wires are from the true ones, and whether they are as certain as they state.

Letters: k places along a wire; s, y and z as in the base of the survey's wire: along it, across to the left,
and up.  Metres; both in one frame.

True and found wires are matched one to one, so that the distances of all matches together are least.  What is
left over is a missing wire, one that was found again, or an invention.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree

from plnerf.errors import SurveyError
from plnerf.line.ends import TWO_SIDED_95, Attached
from plnerf.line.polylines import require_samples
from plnerf.line.wire import Wire
from plnerf.score.config import DEFAULT, WireScoreConfig


def rules(config: WireScoreConfig) -> dict[str, str]:
    """What the figures of a score mean, in words."""
    return {
        "match": "a true wire and a conductor of the survey that share a stretch of "
        f"{config.least_common_m:g} m or more and {config.least_share:g} of the shorter of both, with a root "
        f"mean square distance of {config.match_m:g} m or less there; one to one, with the least sum of "
        "distances; each wire of a bundle is a wire",
        "again": "a conductor that is left over, but runs along a wire as a match does; a second piece of a "
        "wire is one too",
        "invented": "a conductor that runs along no true wire",
        "compared": f"the common stretch without {config.end_m:g} m at either end, every {config.place_m:g} "
        "m or less, at the same place along the conductor: horizontally across it, and up",
        "sag": "the greatest drop below the chord between the attachments of each; null where the survey "
        "states none, with its reason",
        "sag_common": "the same between the ends of the common stretch: what is wrong of the sag where the "
        "ends are not",
        "swing": "of the plane of a wire's curve from upright, to the left of the survey's wire; within_95 "
        "only where the survey states its deviation",
        "ends_off": "how far beyond the true attachment the survey's lies, along the wire; null where its "
        "end is open",
        "within_95": f"the true value lies within {TWO_SIDED_95} stated standard deviations; of places along "
        "a wire the share. Their errors are much alike all along it, so that of few wires it is hardly ever "
        "95 %",
    }


@dataclass(frozen=True)
class Match:
    """One true wire and the survey's wire that is it."""

    wire: str
    """Name of the true one."""
    conductor: int
    """Id of the survey's."""
    kind: str
    kind_found: str
    sag_m: float
    sag_found_m: float | None
    """None where the survey states none, as its span length."""
    sag_sigma_m: float | None
    """As stated."""
    no_sag_because: str | None
    """Why the survey states none."""
    sag_common_m: float
    """Of the true wire, between the ends of the common stretch."""
    sag_common_found_m: float
    span_m: float
    span_found_m: float | None
    common_m: float
    """Length of the common stretch, horizontally."""
    rmse_across_m: float
    rmse_up_m: float
    worst_m: float
    """Greatest distance at a place, of both parts together."""
    within_95_across: float
    within_95_up: float
    swing_deg: float
    """Of the true wire, to the left of the found wire's base."""
    swing_found_deg: float
    swing_sigma_deg: float | None
    """As stated; None: the swing was not measured."""
    ends_off_m: tuple[float | None, float | None]
    """How far the survey's attachments lie beyond the true ones, along the wire, at the first and the last
    end of the survey's wire; None where its end is open."""

    @property
    def swing_error_deg(self) -> float:
        """Found less true."""
        return self.swing_found_deg - self.swing_deg

    @property
    def swing_within_95(self) -> bool | None:
        """None where no swing is stated."""
        if self.swing_sigma_deg is None:
            return None
        return abs(self.swing_error_deg) <= TWO_SIDED_95 * self.swing_sigma_deg

    @property
    def sag_error_m(self) -> float | None:
        """Found less true; None where no sag is stated."""
        return None if self.sag_found_m is None else self.sag_found_m - self.sag_m

    @property
    def sag_common_error_m(self) -> float:
        """Found less true, between the ends of the common stretch."""
        return self.sag_common_found_m - self.sag_common_m

    @property
    def sag_within_95(self) -> bool | None:
        """None where no sag is stated."""
        if self.sag_error_m is None or self.sag_sigma_m is None:
            return None
        return abs(self.sag_error_m) <= TWO_SIDED_95 * self.sag_sigma_m

    @property
    def kind_right(self) -> bool:
        """Whether the survey has its kind."""
        return self.kind == self.kind_found


@dataclass(frozen=True)
class WireMatches:
    """Which true wires a survey has."""

    matches: tuple[Match, ...]
    """In the order of the true wires."""
    missing: tuple[str, ...]
    """Names of true wires that images show, but the survey does not have."""
    unseen: tuple[str, ...]
    """Those that it does not have, and too few images show: they count as neither."""
    again: tuple[tuple[int, str], ...]
    """Ids of the survey's wires that are left over, and the true wire that each runs along."""
    invented: tuple[int, ...]
    """Ids of those that run along none."""

    def share_within_95(self, name: str) -> float | None:
        """Of sags, or of places across or up, the share within what is stated; None without any."""
        if name == "sag":
            sags = [match.sag_within_95 for match in self.matches if match.sag_within_95 is not None]
            return float(np.mean(sags)) if sags else None
        if not self.matches:
            return None
        shares = [getattr(match, f"within_95_{name}") for match in self.matches]
        return float(np.average(shares, weights=[match.common_m for match in self.matches]))


@dataclass(frozen=True, eq=False)
class Common:
    """The stretch that a true wire and a survey's wire share."""

    s: Float[np.ndarray, " k"]
    """Places from one of its ends to the other."""
    true: Float[np.ndarray, "k 2"]
    """y and z of the true wire."""
    off: Float[np.ndarray, "k 2"]
    """y and z of the survey's wire less those of the true one."""
    inner: slice
    """The places that are compared."""

    @property
    def rms_m(self) -> float:
        """Of the distances at the compared places."""
        return float(np.sqrt((self.off[self.inner] ** 2).sum(1).mean()))


def common_stretch(true: Wire, found: Wire, config: WireScoreConfig) -> Common | None:
    """None where they share too little, or where the true wire turns back on the other's base."""
    return common_with(true.polyline(), found, config)


def common_with(line: Float[np.ndarray, "v 3"], found: Wire, config: WireScoreConfig) -> Common | None:
    """As `common_stretch`, of a true wire by its polyline."""
    base = found.base
    local = base.local(line)
    if local[-1, 0] < local[0, 0]:
        local = local[::-1]
    low, high = max(0.0, float(local[0, 0])), min(base.length_m, float(local[-1, 0]))
    shorter = min(base.length_m, float(local[-1, 0] - local[0, 0]))
    least = max(config.least_common_m, config.least_share * shorter)
    if high - low < least or (np.diff(local[:, 0]) <= 0).any():
        return None
    require_samples(high - low, config.place_m)
    s = np.linspace(low, high, int(np.ceil((high - low) / config.place_m)) + 1)
    yz = np.stack([np.interp(s, local[:, 0], local[:, axis]) for axis in (1, 2)], 1)
    cut = int(np.ceil(config.end_m / (s[1] - s[0]) - 1e-9))
    return Common(s, yz, found.at(s) - yz, slice(cut, len(s) - cut))


def match_wires(
    found: Sequence[Wire], true: Sequence[Wire], config: WireScoreConfig = DEFAULT.wires
) -> WireMatches:
    """Compares; `rules` states how.

    Raises SurveyError where every found wire is farther from every true one than these are long: then they
    are in another frame.
    """
    check_frame(found, true)
    lines = [wire.polyline() for wire in true]
    common = [[common_with(line, one, config) for one in found] for line in lines]
    # Costs of what is no match exceed those of all matches together, so that none is given up for it.
    none = (len(true) + len(found) + 1) * config.match_m
    distance = np.full((len(true), len(found)), none)
    for i, row in enumerate(common):
        for j, shared in enumerate(row):
            if shared is not None and shared.rms_m <= config.match_m:
                distance[i, j] = shared.rms_m
    pairs = [(int(i), int(j)) for i, j in zip(*linear_sum_assignment(distance), strict=True)]
    pairs = sorted((i, j) for i, j in pairs if distance[i, j] < none)
    left = set(range(len(found))) - {j for _, j in pairs}
    again = {j: int(distance[:, j].argmin()) for j in left if distance[:, j].min() < none}
    lost = [wire for i, wire in enumerate(true) if i not in {i for i, _ in pairs}]
    matches = []
    for i, j in pairs:
        shared = common[i][j]
        assert shared is not None  # they were matched by it
        matches.append(_match(true[i], found[j], shared))
    return WireMatches(
        matches=tuple(matches),
        missing=tuple(_name(wire) for wire in lost if _seen(wire)),
        unseen=tuple(_name(wire) for wire in lost if not _seen(wire)),
        again=tuple((found[j].id, _name(true[i])) for j, i in sorted(again.items())),
        invented=tuple(found[j].id for j in sorted(left - again.keys())),
    )


def check_frame(found: Sequence[Wire], true: Sequence[Wire]) -> None:
    """Raises SurveyError where found and true wires cannot be in one frame."""
    if not found:
        return
    on = np.concatenate([wire.polyline() for wire in true])
    ends = np.concatenate([one.points(np.array([0.0, one.base.length_m])) for one in found])
    nearest = float(cKDTree(on).query(ends)[0].min())
    longest = max(wire.base.length_m for wire in true)
    if nearest > longest:
        raise SurveyError(
            f"The end of a conductor that is nearest to a true wire is {nearest:,.0f} m away from it, but "
            f"the longest of these wires is {longest:.0f} m: the survey is not in the truth's frame. Compare "
            "surveys in the world frame of the truth's scene, or of the same images with --by-cameras."
        )


def _seen(wire: Wire) -> bool:
    stretches = wire.evidence.seen_m
    return stretches is None or any(high > low for low, high in stretches)


def _name(wire: Wire) -> str:
    return wire.name or f"wire {wire.id}"


def _match(true: Wire, found: Wire, shared: Common) -> Match:
    off = shared.off[shared.inner]
    stated = TWO_SIDED_95 * found.sigma_at(shared.s[shared.inner])
    within = (np.abs(off) <= stated).mean(0)
    rmse = np.sqrt((off**2).mean(0))
    low, high = float(shared.s[0]), float(shared.s[-1])
    ends = found.base.place(shared.s[[0, -1]], shared.true[[0, -1]])
    true_low, true_high = np.sort(true.base.local(ends)[:, 0]).tolist()
    assert true.sag is not None and true.span_m is not None  # attachments hold both of its ends
    sag, span = found.sag, found.span_m
    swing_sigma = math.sqrt(max(float(found.covariance[5, 5]), 0.0))
    return Match(
        wire=_name(true),
        conductor=found.id,
        kind=true.kind,
        kind_found=found.kind,
        sag_m=true.sag.value,
        sag_found_m=None if sag is None else sag.value,
        sag_sigma_m=None if sag is None else sag.sigma,
        no_sag_because=found.open,
        sag_common_m=true.drop_between(true_low, true_high),
        sag_common_found_m=found.drop_between(low, high),
        span_m=true.span_m.value,
        span_found_m=None if span is None else span.value,
        common_m=high - low,
        rmse_across_m=float(rmse[0]),
        rmse_up_m=float(rmse[1]),
        worst_m=float(np.hypot(off[:, 0], off[:, 1]).max()),
        within_95_across=float(within[0]),
        within_95_up=float(within[1]),
        swing_deg=math.degrees(true.swing_rad) * (1.0 if true.base.u @ found.base.u > 0 else -1.0),
        swing_found_deg=math.degrees(found.swing_rad),
        swing_sigma_deg=math.degrees(swing_sigma) if swing_sigma > 0 else None,
        ends_off_m=_ends_off(true, found),
    )


def _ends_off(true: Wire, found: Wire) -> tuple[float | None, float | None]:
    """Outwards positive, at the first and the last end of the found wire."""
    base, L = found.base, true.base.length_m
    attached = np.sort(base.local(true.points(np.array([0.0, L])))[:, 0])
    first, last = found.ends
    return (
        float(attached[0] - base.local(first.point[None])[0, 0]) if isinstance(first, Attached) else None,
        float(base.local(last.point[None])[0, 0] - attached[1]) if isinstance(last, Attached) else None,
    )
