"""The refit of all spans to the photos at their full size, each for itself, with those that show it well.

So time and memory grow with the number of spans, and images far from a span neither cost nor count there.
"""

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

from plnerf.survey.chains import Chain, with_wires
from plnerf.survey.posed_photos import Photos
from plnerf.survey.refine.alike import alike
from plnerf.survey.refine.config import RefineConfig
from plnerf.survey.refine.crossed_pairs import uncrossed
from plnerf.survey.refine.leverage import telling
from plnerf.survey.refine.refine import Refinement, refine_wires
from plnerf.survey.refine.strays import without_strays
from plnerf.survey.span_wires import SpanWires


def refine_spans(
    photos: Photos,
    chains: Sequence[Chain],
    config: RefineConfig,
    progress: Callable[[int, int], None],
) -> tuple[tuple[Chain, ...], float, tuple[bool, ...]]:
    """The chains with refitted curves; the pose residual in px of the training's images; and whether the
    images show each wire, in the order of `wires_of`.

    The pose residual is the spans' median by the length of their wires: the first metres of a next span,
    beside its structure, say little of poses.
    """
    full = photos.full_size()
    spans = [span for chain in chains for span in chain]
    lengths = np.array([sum(wire.base.length_m for wire in span.wires) for span in spans])
    refits = []
    for k, span in enumerate(spans):

        def report(done: int, of: int, k: int = k) -> None:
            progress(k * of + done, len(spans) * of)

        refits.append(_refitted(full, span, config, report))
    residual_px = _median([one.pose_residual_px for one in refits], lengths) / photos.reduced
    wires = [wire for one in refits for wire in one.wires]
    return with_wires(chains, wires), residual_px, tuple(shown for one in refits for shown in one.shown)


def _refitted(
    full: Photos, span: SpanWires, config: RefineConfig, report: Callable[[int, int], None]
) -> Refinement:
    """One span by the photos that show it well."""
    places = np.linspace(0.0, 1.0, config.samples)
    points = np.concatenate([wire.points(places * wire.base.length_m) for wire in span.wires])
    seen = telling(full.of(points), span.wires, config.least_leverage, config.profile.end_on)
    refined = refine_wires(seen, span.wires, config, report)
    if full.frame.unit == "m":
        # In this order: what `alike` fits again would lose the doubts that `uncrossed` adds.
        refined = uncrossed(seen, alike(seen, refined, config), config)
        refined = without_strays(refined, span.wires, config)
    return refined


def _median(values: Sequence[float], weights: Float[np.ndarray, " k"]) -> float:
    """0 of none."""
    order = np.argsort(values, kind="stable")
    half = np.searchsorted(np.cumsum(weights[order]), weights.sum() / 2)
    return float(values[order[half]]) if len(order) else 0.0
