"""Which images make stereo pairs.

Letters: n views; b their baseline, d the typical distance of what a view shows.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from plnerf.survey.stereo.config import StereoPairConfig
from plnerf.survey.stereo.stereo_views import View


def partners(
    views: Sequence[View], distance: Float[np.ndarray, " n"], config: StereoPairConfig
) -> list[tuple[int, ...]]:
    """Indices of each view's partners, the best first; none for a view whose distance is unknown (NaN).

    A partner looks within `max_turn_deg` in the same direction, its b across the line of sight is within the
    allowed shares of d, and neither image shows the other's centre (an epipole), nor its opposite.
    """
    centres, axes = np.array([v.centre for v in views]), np.array([v.axis for v in views])
    focal = np.array([v.focal_px.mean() for v in views])
    found = []
    for i, view in enumerate(views):
        apart = centres - view.centre
        across = np.linalg.norm(np.cross(apart, view.axis), axis=1)
        b = across / distance[i]
        may = (b >= config.min_baseline) & (b <= config.max_baseline)
        may &= axes @ view.axis >= np.cos(np.radians(config.max_turn_deg))
        may &= np.abs(np.log(focal / focal[i])) <= np.log(config.max_zoom)
        may = np.flatnonzero(may)
        ahead = np.abs(apart[may] @ view.axis) / across[may]
        order = may[np.argsort(np.abs(np.log(b[may] / config.best_baseline)) + ahead, kind="stable")]
        mine: list[int] = []
        for j in order.tolist():
            if len(mine) < config.partners and not _shows_epipole(view, views[j]):
                mine.append(j)
        found.append(tuple(mine))
    return found


def joined_partners(*choices: Sequence[tuple[int, ...]]) -> list[tuple[int, ...]]:
    """Each view's partners of several choices in turn, every one once."""
    return [tuple(dict.fromkeys(j for some in mine for j in some)) for mine in zip(*choices, strict=True)]


def _shows_epipole(one: View, other: View) -> bool:
    """Whether the line through both centres meets either image."""
    for here, there in ((one, other), (other, one)):
        line = np.stack([there.centre - here.centre, here.centre - there.centre])
        _, inside = here.project(here.centre + line)
        if inside.any():
            return True
    return False
