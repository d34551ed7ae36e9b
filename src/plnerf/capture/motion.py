"""How much of one picture another shows, and how sharp a picture is.

Both look at grey pictures of at most LOOK_PX: features are matched, and a turn, a scale and a shift fitted to
the matches by RANSAC say where the one picture lies in the other.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

LOOK_PX = 640
"""Longer side of the pictures that are looked at."""
LEAST_SIDE_PX = 16
"""Their shorter side, also of a picture that is 100 times as wide as high: slopes are of an eighth of it."""
FEATURES, LEAST_MATCHES, RATIO = 800, 12, 0.8
BLURRED, AROUND = 0.5, 9
"""Sharpness below this share of the median of so many pictures around is blur."""


@dataclass(frozen=True, eq=False)
class Look:
    """What is kept of a picture to compare it with others."""

    size: tuple[int, int]
    """Width and height in pixels as looked at."""
    points: Float[np.ndarray, "n 2"]
    features: UInt8[np.ndarray, "n 32"] | None
    sharpness: float
    """Mean square of the Laplacian over that of the slopes eight times as coarse: what is flat counts in
    neither.  Comparable between pictures of the same things only."""


@dataclass(frozen=True)
class Motion:
    """From one picture to another."""

    overlap: float
    """Share of the first picture's area that the second one shows, by the fitted motion."""
    matches: int


def look_at(image: UInt8[np.ndarray, "h w 3"]) -> Look:
    """Features and sharpness of a picture (RGB)."""
    h, w = image.shape[:2]
    factor = min(1.0, LOOK_PX / max(h, w))
    size = (max(LEAST_SIDE_PX, round(w * factor)), max(LEAST_SIDE_PX, round(h * factor)))
    grey = cv2.resize(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), size, interpolation=cv2.INTER_AREA)
    # Small and flat pictures too: patches of 15 px, corners from a contrast of 5.
    orb = cv2.ORB.create(FEATURES, edgeThreshold=15, patchSize=15, fastThreshold=5)
    found, features = orb.detectAndCompute(grey, None)
    points = np.array([point.pt for point in found], np.float64).reshape(-1, 2)
    values = grey.astype(np.float64)
    coarse = cv2.resize(values, None, fx=0.125, fy=0.125, interpolation=cv2.INTER_AREA)
    slopes = (np.diff(coarse, axis=0) ** 2).mean() + (np.diff(coarse, axis=1) ** 2).mean()
    sharpness = float((cv2.Laplacian(values, cv2.CV_64F) ** 2).mean() / (slopes + 1.0))
    return Look(size, points, features, sharpness)


def motion_between(a: Look, b: Look) -> Motion | None:
    """The motion from a to b; None where too few features agree on one."""
    if a.features is None or b.features is None or min(len(a.points), len(b.points)) < LEAST_MATCHES:
        return None
    pairs = cv2.BFMatcher(cv2.NORM_HAMMING).knnMatch(a.features, b.features, k=2)
    good = [p[0] for p in pairs if len(p) == 2 and p[0].distance < RATIO * p[1].distance]
    if len(good) < LEAST_MATCHES:
        return None
    there = np.array([a.points[match.queryIdx] for match in good])
    here = np.array([b.points[match.trainIdx] for match in good])
    # Five pixels: things at other distances move otherwise, and shall still count.
    moved, inlier = cv2.estimateAffinePartial2D(there, here, method=cv2.RANSAC, ransacReprojThreshold=5.0)
    if moved is None or inlier is None or int(inlier.sum()) < LEAST_MATCHES:
        return None
    return Motion(_overlap(moved, a.size, b.size), int(inlier.sum()))


def blurred(sharpness: Float[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    """Which of a series are much less sharp than those around: what is seen changes slowly, blur does not."""
    found = np.zeros(len(sharpness), bool)
    for i in range(len(sharpness)):
        begin = max(0, min(i - AROUND // 2, len(sharpness) - AROUND))
        found[i] = sharpness[i] < BLURRED * np.median(sharpness[begin : begin + AROUND])
    return found


def _overlap(moved: Float[np.ndarray, "2 3"], a: tuple[int, int], b: tuple[int, int]) -> float:
    """Share of the rectangle a that lies in the rectangle b once it is moved."""
    corners = np.array([[0, 0], [a[0], 0], [a[0], a[1]], [0, a[1]]], np.float64)
    inside = (corners @ moved[:, :2].T + moved[:, 2]).astype(np.float32)
    whole = cv2.contourArea(inside)
    other = np.array([[0, 0], [b[0], 0], [b[0], b[1]], [0, b[1]]], np.float32)
    if whole < 1.0:
        return 0.0
    both, _ = cv2.intersectConvexConvex(inside, other)
    return float(both) / whole
