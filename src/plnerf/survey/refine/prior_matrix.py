"""What pulls the unknowns of the refit to what is known of them before.

Letters: p unknowns, in the order of `Layout`.
"""

import numpy as np
from jaxtyping import Float

from plnerf.line.base import Base
from plnerf.line.curve import curve_at, curve_by_theta
from plnerf.survey.refine.config import AdjustConfig
from plnerf.survey.refine.unknowns import FREE, SWING, Layout, Light, Prior, State


def prior_matrix(
    base: Base, state: State, prior: Prior, config: AdjustConfig
) -> tuple[Float[np.ndarray, "p p"], Float[np.ndarray, " p"]]:
    """Its normal matrix, and where it pulls; that of the c is diagonal."""
    W, N = len(state.theta), len(state.pose)
    at = Layout(W, N)
    P, pull = np.zeros((at.size, at.size)), np.zeros(at.size)
    L, places = base.length_m, config.prior_places
    s = np.linspace(0, L, places)
    for w in range(W):
        own = slice(FREE * w, FREE * (w + 1))
        held = prior.trust_m[w] * np.sqrt(places)
        J = curve_by_theta(state.theta[w], L, s).reshape(-1, FREE) / held
        P[own, own] = J.T @ J
        pull[own] = J.T @ (curve_at(prior.theta[w], L, s) - curve_at(state.theta[w], L, s)).ravel() / held
    for pair in prior.twins:
        (w, x), beside = (pair.one, pair.other), np.linspace(pair.from_m, pair.to_m, places)
        both = np.concatenate([FREE * w + np.arange(FREE), FREE * x + np.arange(FREE)])
        between = curve_at(state.theta[w], L, beside) - curve_at(state.theta[x], L, beside)
        by_one, by_other = (curve_by_theta(state.theta[k], L, beside) for k in (w, x))
        by_both = np.concatenate([by_one, -by_other], axis=2)
        held = config.twins_m * np.sqrt(places)
        J = (by_both - by_both.mean(0)).reshape(-1, 2 * FREE) / held
        P[np.ix_(both, both)] += J.T @ J
        pull[both] -= J.T @ (between - between.mean(0)).ravel() / held
    pose = slice(at.pose, at.shading)
    P[pose, pose] = prior.poses.precision(N)
    pull[pose] = -P[pose, pose] @ state.pose.ravel()
    tie = 1 / (config.own_shading * config.shading_grey) ** 2
    light = prior.light or Light(np.zeros(2), np.full(2, config.shading_grey))
    for k in range(2):
        own_shading = at.shading + 2 * np.arange(W) + k
        P[own_shading, own_shading] = tie
        P[own_shading, at.common + k] = P[at.common + k, own_shading] = -tie
        P[at.common + k, at.common + k] = 1 / light.sigma[k] ** 2 + W * tie
    lighting = np.append(state.shading, state.common_shading)
    lit = slice(at.shading, at.common_swing)
    pull[lit] = -P[lit, lit] @ lighting
    pull[at.common : at.common_swing] += light.shading / light.sigma**2
    swings = np.append(FREE * np.arange(W) + SWING, at.common_swing)
    own, wind = np.radians(config.own_swing_deg) ** -2, np.radians(config.swing_deg) ** -2
    wanted = own * np.eye(W + 1)
    wanted[-1, :-1] = wanted[:-1, -1] = -own
    wanted[-1, -1] = wind + W * own
    P[np.ix_(swings, swings)] += wanted
    pull[swings] -= wanted @ np.append(state.theta[:, SWING], state.common_swing)
    return P, pull
