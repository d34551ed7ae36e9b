"""Where a structure holds conductors, from their curves alone: two adjacent spans' curves meet in a kink.

A conductor's attachment P lies on both of its curves.  Of each, the residual r of P is its distance in y and
z, of covariance C (the curve's at that place, and `misfit_m`): four equations for three unknowns,

    minimise  sum over both curves of r^T C^-1 r,      covariance of P = (sum J^T C^-1 J)^-1,  J = dr/dP

Where the line does not bend, a jump d of the slope gives an uncertainty along the line of sigma(z) / d; with
a bend, the curves in plan fix P as well.  Tension strings between the curves hang otherwise than these would
go on, yet in the same upright planes: where these fix P about as well by themselves, heights do not count.

All conductors of a structure are held at about one place t along the line (the axis between the directions of
both spans, so that crossarms lie across it), but each at its own, `arms_m` apart: t_k = t + N(0, arms_m).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from plnerf.line.base import Base
from plnerf.line.wire import Wire
from plnerf.survey.config_spans import KinkConfig
from plnerf.survey.span_wires import Junction, crossing, slope_at, slope_covariance

ROUNDS = 12
"""Gauss-Newton steps at most to where two smooth curves meet, which lie within decimetres at first."""
SETTLED_M = 1e-8
"""A step so small is the last."""
EXACT = 1e-9
"""Standard deviation of slopes that are stated as exact."""
LOOSE_M = 100.0
"""Standard deviation of P where the curves are parallel and say nothing of it."""


@dataclass(frozen=True, eq=False)
class Kink:
    """Where the two curves of one conductor meet."""

    pair: tuple[int, int]
    """The wire's index before and after."""
    point: Float[np.ndarray, "3"]
    covariance: Float[np.ndarray, "3 3"]
    gap_m: float
    """By how much the curves miss each other there."""
    drop: float
    """Slope before less slope after: above 0 where the structure holds the wire up."""
    unseen_m: float = 0.0
    """How far from there images show the nearer of its two wires; 0 where that is not known."""

    def along(self, axis: Base) -> tuple[float, float]:
        """t of the attachment along an axis, and its standard deviation."""
        u = np.append(axis.u, 0.0)
        return float((self.point[:2] - axis.a) @ axis.u), float(np.sqrt(u @ self.covariance @ u))


def find_kinks(junction: Junction, config: KinkConfig) -> tuple[Kink, ...]:
    """Those of the junction's conductors that show where they are held."""
    kinks = (_kink(junction, pair, config) for pair in junction.pairs)
    return tuple(kink for kink in kinks if kink is not None)


def _kink(junction: Junction, pair: tuple[int, int], config: KinkConfig) -> Kink | None:
    """Where two curves meet, by plan alone where that shows it about as well."""
    exact, in_plan = (_met(junction, pair, by, config) for by in (config.misfit_m, config.strings_m))
    if exact is None or in_plan is None:
        return exact
    sigma, of_plan = (one.along(junction.axis)[1] for one in (exact, in_plan))
    return in_plan if of_plan <= config.plan_share * sigma else exact


def _met(
    junction: Junction, pair: tuple[int, int], heights_m: float, config: KinkConfig
) -> Kink | None:
    """Where two curves meet; None where they do not, go on in one another, or turn upwards.

    heights_m: standard deviation of the heights, beside what the curves state.
    """
    both = [wires[k] for wires, k in zip(junction.sides, pair, strict=True)]
    start = np.mean([_at(wire, junction.axis, junction.meet_m) for wire in both], axis=0)
    misfits, point, normal = np.array([config.misfit_m, heights_m]), start, np.eye(3)
    for _ in range(ROUNDS):
        parts = [_equations(wire, point, misfits) for wire in both]
        normal = sum((J.T @ W @ J for _, J, W in parts), np.eye(3) / LOOSE_M**2)
        step = np.linalg.solve(normal, sum(J.T @ W @ r for r, J, W in parts))
        point = point - step
        if abs((point - start)[:2] @ junction.axis.u) > config.around_m:
            return None
        if np.abs(step).max() < SETTLED_M:
            break
    residuals = [(r, W) for r, _, W in (_equations(wire, point, misfits) for wire in both)]
    misses = float(sum(r @ W @ r for r, W in residuals))  # chi squared of one degree of freedom
    covariance = np.linalg.inv(normal) * (misses if misses > config.gap_sigmas**2 else 1.0)
    turn, spread = _turn(both[0], both[1], point)
    spread += EXACT**2 * np.eye(2)
    if turn @ turn < config.least_turn**2:
        return None
    if turn @ np.linalg.solve(spread, turn) < config.least_turn_sigmas**2:
        return None
    if turn[1] < -config.uplift_sigmas * np.sqrt(spread[1, 1]):
        return None
    gap = sum(float(np.linalg.norm(r)) for r, _ in residuals)
    return Kink(pair, point, covariance, gap, float(turn[1]), min(_unseen(wire, point) for wire in both))


def _unseen(wire: Wire, point: Float[np.ndarray, "3"]) -> float:
    """How far along a wire images show it from a point on its curve."""
    s = float(wire.base.local(point[None])[0, 0])
    stretches = wire.evidence.seen_m or ((s, s),)
    return min(max(low - s, s - high, 0.0) for low, high in stretches)


@dataclass(frozen=True, eq=False)
class Held:
    """Where a structure holds conductors along an axis, in metres."""

    t: float
    sigma: float
    own: dict[tuple[int, int], tuple[float, float]]
    """Of each pair of wires, its own t and the standard deviation of that."""
    agreeing: int
    """Conductors whose kinks agree."""


def held_by(
    kinks: tuple[Kink, ...], axis: Base, shown: tuple[float, float] | None, config: KinkConfig
) -> Held | None:
    """The common place of kinks, and of what else shows it if that is given; None where kinks show none.  A
    kink alone, by curves that images show on neither side near to it, shows none: two wrong ones may cross.

    Of each conductor: its own kink, weighed with where all others are held.
    """
    if not kinks:
        return None
    t, sigma = np.array([kink.along(axis) for kink in kinks]).T
    variance = sigma**2 + config.arms_m**2
    use = np.abs(t - _weighted_median(t, 1 / variance)) <= config.outlier_sigmas * np.sqrt(variance)
    alone = shown is None and use.sum() == 1
    if alone and kinks[int(use.argmax())].unseen_m > config.alone_unseen_m:
        return None
    mean, common = _mean(t[use], variance[use], shown, config)
    if common > config.most_sigma_m:
        return None
    own = {}
    for k, kink in enumerate(kinks):
        others = use & (np.arange(len(kinks)) != k)
        if not use[k]:
            own[kink.pair] = mean, float(np.hypot(common, config.arms_m))
        elif not others.any() and shown is None:
            own[kink.pair] = float(t[k]), float(sigma[k])
        else:
            there, of_those = _mean(t[others], variance[others], shown, config)
            weights = 1 / np.array([sigma[k] ** 2, of_those**2 + config.arms_m**2])
            place = float(weights @ [t[k], there] / weights.sum())
            own[kink.pair] = place, float(weights.sum() ** -0.5)
    return Held(mean, common, own, int(use.sum()))


def _mean(
    t: Float[np.ndarray, " k"],
    variance: Float[np.ndarray, " k"],
    shown: tuple[float, float] | None,
    config: KinkConfig,
) -> tuple[float, float]:
    """The weighted mean, with a deviation that grows where what is averaged scatters more than it states."""
    if shown is not None:
        t, variance = np.append(t, shown[0]), np.append(variance, shown[1] ** 2)
    weights = 1 / variance
    mean = float(weights @ t / weights.sum())
    scatter = weights @ (t - mean) ** 2 / max(len(t) - 1, 1)
    sigma = float(np.sqrt(max(scatter, 1.0) / weights.sum()))
    return mean, max(sigma, config.least_sigma_m)


def _weighted_median(values: Float[np.ndarray, " k"], weights: Float[np.ndarray, " k"]) -> float:
    order = values.argsort()
    share = weights[order].cumsum() / weights.sum()
    return float(values[order[np.searchsorted(share, 0.5)]])


def _at(wire: Wire, axis: Base, t: float) -> Float[np.ndarray, "3"]:
    point: Float[np.ndarray, 3] = wire.points(crossing(wire, axis, np.array([t])))[0]
    return point


def _equations(
    wire: Wire, point: Float[np.ndarray, "3"], misfits: Float[np.ndarray, "2"]
) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2 3"], Float[np.ndarray, "2 2"]]:
    """r, its derivatives by P, and the inverse of its covariance.

    misfits: standard deviations across and upwards of what that of the curve leaves out.
    """
    s, *yz = wire.base.local(point[None])[0]
    r = np.array(yz) - wire.at(np.array([s]))[0]
    slope_y, slope_z = slope_at(wire, s)
    u, n = np.append(wire.base.u, 0.0), np.append(wire.base.n, 0.0)
    by_theta = wire.by_theta(np.array([s]))[0]
    C = by_theta @ wire.covariance @ by_theta.T + np.diag(misfits**2)
    J = np.stack([n - slope_y * u, np.array([0.0, 0.0, 1.0]) - slope_z * u])
    return r, J, np.linalg.inv(C)


def _turn(
    before: Wire, after: Wire, point: Float[np.ndarray, "3"]
) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2 2"]]:
    """By how much a wire turns, in plan to its right and downwards, as slopes; and their covariance."""
    found, spread = [], np.zeros((2, 2))
    for wire in (before, after):
        s = float(wire.base.local(point[None])[0, 0])
        slope = slope_at(wire, s)
        heading = np.arctan2(wire.base.u[1], wire.base.u[0]) + np.arctan(slope[0])
        found.append((heading, slope[1]))
        spread += slope_covariance(wire, s)
    sideways = (found[0][0] - found[1][0] + np.pi) % (2 * np.pi) - np.pi
    return np.array([sideways, found[0][1] - found[1][1]]), spread
