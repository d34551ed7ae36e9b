"""Curves along the ground are left out with a finding; wires above it stay, all where no ground is seen."""

import numpy as np

from plnerf.line.hang import hang
from plnerf.line.wire import Wire
from plnerf.survey.config_ground import ClassifyConfig
from plnerf.survey.grounded import without_grounded
from plnerf.survey.on_wires import may_be_on
from plnerf.survey.surface import Surface

CONFIG = ClassifyConfig()


def seen(xyz: np.ndarray) -> Surface:
    n = len(xyz)
    return Surface(xyz, np.zeros((n, 3), np.uint8), np.full(n, 0.02), np.tile((0.0, 0.0, -1.0), (n, 1)))


def of(surface: Surface, *unsure: Wire) -> tuple[Surface, np.ndarray]:
    return surface, may_be_on(surface, unsure, CONFIG.on_wires)


def valley() -> Surface:
    """Ground that sags along x by a metre, as a wire does, and rises across it."""
    xy = np.random.default_rng(0).uniform(-18, 18, (6000, 2))
    return seen(np.column_stack([xy, (xy[:, 0] / 18) ** 2 - 1.0 + 0.05 * xy[:, 1]]))


def between(height: float, y: float = 0.0, number: int = 1) -> Wire:
    return hang((-18.0, y, height), (18.0, y, height), 1.0, id=number)


def test_what_runs_along_the_ground_is_no_wire() -> None:
    wires = [between(6.0), between(0.2, 3.0, 2), between(1.5, -3.0, 3), between(-2.0, 5.0, 4)]
    kept, findings = without_grounded(wires, *of(valley()), CONFIG)
    assert [wire.id for wire in kept] == [1, 3]
    (finding,) = findings
    assert finding.kind == "wires" and finding.what.startswith("2 of 4 curves run less than 1 m above the")


def test_wires_above_it_need_no_word() -> None:
    kept, findings = without_grounded([between(6.0)], *of(valley()), CONFIG)
    assert [wire.id for wire in kept] == [1] and findings == ()


def test_without_ground_all_stay() -> None:
    for surface in (seen(np.zeros((0, 3))), seen(np.random.default_rng(0).uniform(-18, 18, (50, 3)))):
        kept, findings = without_grounded([between(0.0)], *of(surface), CONFIG)
        assert len(kept) == 1 and findings == ()


def test_wires_stay_where_no_ground_is_seen_beside_them() -> None:
    """Of a tower against the sky the arms are the lowest that is seen, at the height of the wires."""
    xy = np.random.default_rng(1).uniform((8, -8), (18, 8), (3000, 2))
    arms = np.column_stack([xy, 5.2 + 0.02 * xy[:, 1]])
    wires = [between(6.0, y, number) for number, y in enumerate((-4.0, 4.0), 1)]
    own = np.concatenate([wire.polyline(0.05) for wire in wires])
    kept, findings = without_grounded(wires, *of(seen(np.concatenate([arms, own]))), CONFIG)
    assert len(kept) == 2 and findings == ()


def test_a_wire_that_is_not_certain_is_no_ground_for_those_below_it() -> None:
    """Far off, where no ground is seen, its own points are the lowest that lie on no certain wire."""
    unsure, below = between(6.0), between(4.0, 0.3, 2)
    rng = np.random.default_rng(2)
    spread = rng.uniform((-0.02, -0.2, -0.1), (0.02, 0.2, 0.1), (4, 721, 3))
    ground = np.column_stack([rng.uniform((-40, -6), (-18, 6), (4000, 2)), np.zeros(4000)])
    surface = seen(np.concatenate([(unsure.polyline(0.05)[:721] + spread).reshape(-1, 3), ground]))
    kept, _ = without_grounded([below], *of(surface), CONFIG)
    assert kept == []
    kept, findings = without_grounded([below], *of(surface, unsure), CONFIG)
    assert kept == [below] and findings == ()
