"""Where wires end: images show them up to their support, and beyond it nothing, or wires that hang otherwise.

A binary sighting at every place near an end, whether a wire stands out where its catenary goes, is more
frequent before the end than beyond.  The end is the place that splits the two most likely (a step between two
Bernoulli rates, by maximum likelihood).
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.special import xlogy

from plnerf.scene.scene import Scene
from plnerf.survey.catenary import Base
from plnerf.survey.refine.adjust import VISIBLE
from plnerf.survey.refine.refine import BLUR_PX, double, of_image
from plnerf.survey.refine.track import track

STEP_M = 0.2
AROUND_M, WITHIN_M = 4.0, 1.5
"""To either side of where a support was seen: places that are looked at, and that may be the end."""
NEAR_PX = 0.7
"""A wire is seen where it stands out no further than this from its catenary."""
LEAST_GAIN = 10.0
"""Of the log-likelihood, over one rate for all places: less may be chance."""
SIGMA_M = 0.15
"""Standard deviation of an end that was found so; four on rendered towers were up to 0.2 m off."""


def wire_end(
    scene: Scene,
    base: Base,
    wires: Sequence[Float[np.ndarray, "5"]],
    motion: Float[np.ndarray, "n 3"],
    near: float,
    outward: int,
    metre: float,
    diameter: float,
) -> float | None:
    """Where along the base the wires end, in the scene's unit; None where the images do not say.

    wires: refined, over the base.  motion: of the training images (`Refinement.motion`).  near: where a
    support was seen.  outward: 1 at the last end, -1 at the first.  metre: its length in the scene's unit.
    """
    step = STEP_M * metre
    s = near + step * np.arange(-round(AROUND_M / STEP_M), round(AROUND_M / STEP_M) + 1)
    seen, tried = np.zeros(len(s)), np.zeros(len(s))
    for n, i in enumerate(scene.train):
        camera = double(scene.cameras[[i]])
        tracks = [track(camera, base, q, s, motion[n]) for q in wires]
        for one in of_image(scene, i, tracks, BLUR_PX, diameter):
            at = np.round((one.s - s[0]) / step).astype(int)
            shown = np.abs(one.A) > VISIBLE * np.sqrt(one.variance_A)
            shown &= np.abs(one.B) < NEAR_PX * np.abs(one.A)
            np.add.at(tried, at, 1.0)
            np.add.at(seen, at, shown)
    candidates = near + step / 2 * np.arange(-round(2 * WITHIN_M / STEP_M), round(2 * WITHIN_M / STEP_M) + 1)
    gains = [_gain(seen, tried, (s - end) * outward > 0) for end in candidates]
    best = int(np.argmax(gains))
    return float(candidates[best]) if gains[best] >= LEAST_GAIN else None


def _gain(
    seen: Float[np.ndarray, " k"], tried: Float[np.ndarray, " k"], beyond: np.ndarray
) -> float:
    """Of the log-likelihood by a lower rate beyond; negative where the rate beyond is higher."""
    (out, n_out), (inner, n_in) = ((seen[m].sum(), tried[m].sum()) for m in (beyond, ~beyond))
    gain = _likelihood(out, n_out) + _likelihood(inner, n_in) - _likelihood(out + inner, n_out + n_in)
    return float(gain if out * n_in < inner * n_out else -gain)


def _likelihood(seen: float, tried: float) -> float:
    """Greatest log-likelihood of so many of so many."""
    rate = seen / max(tried, 1.0)
    return float(xlogy(seen, rate) + xlogy(tried - seen, 1 - rate))
