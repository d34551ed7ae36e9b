"""The refit of all spans to the photos at their full size, each for itself, with those that show it well.

So time and memory grow with the number of spans, and images far from a span neither cost nor count there.
"""

from collections.abc import Callable, Sequence

import numpy as np

from plnerf.line.wire import Wire
from plnerf.survey.chains import Chain, with_wires
from plnerf.survey.posed_photos import Photos
from plnerf.survey.refine.alike import alike
from plnerf.survey.refine.config import RefineConfig
from plnerf.survey.refine.crossed_pairs import uncrossed
from plnerf.survey.refine.leverage import telling
from plnerf.survey.refine.refine import refine_wires
from plnerf.survey.refine.strays import without_strays


def refine_spans(
    photos: Photos,
    chains: Sequence[Chain],
    config: RefineConfig,
    progress: Callable[[int, int], None],
) -> tuple[tuple[Chain, ...], float, tuple[bool, ...]]:
    """The chains with refitted curves; the pose residual in px of the training's images: the spans' median;
    and whether the images show each wire, in the order of `wires_of`."""
    full = photos.full_size()
    spans = [span for chain in chains for span in chain]
    wires: list[Wire] = []
    shown: list[bool] = []
    residuals = []
    for k, span in enumerate(spans):

        def report(done: int, of: int, k: int = k) -> None:
            progress(k * of + done, len(spans) * of)

        places = np.linspace(0.0, 1.0, config.samples)
        points = np.concatenate([wire.points(places * wire.base.length_m) for wire in span.wires])
        seen = telling(full.of(points), span.wires, config.least_leverage, config.profile.end_on)
        refined = refine_wires(seen, span.wires, config, report)
        if photos.frame.unit == "m":
            # In this order: what `alike` fits again would lose the doubts that `uncrossed` adds.
            refined = uncrossed(seen, alike(seen, refined, config), config)
            refined = without_strays(refined, span.wires, config)
        wires += refined.wires
        shown += refined.shown
        residuals.append(refined.pose_residual_px / photos.reduced)
    residual_px = float(np.median(residuals)) if residuals else 0.0
    return with_wires(chains, wires), residual_px, tuple(shown)
