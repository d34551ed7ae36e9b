"""Which wires of a span are shields, by where they hang and what they look like.

The wires within `level_m` of the highest are shields if they are one or two, hang alone (no bundles), have
three wires or more at least `below_m` beneath them, and differ from those as shields do: the others are
bundles, or they sag less, or they are so thin that they have fewer points.
"""

from collections.abc import Sequence

import numpy as np

from plnerf.line.wire import Kind, Wire
from plnerf.survey.config_wires import KindsConfig


def kinds(wires: Sequence[Wire], counts: Sequence[int], config: KindsConfig = KindsConfig()) -> list[Kind]:
    """The kind of each wire of one span, by its curve and its number of points.

    The sag between what is seen of the ends serves to compare wires of one span, attached or not.
    Letters: h height of a wire's middle.
    """
    L = [wire.base.length_m for wire in wires]
    at = np.array([
        wire.points(np.array([length / 2]))[0] for wire, length in zip(wires, L, strict=True)
    ]).reshape(-1, 3)  # fmt: skip
    h = at[:, 2]
    top = h >= h.max(initial=-np.inf) - config.level_m
    below = h < h[top].min(initial=np.inf) - config.below_m
    phases: list[Kind] = ["phase"] * len(wires)
    if (
        not 1 <= top.sum() <= config.max_shields
        or below.sum() < config.min_below
        or (~top & ~below).any()
    ):  # fmt: skip
        return phases
    members = (np.linalg.norm(at[:, None] - at, axis=2) <= config.bundle_m).sum(1)
    hang = np.array([
        8 * wire.drop_between(0.0, length) / length**2 for wire, length in zip(wires, L, strict=True)
    ])  # fmt: skip
    dense = np.array(counts) / L
    bundled = members[top].max() == 1 and np.median(members[below]) > 1
    flatter = np.median(hang[top]) < config.flatter * np.median(hang[below])
    thinner = np.median(dense[top]) < config.thinner * np.median(dense[below])
    if members[top].max() > 1 or not (bundled or flatter or thinner):
        return phases
    return ["shield" if high else "phase" for high in top]
