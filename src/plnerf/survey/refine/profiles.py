"""What the grey values across a wire's projected curve say of where the wire is.

    grey(d) = background + A K(d) + B K'(d) + the same of other wires that cross here

Letters: d distance from the curve along its normal (px), K a Gaussian as wide as the blurred wire, k samples
along the wire.  A, the wire's strength, is what it adds to the background, so negative before the sky.  A
wire that lies at e shows as A K(d - e), and one with light on one side adds M K'(d) with M by the light, so

    B = -(A e + M)

to first order.  No ridge is looked for and nothing is divided: where a wire does not stand out, A and what B
says of e are near 0.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32

from plnerf.survey.refine.config import ProfileConfig
from plnerf.survey.refine.projection import Projection, crossings


@dataclass(frozen=True, eq=False)
class ProfileMeasurements:
    """Of one wire in one image, at k places along it."""

    s: Float[np.ndarray, " k"]
    by_yz: Float[np.ndarray, "k 2"]
    by_pose: Float[np.ndarray, "k 3"]
    """As `Projection` has them."""
    A: Float[np.ndarray, " k"]
    B: Float[np.ndarray, " k"]
    variance_A: Float[np.ndarray, " k"]
    variance_B: Float[np.ndarray, " k"]
    """From how well the model describes each profile."""

    def __len__(self) -> int:
        return len(self.s)


def measure_profiles(
    grey: Float32[np.ndarray, "h w"],
    valid: Bool[np.ndarray, "h w"] | None,
    seen: Projection,
    others: list[Projection],
    blur_px: float,
    diameter_m: float,
    config: ProfileConfig,
) -> ProfileMeasurements:
    """A and B along a projected wire.

    valid: false where a mask says "ignore".  others: further wires in the same image.  blur_px: standard
    deviation of what blurs a wire in the image.
    """
    # A bar of width w has the variance w^2 / 12.
    width = diameter_m * np.linalg.norm(seen.by_yz, axis=1)
    tau = np.sqrt(blur_px**2 + width**2 / 12)
    within = config.window_px + 3 * blur_px
    near = crossings(seen, others, within, config.most_others, config.least_crossing)
    good = seen.good & ~(np.nan_to_num(np.abs(near[:, 0]), nan=np.inf) < config.apart * tau)
    if valid is not None:
        column, row = np.clip(seen.pixel, 0, np.array(grey.shape[::-1]) - 1).astype(int).T
        good &= valid[row, column]
    if good.sum() < config.least_samples:
        none = np.zeros(0)
        return ProfileMeasurements(none, np.zeros((0, 2)), np.zeros((0, 3)), none, none, none, none)
    d = np.arange(-config.window_px, config.window_px + config.step_px / 2, config.step_px)
    x, y = (seen.pixel[good, None] + d[:, None] * seen.normal[good, None] - 0.5).astype(np.float32).T
    profile = cv2.remap(grey, x.T, y.T, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    columns = _columns(d, tau[good], near[good])
    fit, variance = _least_squares(profile.astype(np.float64), columns, config.step_px, config.quantum)
    return ProfileMeasurements(
        seen.s[good], seen.by_yz[good], seen.by_pose[good],
        fit[:, 0], fit[:, 1], variance[:, 0], variance[:, 1],
    )  # fmt: skip


def _columns(
    d: Float[np.ndarray, " n"], tau: Float[np.ndarray, " k"], near: Float[np.ndarray, "k m"]
) -> Float[np.ndarray, "k n c"]:
    """K and K' of the wire, a background that is a straight line, K and K' of the others."""
    flat = np.ones((len(tau), len(d)))
    columns = [*_kernel(d - np.zeros((len(tau), 1)), tau), flat, flat * d / d[-1]]
    for off in near.T[np.isfinite(near).any(0)]:
        # What is not there is put where it gives nothing.
        columns += _kernel(d - np.nan_to_num(off, nan=1e3)[:, None], tau)
    return np.stack(columns, 2)


def _kernel(x: Float[np.ndarray, "k n"], tau: Float[np.ndarray, " k"]) -> list[Float[np.ndarray, "k n"]]:
    """A Gaussian of integral 1, and its derivative."""
    share = np.clip(x / tau[:, None], -30, 30)
    K = np.exp(-(share**2) / 2) / (np.sqrt(2 * np.pi) * tau[:, None])
    return [K, -share / tau[:, None] * K]


def _least_squares(
    profile: Float[np.ndarray, "k n"],
    columns: Float[np.ndarray, "k n c"],
    step_px: float,
    quantum: float,
) -> tuple[Float[np.ndarray, "k 2"], Float[np.ndarray, "k 2"]]:
    """The first two coefficients of each profile, and their variances."""
    normal = np.einsum("knc,kne->kce", columns, columns, optimize=True)
    normal += 1e-6 * np.eye(normal.shape[1])  # columns of nothing get nothing
    inverse = np.linalg.inv(normal)
    fit = np.einsum("kce,kne,kn->kc", inverse, columns, profile, optimize=True)
    left = profile - np.einsum("knc,kc->kn", columns, fit)
    # Neighbours half a pixel apart share their noise: a pixel's counts once.
    freedom = profile.shape[1] * step_px - 4
    noise = ((left**2).sum(1) / freedom + quantum) / step_px
    return fit[:, :2], noise[:, None] * np.stack([inverse[:, 0, 0], inverse[:, 1, 1]], 1)
