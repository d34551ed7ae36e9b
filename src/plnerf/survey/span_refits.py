"""The refit of all spans to the photos at their full size, each for itself, with those that show it well.

So time and memory grow with the number of spans, and images far from a span neither cost nor count there.
"""

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

from plnerf.survey.chains import Chain, with_wires
from plnerf.survey.posed_photos import Photos
from plnerf.survey.refine.alike import alike
from plnerf.survey.refine.config import AdjustConfig, RefineConfig
from plnerf.survey.refine.crossed_pairs import uncrossed
from plnerf.survey.refine.leverage import telling
from plnerf.survey.refine.refine import Refinement, refine_wires
from plnerf.survey.refine.strays import without_strays
from plnerf.survey.refine.unknowns import Light
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
    beside its structure, say little of poses.  They say little of the light, too, without which a wire comes
    out half its diameter aside: the longest spans come first, and tell it to those after them in which photos
    show both.
    """
    full = photos.full_size()
    spans = [span for chain in chains for span in chain]
    lengths = np.array([sum(wire.base.length_m for wire in span.wires) for span in spans])
    found: dict[int, tuple[Photos, Refinement]] = {}
    for count, k in enumerate(np.argsort(-lengths, kind="stable").tolist()):

        def report(done: int, of: int, count: int = count) -> None:
            progress(count * of + done, len(spans) * of)

        seen = _seen(full, spans[k], config)
        longer = (other for one, other in found.values() if _shared(seen, one))
        light = next((_carried(other, spans[k], config.adjust) for other in longer), None)
        found[k] = seen, _refitted(seen, spans[k], config, light, report)
    refits = [found[k][1] for k in range(len(spans))]
    residual_px = _median([one.pose_residual_px for one in refits], lengths) / photos.reduced
    wires = [wire for one in refits for wire in one.wires]
    return with_wires(chains, wires), residual_px, tuple(shown for one in refits for shown in one.shown)


def _seen(full: Photos, span: SpanWires, config: RefineConfig) -> Photos:
    """The photos that show a span well."""
    places = np.linspace(0.0, 1.0, config.samples)
    points = np.concatenate([wire.points(places * wire.base.length_m) for wire in span.wires])
    return telling(full.of(points), span.wires, config.least_leverage, config.profile.end_on)


def _shared(seen: Photos, other: Photos) -> bool:
    """Whether half of the photos that show a span show another one too."""
    return len(set(seen.train) & set(other.train)) >= len(seen.train) / 2


def _carried(refined: Refinement, span: SpanWires, config: AdjustConfig) -> Light | None:
    """What one span's light says of another one's.

    Where the line turns, a part of what is along the one is across the other, and of that nothing is known.
    """
    light = refined.light
    if light is None or not refined.wires or not span.wires:
        return None
    u, v = refined.wires[0].base.u, span.wires[0].base.u
    cosine, sine = float(u @ v), float(u[0] * v[1] - u[1] * v[0])
    own = config.own_shading * config.shading_grey
    across = np.hypot(cosine * light.sigma[0], sine * config.shading_grey)
    sigma = np.hypot([across, light.sigma[1]], own)
    return Light(light.shading * [cosine, 1.0], sigma)


def _refitted(
    seen: Photos, span: SpanWires, config: RefineConfig, light: Light | None,
    report: Callable[[int, int], None],
) -> Refinement:  # fmt: skip
    """One span by the photos that show it well."""
    refined = refine_wires(seen, span.wires, config, report, light=light)
    if seen.frame.unit == "m":
        # In this order: what `alike` fits again would lose the doubts that `uncrossed` adds.
        refined = uncrossed(seen, alike(seen, refined, config), config)
        refined = without_strays(refined, span.wires, config)
    return refined


def _median(values: Sequence[float], weights: Float[np.ndarray, " k"]) -> float:
    """0 of none."""
    order = np.argsort(values, kind="stable")
    half = np.searchsorted(np.cumsum(weights[order]), weights.sum() / 2)
    return float(values[order[half]]) if len(order) else 0.0
