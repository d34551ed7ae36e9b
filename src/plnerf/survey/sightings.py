"""Where an image shows a wire, to a fraction of a pixel: ridges across its projected curve.

Letters: k samples along the wire, d places across it in the image (px), e signed distance of the ridge from
the projected curve, positive along the image normal.
"""

from dataclasses import dataclass

import cv2
import numpy as np
import torch
from jaxtyping import Bool, Float, Float32
from scipy.ndimage import gaussian_filter1d, uniform_filter1d

from plnerf.scene.cameras import Cameras, project
from plnerf.survey.catenary import Base

STEP_PX = 0.5
SCALES_PX = (0.8, 1.6, 3.2)
"""Of the second derivative across the wire; the one that answers most in an image is used there."""
ALONG = 5
"""Samples along the wire that are averaged: noise goes, the wire stays."""
LEAST_CONTRAST = 1.5
"""Response, in typical responses of the same image around the wire, that a sighting needs."""
END_ON = 0.15
"""Sine of the angle between wire and line of sight below which a view says nothing."""
APART_PX = 3.0
"""Wires nearer to one another than this and the window are not told apart."""


@dataclass(frozen=True, eq=False)
class Sightings:
    """Of one wire in one image."""

    s: Float[np.ndarray, " k"]
    """Along the wire, as `Base` counts it."""
    e: Float[np.ndarray, " k"]
    g: Float[np.ndarray, "k 2"]
    """How far the projected curve moves along the normal when the wire moves along y, and along z."""
    normal: Float[np.ndarray, "k 2"]
    """In the image."""
    weight: Float[np.ndarray, " k"]
    """0 to 1: how clear the ridge is."""
    tried: Float[np.ndarray, " t"]
    """All places along the wire at which one was looked for."""

    def __len__(self) -> int:
        return len(self.s)


@dataclass(frozen=True, eq=False)
class Track:
    """A wire as one camera sees it, at samples s."""

    s: Float[np.ndarray, " k"]
    pixel: Float[np.ndarray, "k 2"]
    normal: Float[np.ndarray, "k 2"]
    g: Float[np.ndarray, "k 2"]
    good: Bool[np.ndarray, " k"]
    """In front of the camera, in the image, and not seen end-on."""


def track(camera: Cameras, base: Base, q: Float[np.ndarray, "5"], s: Float[np.ndarray, " k"]) -> Track:
    """Projects a wire.  camera: one, in float64."""
    step = 1e-4 * base.length_m
    here, on = base.at(q, s), base.at(q, s + step)
    places = [_world(base, s, here), _world(base, s + step, on)]
    places += [_world(base, s, here + step * np.eye(2)[k]) for k in range(2)]
    pixels, depths = project(camera, torch.from_numpy(np.concatenate(places)))
    (here_px, on_px, y_px, z_px), depth = np.split(pixels[0].numpy(), 4), depths[0].numpy().reshape(4, -1)
    along = on_px - here_px
    length = np.linalg.norm(along, axis=1)
    front = (depth > 1e-6).all(0)
    scale = float(camera.focal_px[0, 0]) * step / np.where(front, depth[0], 1.0)  # were it seen square on
    tangent = along / np.maximum(length, 1e-12)[:, None]
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], 1)
    g = np.stack([((moved - here_px) * normal).sum(1) / step for moved in (y_px, z_px)], 1)
    inside = ((here_px > 0) & (here_px < camera.size_px[0].numpy())).all(1)
    return Track(s, here_px, normal, g, front & inside & (length > END_ON * scale))


def sight(
    grey: Float32[np.ndarray, "h w"],
    valid: Bool[np.ndarray, "h w"] | None,
    seen: Track,
    others: list[Track],
    window_px: float,
) -> Sightings:
    """The clearest ridge within the window across each sample of a projected wire, where there is one.

    others: further wires in the same image; where one is so near that its ridge may be meant, nothing is said.
    """
    good = seen.good & ~_crowded(seen, others, window_px + APART_PX)
    if valid is not None:
        column, row = np.clip(seen.pixel, 0, np.array(grey.shape[::-1]) - 1).astype(int).T
        good &= valid[row, column]
    if good.sum() < ALONG:
        return _none()
    seen = Track(*(getattr(seen, name)[good] for name in ("s", "pixel", "normal", "g", "good")))
    reach = window_px + 3 * SCALES_PX[-1]
    d = np.arange(-reach, reach + STEP_PX / 2, STEP_PX)
    at = (seen.pixel[:, None] + d[None, :, None] * seen.normal[:, None] - 0.5).astype(np.float32)
    profile = cv2.remap(grey, at, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    profile = uniform_filter1d(profile.astype(np.float64), ALONG, axis=0, mode="nearest")
    near = np.abs(d) <= window_px
    answers = [_energy(profile, scale) for scale in SCALES_PX]
    typical = [float(np.median(answer)) + 1e-3 for answer in answers]
    clear = [answer[:, near].max(1) / level for answer, level in zip(answers, typical, strict=True)]
    best = int(np.argmax([np.median(one) for one in clear]))
    top = (answers[best] * np.where(near, 1 - 0.25 * np.abs(d) / window_px, 0)).argmax(1)
    e, inner = _peak(answers[best], top, d)
    contrast = clear[best]
    use = inner & (contrast >= LEAST_CONTRAST) & (np.abs(e) <= window_px)
    weight = contrast**2 / (contrast**2 + 9.0)
    return Sightings(seen.s[use], e[use], seen.g[use], seen.normal[use], weight[use], seen.s)


def _world(base: Base, s: Float[np.ndarray, " k"], yz: Float[np.ndarray, "k 2"]) -> Float[np.ndarray, "k 3"]:
    flat = base.o + s[:, None] * base.u + yz[:, :1] * base.n
    return np.concatenate([flat, yz[:, 1:]], 1)


def _energy(profile: Float[np.ndarray, "k n"], scale_px: float) -> Float[np.ndarray, "k n"]:
    """Second and first derivative across the wire together, which have their top in its middle.

    A wire lit from one side is bright there and dark on the other: the second derivative alone has its top on
    one of the two, and is off by half a radius (measured: 1 cm of a wire 3.2 cm thick).
    """
    even = gaussian_filter1d(profile, scale_px / STEP_PX, axis=1, order=2) * (scale_px / STEP_PX) ** 2
    odd = gaussian_filter1d(profile, scale_px / STEP_PX, axis=1, order=1) * (scale_px / STEP_PX)
    return np.hypot(even, odd)


def _peak(
    answer: Float[np.ndarray, "k n"], top: np.ndarray, d: Float[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, " k"], Bool[np.ndarray, " k"]]:
    """The top of the parabola through three answers, and whether the middle one is the largest of them."""
    inner = (top > 0) & (top < len(d) - 1)
    at = np.clip(top, 1, len(d) - 2)
    rows = np.arange(len(answer))
    low, mid, high = (answer[rows, at + k] for k in (-1, 0, 1))
    bend = low - 2 * mid + high
    inner &= (mid >= low) & (mid >= high) & (bend < 0)
    shift = np.where(inner, 0.5 * (low - high) / np.where(inner, bend, 1.0), 0.0)
    return d[at] + STEP_PX * shift, inner


def _crowded(seen: Track, others: list[Track], within_px: float) -> Bool[np.ndarray, " k"]:
    """Where another wire's image is near."""
    crowded = np.zeros(len(seen.s), bool)
    for other in others:
        both = other.good[:-1] & other.good[1:]
        start, way = other.pixel[:-1][both], np.diff(other.pixel, axis=0)[both]
        if len(start):
            to = seen.pixel[:, None] - start
            share = np.clip((to * way).sum(2) / np.maximum((way**2).sum(1), 1e-12), 0, 1)
            apart = np.linalg.norm(to - share[..., None] * way, axis=2).min(1)
            crowded |= apart < within_px
    return crowded


def _none() -> Sightings:
    nothing, pairs = np.zeros(0), np.zeros((0, 2))
    return Sightings(nothing, nothing, pairs, pairs, nothing, nothing)
