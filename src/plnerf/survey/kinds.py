"""Which wires of a span are shields, by where they hang and what they look like.

The wires within `LEVEL_M` of the highest are shields if they are one or two, hang alone (no bundles), have
three wires or more at least `BELOW_M` beneath them, and differ from those as shields do: the others are
bundles, they sag less, or they are so thin that they have fewer points.
"""

from collections.abc import Sequence

import numpy as np

from plnerf.survey.fit import CatenaryFit
from plnerf.survey.model import Kind

LEVEL_M, BELOW_M = 2.0, 2.0
MOST, LEAST_BELOW = 2, 3
BUNDLE_M = 0.65
"""Wires so near to each other are one bundle."""
FLATTER, THINNER = 0.93, 0.6
"""Share of the others' median hang (8 sag / span^2), and of their points per metre, below which a wire sags
less or is thinner."""


def kinds(fits: Sequence[CatenaryFit], points: Sequence[int]) -> list[Kind]:
    """The kind of each wire of one span, by its curve and its number of points.

    Letters: h height of its middle.
    """
    curves = [fit.curve for fit in fits]
    at = np.array([curve.points(np.array([curve.span_m / 2]))[0] for curve in curves]).reshape(-1, 3)
    h = at[:, 2]
    top = h >= h.max(initial=-np.inf) - LEVEL_M
    below = h < h[top].min(initial=np.inf) - BELOW_M
    phases: list[Kind] = ["phase"] * len(fits)
    if not 1 <= top.sum() <= MOST or below.sum() < LEAST_BELOW or (~top & ~below).any():
        return phases
    members = (np.linalg.norm(at[:, None] - at, axis=2) <= BUNDLE_M).sum(1)
    hang = np.array([8 * curve.sag_m / curve.span_m**2 for curve in curves])
    dense = np.array([count / curve.span_m for count, curve in zip(points, curves, strict=True)])
    bundled = members[top].max() == 1 and np.median(members[below]) > 1
    flatter = np.median(hang[top]) < FLATTER * np.median(hang[below])
    thinner = np.median(dense[top]) < THINNER * np.median(dense[below])
    if members[top].max() > 1 or not (bundled or flatter or thinner):
        return phases
    return ["shield" if high else "phase" for high in top]
