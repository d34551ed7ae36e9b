"""Which wires of a span are subconductors of one bundle: those that hang side by side all along it."""

from dataclasses import replace

import numpy as np
from scipy.sparse.csgraph import connected_components

from plnerf.line.line import Line
from plnerf.line.wire import Wire
from plnerf.survey.config_wires import KindsConfig

SHARES = (0.3, 0.5, 0.7)
"""Of the span, where wires of a bundle are near to each other."""


def with_bundles(lines: tuple[Line, ...], config: KindsConfig) -> tuple[Line, ...]:
    """The lines with the numbers of bundles, from 1; shield wires are in none.

    Wires are of one bundle where `bundle_m` leads from one to the next at every one of `SHARES`.
    """
    count = 0
    made = []
    for line in lines:
        spans = []
        for span in line.spans:
            number = _groups(span.wires, config.bundle_m)
            of: dict[int, int] = {}
            wires = []
            for wire, group in zip(span.wires, number, strict=True):
                bundle = None
                if number.count(group) > 1:
                    if group not in of:
                        count += 1
                        of[group] = count
                    bundle = of[group]
                wires.append(replace(wire, bundle=bundle))
            spans.append(replace(span, wires=tuple(wires)))
        made.append(replace(line, spans=tuple(spans)))
    return tuple(made)


def _groups(wires: tuple[Wire, ...], reach_m: float) -> list[int]:
    """A number for each wire, the same for those of one bundle."""
    if not wires:
        return []
    o, u = wires[0].base.a, wires[0].base.u
    length = wires[0].base.length_m
    near = np.ones((len(wires), len(wires)), np.bool_)
    for share in SHARES:
        place = o + share * length * u
        at = np.concatenate([wire.points(np.array([(place - wire.base.a) @ wire.base.u])) for wire in wires])
        near &= np.linalg.norm(at[:, None] - at, axis=2) <= reach_m
    alone = np.array([wire.kind == "shield" for wire in wires])
    near &= ~(alone[:, None] | alone)
    found: list[int] = connected_components(near, directed=False)[1].tolist()
    return found
