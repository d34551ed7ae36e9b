"""All wires, all images' pose residuals, the lighting and the wind, in one least-squares step.

    minimise  sum rho((B + A (g . dy + m . t_n) - k (n . l_w + c_wv)) / sigma)
              + sum |y_w - y_w0|^2 / trust_w^2 + that of t (`pose_prior.py`) + sum c_wv^2 / uneven^2
              + sum (phi_w - phi)^2 / own^2 + phi^2 / wind^2 + that of l + that of twins

over the curve theta of every wire w, through its places y across; the pose residual t_n of every image n; the
light l_w on every wire; and what else makes one of its edges brighter, c_wv, alike for all measurements of
one stretch from one direction v, so that no number of them outweighs it.

What a brighter edge does to a measurement is k (`profiles.py`), next to nothing where a wire is so wide that
its edges are seen: there they tell how bright they are, and with that k what thinner pictures of the wire,
from the same side, are shifted by.  Wires of one scene stand in the same light and are of like material:
l_w = l + what is its own.  They hang in the same wind, too: the swing phi_w of each is a common phi and what
is its own, for thin wires swing further than heavy ones.  Of a wire that sags by h, the swing is what it bows
aside, h sin phi, where all else in y is linear along the wire; where the views do not show that, as of a taut
wire, it stays near 0, and as uncertain as wind is.  Twins of a bundle are held apart by spacers: from what is
between them, y_w - y_x where there are both, its mean is taken, and what is left is near to 0.

Letters: w wires, n images and, beside l_w, a profile's normal, v directions times stretches, g and m a
measurement's derivatives by the wire's place and by the pose residual.  The unknowns come in the order theta,
t, l_w, l, phi.  The c are most of all unknowns, and no measurement depends on two of them: their part of the
normal equations is diagonal, and they are eliminated (Schur complement; Triggs et al. 2000, section 6.1).
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Float, Int

from plnerf.line.base import Base
from plnerf.line.curve import curve_by_theta
from plnerf.survey.refine.config import AdjustConfig
from plnerf.survey.refine.pose_prior import MOVED, TURNED
from plnerf.survey.refine.prior_matrix import prior_matrix
from plnerf.survey.refine.profiles import ProfileMeasurements
from plnerf.survey.refine.projection import MOVES
from plnerf.survey.refine.unknowns import FREE, Layout, Light, Prior, State


@dataclass(frozen=True, eq=False)
class Step:
    """The next state, and how well it is known."""

    state: State
    covariance: Float[np.ndarray, "p p"]
    """Of the unknowns theta, t, l_w, l and phi, from the normal equations."""
    spread: Float[np.ndarray, "p p"]
    """The same by how much the images differ from one another: measurements of one image share errors."""
    displaced: Float[np.ndarray, "w 6 6"]
    """Covariance of each wire's theta where every view of every stretch, that is all images of one direction,
    shows its wire displaced by one pixel, standard deviation, and each by its own."""
    off_px: tuple[Float[np.ndarray, " _"], ...]
    """Of each wire, the distances of its visible measurements, as the state before this step has them."""
    s: tuple[Float[np.ndarray, " _"], ...]
    """Of each wire, where along it these are."""
    image: tuple[Int[np.ndarray, " _"], ...]
    """Of each wire, the images that they are of."""
    pixels_per_m: float
    """By which a wire is usually magnified."""

    def of_wire(self, w: int) -> Float[np.ndarray, "6 6"]:
        """The covariance of a wire's theta: in every direction the larger of the two."""
        own = slice(FREE * w, FREE * (w + 1))
        root = np.linalg.cholesky(self.covariance[own, own])
        # In coordinates in which the one is a unit sphere, the axes of the other.
        inverse = np.linalg.inv(root)
        larger, axes = np.linalg.eigh(inverse @ self.spread[own, own] @ inverse.T)
        along = root @ axes * np.sqrt(np.maximum(larger, 1.0))
        return along @ along.T

    def light(self) -> Light:
        """That in which the wires are found to stand."""
        at = Layout(len(self.state.theta), len(self.state.pose))
        variance = self.covariance.diagonal()[at.common : at.common_swing]
        return Light(self.state.common_shading, np.sqrt(variance))

    def of_poses(self) -> Float[np.ndarray, "q q"]:
        """The covariance of all pose residuals."""
        first = FREE * len(self.state.theta)
        both = slice(first, first + self.state.pose.size)
        return self.covariance[both, both]

    def pose_residual_px(self) -> float:
        """Standard deviation of what the images' poses are off by, for a wire at the usual distance: what
        their residuals are, and what is not known of them."""
        squares = self.state.pose**2 + self.of_poses().diagonal().reshape(-1, MOVES)
        turned, moved = (float(squares[:, two].mean()) for two in (TURNED, MOVED))
        return float(np.sqrt(turned + moved))


def adjust(
    base: Base,
    state: State,
    prior: Prior,
    found: Sequence[Sequence[ProfileMeasurements]],
    config: AdjustConfig,
) -> Step:
    """One Gauss-Newton step.  found: for each image, the measurements of each wire."""
    W, N = len(state.theta), len(state.pose)
    at = Layout(W, N)
    H, scores = np.zeros((at.size, at.size)), np.zeros((N, at.size))
    known = 1 / config.uneven_grey**2
    coupling, of_bias = np.zeros((at.size, W, config.views)), np.full((W, config.views), known)
    shifted, shifted_bias = np.zeros((at.size, W, config.views)), np.zeros((W, config.views))
    bias_scores = np.zeros((N, W, config.views))
    size, visible_of = [], []
    for w in range(W):
        one, image = _visible([row[w] for row in found], config.visible)
        view = _by_view(base, one, config)
        by_bias, by_shift = -one.by_slope[:, None] * view, one.A[:, None] * view
        towards = one.by_yz / np.linalg.norm(one.by_yz, axis=1, keepdims=True)
        by_shading = -one.by_slope[:, None] * towards
        off = -by_bias @ state.bias[w] - by_shading @ state.shading[w] - one.B
        visible_of.append((off / one.A, one.s, image))
        if not len(one):
            continue
        size.append(float(np.median(np.linalg.norm(one.by_yz, axis=1))))
        by_theta = np.einsum("ki,kij->kj", one.by_yz, curve_by_theta(state.theta[w], base.length_m, one.s))
        moving = one.A[:, None] * np.concatenate([by_theta, one.by_pose], 1)
        columns = np.concatenate([moving, by_shading], 1)
        apart = off / np.sqrt(one.variance_B)
        scale = max(1.4826 * float(np.median(np.abs(apart))), 0.3)
        weight = 1 / (1 + (apart / (config.robust * scale)) ** 2) / (one.variance_B * scale**2)
        of_bias[w] += weight @ by_bias**2
        shifted_bias[w] = weight @ (by_bias * by_shift)
        for n in np.unique(image).tolist():
            mine, own = image == n, at.columns(w, n)
            weighted = columns[mine] * weight[mine, None]
            H[np.ix_(own, own)] += weighted.T @ columns[mine]
            coupling[own, w] += weighted.T @ by_bias[mine]
            shifted[own, w] += weighted.T @ by_shift[mine]
            scores[n, own] += weighted.T @ off[mine]
            bias_scores[n, w] += (weight[mine] * off[mine]) @ by_bias[mine]
    P, pull = prior_matrix(base, state, prior, config)
    coupled = coupling.reshape(at.size, -1)
    eliminated = coupled / of_bias.ravel()
    covariance = np.linalg.inv(H + P - eliminated @ coupled.T)
    bias_pull = bias_scores.sum(0) - known * state.bias
    change = covariance @ (scores.sum(0) + pull - eliminated @ bias_pull.ravel())
    # Images as independent draws, in place of measurements as such ("sandwich" by clusters).
    draws = scores - bias_scores.reshape(N, -1) @ eliminated.T
    drawn = draws.T @ draws * N / max(N - 5, 1) + P + known * eliminated @ eliminated.T
    by_shifts = covariance @ (shifted.reshape(at.size, -1) - eliminated * shifted_bias.ravel())
    of_wires = by_shifts[: at.pose].reshape(W, FREE, -1)
    after = State(
        state.theta + change[: at.pose].reshape(W, FREE),
        state.pose + change[at.pose : at.shading].reshape(N, MOVES),
        state.bias + (bias_pull - (change @ coupled).reshape(W, -1)) / of_bias,
        state.shading + change[at.shading : at.common].reshape(W, 2),
        state.common_shading + change[at.common : at.common_swing],
        state.common_swing + float(change[at.common_swing]),
    )
    off_px, s, images = zip(*visible_of, strict=True)
    spread = covariance @ drawn @ covariance
    displaced = of_wires @ of_wires.transpose(0, 2, 1)
    pixels_per_m = float(np.median(size)) if size else 1.0
    return Step(after, covariance, spread, displaced, off_px, s, images, pixels_per_m)


def _visible(
    rows: Sequence[ProfileMeasurements], least: float
) -> tuple[ProfileMeasurements, Int[np.ndarray, " k"]]:
    """The measurements of one wire in all images at which it stands out, and the images they are of."""
    parts = [one.name for one in fields(ProfileMeasurements)]
    one = ProfileMeasurements(*(np.concatenate([getattr(row, name) for row in rows]) for name in parts))
    image = np.repeat(np.arange(len(rows)), [len(row) for row in rows])
    visible = np.abs(one.A) > least * np.sqrt(one.variance_A)
    return one.only(visible), image[visible]


def _by_view(base: Base, one: ProfileMeasurements, config: AdjustConfig) -> Float[np.ndarray, "k v"]:
    """1 in the column of a measurement's direction of view and stretch."""
    turns = np.arctan2(one.by_yz[:, 1], one.by_yz[:, 0]) / (2 * np.pi) % 1.0
    direction = np.minimum((turns * config.directions).astype(int), config.directions - 1)
    stretch = np.minimum((one.s / base.length_m * config.stretches).astype(int), config.stretches - 1)
    by = np.zeros((len(one), config.views))
    by[np.arange(len(one)), direction * config.stretches + stretch] = 1
    return by
