"""Which images make stereo pairs.

Letters: n views; b their baseline, d the typical distance of what a view sees.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from plnerf.survey.stereo.views import View

WIDEST_TURN_DEG = 20.0
"""Between the directions of view: beyond, surfaces look too different."""
BASELINES = (0.05, 0.25)
"""b / d: below, a depth says little; above, images differ too much and near things have no match."""
BEST_BASELINE = 0.12
PARTNERS = 3
ZOOM = 1.5
"""Ratio of focal lengths, in pixels, beyond which images are not compared."""
LEAST_SINE = 0.3
"""Of the angle between baseline and rays: where it is less, epipoles are near."""


def partners(views: Sequence[View], distance: Float[np.ndarray, " n"]) -> list[tuple[int, ...]]:
    """For each view up to `PARTNERS` others, the best first; none for a view without a distance (NaN).

    A partner looks within `WIDEST_TURN_DEG` in the same direction, from b within `BASELINES` across the line
    of sight, and neither image shows the other's centre (an epipole), nor its opposite.
    """
    centres, axes = np.array([v.centre for v in views]), np.array([v.axis for v in views])
    focal = np.array([v.focal_px.mean() for v in views])
    found = []
    for i, view in enumerate(views):
        apart = centres - view.centre
        across = np.linalg.norm(np.cross(apart, view.axis), axis=1)
        b = across / distance[i]
        may = (b >= BASELINES[0]) & (b <= BASELINES[1])
        may &= axes @ view.axis >= np.cos(np.radians(WIDEST_TURN_DEG))
        may &= np.abs(np.log(focal / focal[i])) <= np.log(ZOOM)
        may = np.flatnonzero(may)
        ahead = np.abs(apart[may] @ view.axis) / across[may]
        order = may[np.argsort(np.abs(np.log(b[may] / BEST_BASELINE)) + ahead, kind="stable")]
        mine: list[int] = []
        for j in order.tolist():
            if len(mine) < PARTNERS and not _shows_epipole(view, views[j]):
                mine.append(j)
        found.append(tuple(mine))
    return found


def _shows_epipole(one: View, other: View) -> bool:
    """Whether the line through both centres meets either image."""
    for here, there in ((one, other), (other, one)):
        line = np.stack([there.centre - here.centre, here.centre - there.centre])
        _, inside = here.project(here.centre + line)
        if inside.any():
            return True
    return False
