"""Pieces of one wire become one; wires that hang as near as subconductors stay."""

from dataclasses import replace

import numpy as np
from tests.support.hung_lines import attachments, detected, true_spans

from plnerf.line.wire import Wire
from plnerf.survey.chains import find_chains, wires_of
from plnerf.survey.config_spans import ChainConfig
from plnerf.survey.same_wire import single_wires

FEET = np.array([[0.0, 0.0], [40.0, 0.0], [85.0, 0.0]])
SAME_M = 0.1


def moved(wire: Wire, aside_m: float, low: float, high: float) -> Wire:
    """A part of a wire, so far to its left."""
    theta = wire.theta + np.array([aside_m, aside_m, 0, 0, 0, 0])
    return replace(detected(wire, None), theta=theta).between(low, high)


def test_pieces_of_a_wire_are_one_over_the_extent_of_all() -> None:
    random = np.random.default_rng(0)
    spans = true_spans(attachments(FEET))
    wires = [detected(wire, random, (-0.5, -0.5)) for wire in spans[1]]
    first, other, third, fourth = spans[0]
    pieces = [
        moved(first, 0.0, 6.0, 38.0), moved(first, 0.04, 0.5, 5.0), moved(first, -0.05, 37.0, 39.5),
        moved(other, 0.0, 0.5, 38.0), moved(other, 0.3, 1.0, 30.0), moved(other, 0.0, 12.0, 20.0),
        detected(third, random), detected(fourth, random),
    ]  # fmt: skip
    chains = find_chains([*wires, *pieces], ChainConfig())
    count = len(wires_of(chains))
    assert count == 12
    found = single_wires(chains, chains, [True] * count, SAME_M)
    assert len(found) == 9
    lengths = sorted(round(wire.base.length_m, 1) for wire in found)
    assert lengths == [29.0, 37.5, 39.0, 40.0, 40.0, 44.0, 44.0, 44.0, 44.0]
    # Without a distance, and of wires that nothing shows, each stays or goes for itself.
    assert len(single_wires(chains, chains, [True] * count, 0.0)) == count
    assert not single_wires(chains, chains, [False] * count, SAME_M)


def test_single_wires_stay_as_they_were_detected() -> None:
    random = np.random.default_rng(1)
    wires = [detected(wire, random, (1.0, 0.5)) for span in true_spans(attachments(FEET)) for wire in span]
    chains = find_chains(wires, ChainConfig())
    before = wires_of(chains)
    after = single_wires(chains, chains, [k != 2 for k in range(len(before))], SAME_M)
    assert len(after) == len(before) - 1
    for one, same in zip(after, before[:2] + before[3:], strict=True):
        ends = np.array([0.0, one.base.length_m])
        np.testing.assert_allclose(one.points(ends), same.points(ends), atol=1e-9)
