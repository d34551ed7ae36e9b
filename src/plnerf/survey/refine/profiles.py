"""What the grey values across a wire's projected curve say of where the wire is.

    grey(d) = background + A K(d) + B K'(d) + C S(d) + the same of other wires that cross here

Letters: d distance from the curve along its normal (px), K a bar as wide as the wire and blurred, S the same
times a slope that is 1 at the bar's edge, k samples along the wire.  A, the wire's strength, is what it adds
to the background, so negative before the sky.  A wire that lies at e shows as A K(d - e), to first order
B = -A e; one that is brighter at one edge than in its middle adds C S(d).  Nothing is divided: where a wire
does not stand out, A and what B says of e are near 0.

A sunlit wire is brighter above and often as dark as the ground below: what it adds has its middle up to a
radius above the wire's own.  Where a wire is wider than its blur, its edges tell such a C from a shift; of
one as thin as that, K' and S have one shape, and the light decides, which is the same in all views
(`adjust.py`).  So C is expected to be what the light makes it, as loosely as wires differ from that, and is
eliminated: B = -A e + k C, per grey level of slope.
"""

from dataclasses import dataclass, fields, replace

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32
from scipy.special import ndtr

from plnerf.survey.posed_photos import Photos
from plnerf.survey.refine.config import ProfileConfig
from plnerf.survey.refine.profile_fits import least_squares
from plnerf.survey.refine.projection import Projection, crossings


@dataclass(frozen=True, eq=False)
class ProfileMeasurements:
    """Of one wire in one image, at k places along it."""

    s: Float[np.ndarray, " k"]
    by_yz: Float[np.ndarray, "k 2"]
    by_pose: Float[np.ndarray, "k 6"]
    """As `Projection` has them."""
    by_slope: Float[np.ndarray, " k"]
    """What B gains for each grey level by which the wire's edge towards the normal is brighter than its
    middle."""
    width_px: Float[np.ndarray, " k"]
    """The width that was assumed."""
    A: Float[np.ndarray, " k"]
    B: Float[np.ndarray, " k"]
    wider: Float[np.ndarray, " k"]
    """A times the width that the wire has beyond that (px)."""
    wider_by_blur: Float[np.ndarray, " k"]
    """Apparent widening (px) for each px^2 of variance that the blur has beyond what was assumed."""
    variance_A: Float[np.ndarray, " k"]
    variance_B: Float[np.ndarray, " k"]
    variance_wider: Float[np.ndarray, " k"]
    """From how well the model describes each profile."""

    def __len__(self) -> int:
        return len(self.s)

    def only(self, some: Bool[np.ndarray, " k"]) -> "ProfileMeasurements":
        """Some of them."""
        return replace(self, **{one.name: getattr(self, one.name)[some] for one in fields(self)})

    @classmethod
    def none(cls) -> "ProfileMeasurements":
        """No measurements: the image does not show the wire."""
        pairs = {"by_yz": 2, "by_pose": 6}
        return cls(**{
            one.name: np.zeros((0, pairs[one.name]) if one.name in pairs else 0) for one in fields(cls)
        })


def grey_picture(
    photos: Photos, i: int
) -> tuple[Float32[np.ndarray, "h w"], Bool[np.ndarray, "h w"] | None]:
    """Of an image; and which of its pixels no mask ignores, where there are masks."""
    # Of bytes, interpolation gives bytes.
    grey = cv2.cvtColor(photos.images.image(i), cv2.COLOR_RGB2GRAY).astype(np.float32)
    return grey, photos.images.valid(i) if photos.images.has_masks else None


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
    width = np.maximum(diameter_m * np.linalg.norm(seen.by_yz, axis=1), config.least_width_px)
    # A bar of width w has the variance w^2 / 12.
    tau = np.sqrt(blur_px**2 + width**2 / 12)
    reach = np.maximum(config.window_px, width / 2 + config.beside_px)
    within = float(reach[seen.good].max(initial=config.window_px)) + 3 * blur_px
    near = crossings(seen, others, within, config.most_others, config.least_crossing)
    good = seen.good & ~(np.nan_to_num(np.abs(near[:, 0]), nan=np.inf) < config.apart * tau)
    if valid is not None:
        column, row = np.clip(seen.pixel, 0, np.array(grey.shape[::-1]) - 1).astype(int).T
        good &= valid[row, column]
    if good.sum() < config.least_samples:
        return ProfileMeasurements.none()
    d = reach[good, None] * np.linspace(-1, 1, 1 + round(2 * config.window_px / config.step_px))
    at = seen.pixel[good, None] + d[:, :, None] * seen.normal[good, None] - 0.5
    x, y = np.moveaxis(at.astype(np.float32), 2, 0)
    profile = cv2.remap(grey, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    width = width[good]
    *shapes, wider, blurred = _bar(d, width, blur_px)
    columns = _columns(d, shapes, tau[good], near[good])
    step_px = d[:, 1] - d[:, 0]
    fit = least_squares(profile.astype(np.float64), columns, wider, blurred, step_px, config.quantum)
    # What B is, given C: C is the slope in grey levels times the width, for K and S are of integral 1.
    kappa = fit.variance[:, 1, 2] / (fit.variance[:, 2, 2] + (config.uneven_grey * width) ** 2)
    return ProfileMeasurements(
        seen.s[good], seen.by_yz[good], seen.by_pose[good], -kappa * width, width,
        fit.of[:, 0], fit.of[:, 1] - kappa * fit.of[:, 2], fit.wider, fit.wider_by_blur,
        fit.variance[:, 0, 0], fit.variance[:, 1, 1] - kappa * fit.variance[:, 1, 2], fit.variance_wider,
    )  # fmt: skip


def _bar(
    d: Float[np.ndarray, "k n"], width: Float[np.ndarray, " k"], blur_px: float
) -> list[Float[np.ndarray, "k n"]]:
    """K, K' and S of a blurred bar of integral 1; K's derivatives by its width and its blur's variance."""
    w = width[:, None]
    low, high = (d + w / 2) / blur_px, (d - w / 2) / blur_px
    at_low, at_high = (np.exp(-(x**2) / 2) / (np.sqrt(2 * np.pi) * blur_px) for x in (low, high))
    K = (ndtr(low) - ndtr(high)) / w
    S = (d * K + blur_px**2 * (at_low - at_high) / w) * 2 / w
    wider = ((at_low + at_high) / 2 - K) / w
    return [K, (at_low - at_high) / w, S, wider, (high * at_high - low * at_low) / (2 * blur_px * w)]


def _columns(
    d: Float[np.ndarray, "k n"],
    shapes: list[Float[np.ndarray, "k n"]],
    tau: Float[np.ndarray, " k"],
    near: Float[np.ndarray, "k m"],
) -> Float[np.ndarray, "k n c"]:
    """Those of the wire, a background that is a straight line, K and K' of the others."""
    columns = [*shapes, np.ones_like(d), d / d[:, -1:]]
    for off in near.T[np.isfinite(near).any(0)]:
        # What is not there is put where it gives nothing.
        columns += _kernel(d - np.nan_to_num(off, nan=1e3)[:, None], tau)
    return np.stack(columns, 2)


def _kernel(x: Float[np.ndarray, "k n"], tau: Float[np.ndarray, " k"]) -> list[Float[np.ndarray, "k n"]]:
    """A Gaussian of integral 1, and its derivative."""
    share = np.clip(x / tau[:, None], -30, 30)
    K = np.exp(-(share**2) / 2) / (np.sqrt(2 * np.pi) * tau[:, None])
    return [K, -share / tau[:, None] * K]
