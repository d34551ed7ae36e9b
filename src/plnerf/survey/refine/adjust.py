"""All wires, all images' motions and the light, in one least-squares step.

    minimise  sum rho((B + A (g . dy + motion . t_n + c_wv) + |g| g . l_w) / sigma)
              + sum |y_w - y_w0|^2 / trust_w^2 + sum |t_n|^2 / sd^2 + sum c_wv^2 / bias^2 + light's

over the catenary q of every wire w, through its places y across; the motion t_n of every image n, which
stands for what its pose is off by; the light l_w on every wire; and what all else shifts a wire by, c_wv,
alike for all sightings of one stretch from one direction v, so that no number of them outweighs it.

Of a lit cylinder, the first moment of its profile grows with the radius squared and with the component of the
light along the profile (Lambert's law, integrated over the side that is seen): so with |g| g . l, two numbers
for all views, before whatever background.  Wires of one scene stand in the same light and are of like
material: l_w = l + what is its own.

Letters: w wires, n images, k sightings, v directions times stretches; the unknowns come in the order q, t,
c, l_w, l.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Float

from plnerf.survey.fit import Base
from plnerf.survey.refine.profile import Sightings

VISIBLE = 3.0
"""A sighting counts where a wire stands out by so many standard deviations."""
ROBUST = 2.5
"""Standard deviations beyond which a sighting loses its weight (Cauchy): another thing is seen there."""
LIGHT = 0.1
"""Standard deviation of the place of what is seen of a wire of usual strength, as a share of its diameter."""
OWN_LIGHT = 0.3
"""Of what is a wire's own in that, as a share of it."""
BIAS_PX = 0.15
"""Standard deviation of what else shifts a wire: the light beyond first order, what lies behind it."""
DIRECTIONS, STRETCHES = 9, 4
"""Around a wire, of 20 degrees each, and along it."""
PLACES = 10
"""At which a wire is held to where it was."""
VIEWS = DIRECTIONS * STRETCHES


@dataclass(frozen=True, eq=False)
class State:
    """What is sought."""

    q: Float[np.ndarray, "w 5"]
    motion: Float[np.ndarray, "n 3"]
    bias: Float[np.ndarray, "w v"]
    light: Float[np.ndarray, "w 2"]
    common_light: Float[np.ndarray, "2"]


@dataclass(frozen=True, eq=False)
class Prior:
    """What is known before."""

    q: Float[np.ndarray, "w 5"]
    trust: Float[np.ndarray, " w"]
    """Standard deviation of a wire's place."""
    diameter: float
    motion_px: float
    """Standard deviation of an image's motion."""


@dataclass(frozen=True, eq=False)
class Step:
    """The next state, and how well it is known."""

    state: State
    covariance: Float[np.ndarray, "p p"]
    """Of all unknowns, from their normal equations."""
    spread: Float[np.ndarray, "p p"]
    """The same by how much the images differ from one another: sightings of one image share their errors."""
    usable: tuple[Float[np.ndarray, " _"], ...]
    """Of each wire, the distances e of its visible sightings (px), as this state has them."""

    pixels_per_unit: float
    """By which a wire is usually magnified."""

    def of_wire(self, w: int) -> Float[np.ndarray, "5 5"]:
        """The covariance of a wire's q: the larger of the two."""
        own = slice(5 * w, 5 * w + 5)
        a, b = self.covariance[own, own], self.spread[own, own]
        return a if np.trace(a) > np.trace(b) else b

    def motion_px(self) -> float:
        """Standard deviation of the images' motions, by what they are and by what is not known of them."""
        W, N = len(self.state.q), len(self.state.motion)
        unknown = np.diag(self.covariance)[5 * W : 5 * W + 3 * N].reshape(N, 3)[:, :2]
        return float(np.sqrt((self.state.motion[:, :2] ** 2 + unknown).mean()))


def adjust(base: Base, state: State, prior: Prior, found: Sequence[Sequence[Sightings]]) -> Step:
    """One Gauss-Newton step.  found: for each image, the sightings of each wire."""
    W, N = len(state.q), len(state.motion)
    first_motion, first_bias = 5 * W, 5 * W + 3 * N
    first_light = first_bias + W * VIEWS
    common = first_light + 2 * W
    H, b = np.zeros((common + 2, common + 2)), np.zeros(common + 2)
    scores, strength, size, usable = np.zeros((N, common + 2)), [], [], []
    for w in range(W):
        rows = [row[w] for row in found]
        one, image = _joined(rows), np.repeat(np.arange(N), [len(row) for row in rows])
        visible = np.abs(one.A) > VISIBLE * np.sqrt(one.variance_A)
        one, image = Sightings(*(getattr(one, part.name)[visible] for part in fields(one))), image[visible]
        magnification = np.linalg.norm(one.g, axis=1)
        shade = magnification[:, None] * one.g
        seen_from = _by_view(base, one)
        off = -one.B - shade @ state.light[w] - one.A * (seen_from @ state.bias[w])
        usable.append(off / one.A)
        if not len(one):
            continue
        strength.append(float(np.median(np.abs(one.A))))
        size.append(float(np.median(magnification)))
        by_q = np.einsum("ki,kij->kj", one.g, base.by_q(state.q[w], one.s))
        moving = one.A[:, None] * np.concatenate([by_q, one.motion, seen_from], 1)
        columns = np.concatenate([moving, shade], 1)
        apart = off / np.sqrt(one.variance_B)
        scale = max(1.4826 * float(np.median(np.abs(apart))), 0.3)
        weight = 1 / (1 + (apart / (ROBUST * scale)) ** 2) / (one.variance_B * scale**2)
        for n in np.unique(image):
            mine = image == n
            at = np.concatenate([
                5 * w + np.arange(5),
                first_motion + 3 * n + np.arange(3),
                first_bias + VIEWS * w + np.arange(VIEWS),
                first_light + 2 * w + np.arange(2),
            ])
            weighted = columns[mine] * weight[mine, None]
            H[np.ix_(at, at)] += weighted.T @ columns[mine]
            score = weighted.T @ off[mine]
            b[at] += score
            scores[n, at] += score
    # A shift by a tenth of the diameter D: A |g| D / 10 = |g|^2 l.
    magnified = float(np.median(size)) if size else 1.0
    light = LIGHT * prior.diameter * float(np.median(strength)) / magnified if strength else 1.0
    P, pull = _prior(base, state, prior, light)
    covariance = np.linalg.inv(H + P)
    change = covariance @ (b + pull)
    # Images as independent draws, in place of sightings as such ("sandwich" by clusters).
    spread = covariance @ (scores.T @ scores * N / max(N - 5, 1) + P) @ covariance
    after = State(
        state.q + change[:first_motion].reshape(W, 5),
        state.motion + change[first_motion:first_bias].reshape(N, 3),
        state.bias + change[first_bias:first_light].reshape(W, VIEWS),
        state.light + change[first_light:common].reshape(W, 2),
        state.common_light + change[common:],
    )
    return Step(after, covariance, spread, tuple(usable), magnified)


def _prior(
    base: Base, state: State, prior: Prior, light: float
) -> tuple[Float[np.ndarray, "p p"], Float[np.ndarray, " p"]]:
    """Its normal matrix, and where it pulls.  light: standard deviation of the light."""
    W, N = len(state.q), len(state.motion)
    first_motion, first_bias = 5 * W, 5 * W + 3 * N
    first_light = first_bias + W * VIEWS
    common = first_light + 2 * W
    P, pull = np.zeros((common + 2, common + 2)), np.zeros(common + 2)
    s = np.linspace(0, base.length_m, PLACES)
    for w in range(W):
        own = slice(5 * w, 5 * w + 5)
        J = base.by_q(state.q[w], s).reshape(-1, 5) / (prior.trust[w] * np.sqrt(PLACES))
        P[own, own] = J.T @ J
        pull[own] = J.T @ (base.at(prior.q[w], s) - base.at(state.q[w], s)).ravel() / (
            prior.trust[w] * np.sqrt(PLACES)
        )
    bias = np.arange(first_bias, first_light)
    P[bias, bias] = 1 / BIAS_PX**2
    pull[bias] = -state.bias.ravel() / BIAS_PX**2
    motion = np.arange(first_motion, first_bias)
    P[motion, motion] = 1 / prior.motion_px**2
    pull[motion] = -state.motion.ravel() / prior.motion_px**2
    tie = 1 / (OWN_LIGHT * light) ** 2
    for k in range(2):
        own_light = first_light + 2 * np.arange(W) + k
        P[own_light, own_light] = tie
        P[own_light, common + k] = P[common + k, own_light] = -tie
        P[common + k, common + k] = 1 / light**2 + W * tie
    pull[first_light:] = -P[first_light:, first_light:] @ np.append(state.light, state.common_light)
    return P, pull


def _by_view(base: Base, one: Sightings) -> Float[np.ndarray, "k v"]:
    """1 in the column of a sighting's direction and stretch."""
    angle = np.arctan2(one.g[:, 1], one.g[:, 0]) % np.pi
    direction = np.minimum((angle / np.pi * DIRECTIONS).astype(int), DIRECTIONS - 1)
    stretch = np.minimum((one.s / base.length_m * STRETCHES).astype(int), STRETCHES - 1)
    by = np.zeros((len(one), VIEWS))
    by[np.arange(len(one)), direction * STRETCHES + stretch] = 1
    return by


def _joined(rows: Sequence[Sightings]) -> Sightings:
    """Those of all images, one after another."""
    return Sightings(*(np.concatenate([getattr(row, one.name) for row in rows]) for one in fields(Sightings)))
